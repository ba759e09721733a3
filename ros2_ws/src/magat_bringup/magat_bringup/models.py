"""Where policies are: a folder given as such, or a name looked up in the folders of models."""

import os
from collections.abc import Iterator
from pathlib import Path

from magat_robot.policy.config import ModelError
from magat_robot.policy.store import WEIGHTS


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
