# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finds policy folders, by path, name or digest. `folder` and `store` read what is in them."""

import os
from collections.abc import Iterator
from pathlib import Path

from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import CONFIG, WEIGHTS, read_folder


def model_folders() -> Iterator[Path]:
    """The folders that policies are searched in.

    ``$MAGAT_MODELS``, ``./models``, and the one of this installation, or of this checkout if its modules are linked to.
    """
    if "MAGAT_MODELS" in os.environ:
        yield Path(os.environ["MAGAT_MODELS"])
    yield Path("models")
    for parent in Path(__file__).resolve().parents:
        if (parent / "share" / "magat_robot" / "models").is_dir():
            yield parent / "share" / "magat_robot" / "models"
            return
        if (parent / "package.xml").is_file():
            yield (parent / "models").resolve()
            return


def find_policy(name: str) -> Path:
    """The folder of the policy ``name``: a path, or a name such as MAGAT-F-128.

    Raises:
        ModelError: there is no such policy.
    """
    candidates = [Path(name), *(folder / name for folder in model_folders())]
    for folder in candidates:
        if (folder / WEIGHTS).is_file():
            return folder.resolve()
    looked = ", ".join(str(folder) for folder in candidates)
    raise ModelError(f"no policy {name!r}: there is no {WEIGHTS} in {looked}")


def all_policies() -> dict[str, Path]:
    """All policy folders in `model_folders`, damaged ones included, by name.

    The key is the path where an earlier folder has taken the name.

    Raises:
        ModelError: there are no policies.
    """
    folders = dict.fromkeys(folder.resolve() for folder in model_folders())
    policies: dict[str, Path] = {}
    for models in folders:
        for folder in sorted(models.iterdir()) if models.is_dir() else ():
            if (folder / WEIGHTS).is_file() or (folder / CONFIG).is_file():
                policies[folder.name if folder.name not in policies else str(folder)] = folder
    if not policies:
        raise ModelError(f"no policies in {', '.join(map(str, folders))}: train one with `magat train`")
    return policies


def policy_of_digest(digest: str) -> Path | None:
    """The policy folder in `model_folders` whose weights have this SHA-256 (hexadecimal); None if there is none."""
    for folder in all_policies().values():
        try:
            if read_folder(folder)[1] == digest:
                return folder
        except ModelError:
            continue  # damaged: not the one
    return None
