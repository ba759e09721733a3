# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recipes: YAML files that say how `magat train` trains a policy."""

import dataclasses
from pathlib import Path
from typing import Any

import yaml

from magat_robot.policy.config import ModelError, PolicyConfig
from magat_training.trainer import TrainConfig

#: Name of the recipe in the folder of the policy that was trained with it.
RECIPE = "training.yaml"


def read_recipe(name: str) -> TrainConfig:
    """The recipe that ``name`` stands for.

    Args:
        name: a policy's name, e.g. GNN-F-64, for the defaults of `TrainConfig`; or a YAML file (``.yaml``, ``.yml``)
            with some fields of `TrainConfig`, in which ``policy`` is a name or some fields of `PolicyConfig`.

    Raises:
        ModelError: the name is unknown, there is no such file, or it has unknown fields or wrong values.
    """
    if not name.endswith((".yaml", ".yml")):
        return TrainConfig(policy=_policy({"name": name}))
    try:
        values = yaml.safe_load(Path(name).read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ModelError(f"the recipe {name} cannot be read: {error}") from error
    if not isinstance(values, dict):
        raise ModelError(
            f"the recipe {name} holds {type(values).__name__}: it is a mapping, at least `policy: MAGAT-F-128`"
        )
    try:
        return recipe(values)
    except ModelError as error:
        raise ModelError(f"the recipe {name}: {error}") from error


def recipe(values: dict[str, Any]) -> TrainConfig:
    """The recipe with the fields ``values``; see `read_recipe`.

    Raises:
        ModelError: unknown fields, or values of the wrong kind or out of range.
    """
    given = values.get("policy", {})
    policy = _policy({"name": given} if isinstance(given, str) else given)
    known = {field.name: field.type for field in dataclasses.fields(TrainConfig)}
    for name, value in values.items():
        if name not in known:
            raise ModelError(f"a recipe has no field {name!r}: there are {', '.join(known)}")
        if name != "policy" and not _fits(value, known[name]):
            raise ModelError(f"{name} is {value!r}: it is a {getattr(known[name], '__name__', known[name])}")
    try:
        return TrainConfig(**values | {"policy": policy})
    except ValueError as error:
        raise ModelError(str(error)) from error


def write_recipe(config: TrainConfig, path: Path) -> None:
    """Write ``config`` to ``path``, so that `read_recipe` gives it back."""
    values = dataclasses.asdict(config)
    values["policy"] = config.policy.to_json()
    path.write_text(yaml.safe_dump(values, sort_keys=False))


def _policy(values: Any) -> PolicyConfig:
    if not isinstance(values, dict):
        raise ModelError(f"policy is {values!r}: give the name of one, or its fields")
    config = PolicyConfig.from_json(TrainConfig().policy.to_json() | values)
    if config.layer.plain_cnn and "channels" not in values:
        # GNN_baseline keeps the widths of Li et al., IROS 2020, which are the defaults of `PolicyConfig`.
        return dataclasses.replace(config, channels=PolicyConfig().channels)
    return config


def _fits(value: Any, kind: Any) -> bool:
    if kind is float:
        return type(value) in (int, float)
    return type(value) is kind
