# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files of tensors that training writes: each ends with the SHA-256 of what precedes it."""

import hashlib
import io
from pathlib import Path
from typing import Any

import torch

from magat_node.errors import MagatError
from magat_node.files import write_atomically

_DIGEST_BYTES = hashlib.sha256().digest_size


class CheckpointError(MagatError, ValueError):
    """A checkpoint cannot be used; the message says why and what to do."""


def write_checkpoint(path: Path, state: dict[str, Any]) -> None:
    """Write ``state``, of tensors and plain values, to ``path``, in one step.

    Raises:
        OSError: it cannot be written; what was in ``path`` before is still there.
    """
    file = io.BytesIO()
    torch.save(state, file)
    content = file.getvalue()
    with write_atomically(path) as draft:
        draft.write_bytes(content + hashlib.sha256(content).digest())


def read_checkpoint(path: Path) -> dict[str, Any]:
    """The state in ``path``.

    Raises:
        CheckpointError: it cannot be read, or its hash is not that of its contents.
    """
    advice = "delete its folder to start again"
    try:
        stored = path.read_bytes()
    except OSError as error:
        raise CheckpointError(f"{path} cannot be read ({error.strerror}): {advice}") from error
    content, digest = stored[:-_DIGEST_BYTES], stored[-_DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != digest:
        raise CheckpointError(f"{path} is damaged, or of an older version: {advice}")
    state: dict[str, Any] = torch.load(io.BytesIO(content), weights_only=True)
    return state
