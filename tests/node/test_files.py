# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Atomic writes: a file is there as a whole, old or new."""

from pathlib import Path

import pytest

from magat_node.files import write_atomically


def test_a_file_is_replaced_when_its_draft_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("old")
    with write_atomically(path) as draft:
        draft.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_leaves_the_old_file_and_no_draft(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("old")
    with pytest.raises(TypeError), write_atomically(path) as draft:
        draft.write_text("half") + draft.write_text(None)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
