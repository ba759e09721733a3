"""Policies: where they are, a folder given as such or a name in the folders of models."""

import os
from collections.abc import Iterator
from pathlib import Path

from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import CONFIG, WEIGHTS, read_folder


def model_folders() -> Iterator[Path]:
    """Folders that hold policies: ``$MAGAT_MODELS``, ``models`` here, and that of the checkout this code runs from."""
    if "MAGAT_MODELS" in os.environ:
        yield Path(os.environ["MAGAT_MODELS"])
    yield Path("models")
    for parent in Path(__file__).resolve().parents:
        if (parent / "ros2_ws").is_dir():
            yield parent / "models"


def find_policy(name: str) -> Path:
    """The folder of the policy ``name``: a path, or a name such as MAGAT-F-128.

    Raises:
        ModelError: there is none.
    """
    candidates = [Path(name), *(folder / name for folder in model_folders())]
    for folder in candidates:
        if (folder / WEIGHTS).is_file():
            return folder.resolve()
    looked = ", ".join(str(folder) for folder in candidates)
    raise ModelError(f"no policy {name!r}: looked for {WEIGHTS} in {looked}")


def all_policies() -> dict[str, Path]:
    """Every policy folder, damaged ones included, in the folders of models, by its name.

    One whose name an earlier folder of models has already taken goes by its path.

    Raises:
        ModelError: there is none.
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
    """The folder in the folders of models whose weights have this SHA-256; None if there is none."""
    for folder in all_policies().values():
        try:
            if read_folder(folder)[1] == digest:
                return folder
        except ModelError:
            continue  # a damaged one is not what is looked for
    return None
