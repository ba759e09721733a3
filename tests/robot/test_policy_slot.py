# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A deployed policy is prepared, switched to and rolled back, or refused if it cannot be used."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import EXPORT_VERSION, read_files, read_folder, write_files, write_temperatures
from magat_robot.policy.store import CONFIG, WEIGHTS, load, save
from magat_robot.policy_slot import PolicySlot


@pytest.fixture
def folders(tmp_path: Path, random_network: Callable) -> dict[str, Path]:
    """Policies whose longest messages have 64, 64, 32 and 128 bytes as float32."""
    for name, network in {
        "first": random_network("MAGAT-F-16"),
        "second": random_network("GNN-F-16", seed=1),
        "short": random_network("MAGAT-B-8"),
        "long": random_network("MAGAT-F-16", taps=3),
    }.items():
        save(network, tmp_path / name, "")
    return {folder.name: folder for folder in tmp_path.iterdir()}


@pytest.fixture
def slot(folders: dict[str, Path]) -> PolicySlot:
    return PolicySlot(load(folders["first"], encoding="float16"), "torch")


def offer(folder: Path) -> tuple[str, dict[str, bytes]]:
    return read_folder(folder)[1], read_files(folder)


def test_a_policy_is_prepared_then_carried_then_rolled_back(slot, folders):
    first, (digest, files) = slot.policy, offer(folders["second"])
    slot.prepare(7, digest, files)
    assert (slot.prepared, slot.refusal, slot.deployment) == (7, "", 0)
    assert slot.policy is first, "it is only prepared"
    assert slot.switch(7)
    assert (slot.deployment, slot.policy.digest) == (7, digest)
    assert slot.policy.config.name == "GNN-F-16"
    assert slot.policy.config.encoding == "float16", "that of the team"
    assert slot.roll_back(7)
    assert (slot.deployment, slot.prepared) == (0, 0)
    assert slot.policy is first


def test_a_deployed_policy_gets_its_temperature_for_the_shield(folders):
    write_temperatures(folders["second"], {"pibt": 0.25}, "idle")
    for shield, temperature in (("", 1.0), ("idle", 1.0), ("pibt", 0.25)):
        slot = PolicySlot(load(folders["first"]), "torch", shield=shield)
        slot.prepare(7, *offer(folders["second"]))
        assert slot.switch(7)
        assert slot.policy.config.temperature == temperature


def test_what_is_done_is_not_done_again(slot, folders):
    digest, files = offer(folders["second"])
    for _ in range(2):
        slot.prepare(7, digest, files)
    assert slot.switch(7)
    second = slot.policy
    slot.prepare(7, digest, files)
    assert not slot.switch(7)
    assert slot.policy is second
    assert slot.roll_back(7)
    assert not slot.roll_back(7)


def test_orders_of_other_deployments_change_nothing(slot, folders):
    first = slot.policy
    assert not slot.switch(7)
    slot.prepare(7, *offer(folders["second"]))
    assert not slot.switch(8)
    assert not slot.roll_back(8)
    assert slot.prepared == 7
    assert slot.policy is first
    slot.prepare(8, *offer(folders["short"]))
    assert not slot.switch(7), "another one has taken its place"
    assert slot.switch(8)
    assert slot.policy.config.name == "MAGAT-B-8"


def test_what_is_only_prepared_is_forgotten_when_it_is_rolled_back(slot, folders):
    slot.prepare(7, *offer(folders["second"]))
    assert not slot.roll_back(7)
    assert slot.prepared == 0
    assert not slot.switch(7)


def test_a_second_deployment_goes_back_to_the_first(slot, folders):
    for number, name in ((7, "second"), (8, "short")):
        slot.prepare(number, *offer(folders[name]))
        assert slot.switch(number)
    assert slot.roll_back(8)
    assert (slot.deployment, slot.policy.config.name) == (7, "GNN-F-16")


def refusal_of(slot: PolicySlot, digest: str, files: dict[str, bytes]) -> str:
    """The reason why a deployment is refused; the refusal must not change anything else."""
    policy = slot.policy
    slot.prepare(9, digest, files)
    assert slot.prepared == 9
    assert slot.refusal
    assert not slot.switch(9)
    assert slot.policy is policy
    return slot.refusal


def test_messages_that_are_too_long_are_refused(slot, folders):
    assert slot.max_payload == 32
    assert "sends up to 64 bytes in a message, as float16, and the robots' limit is 32" in refusal_of(
        slot, *offer(folders["long"])
    )
    roomy = PolicySlot(slot.policy, "torch", max_payload=64)
    roomy.prepare(1, *offer(folders["long"]))
    assert roomy.switch(1)
    with pytest.raises(ModelError, match="limit is 31"):
        PolicySlot(slot.policy, "torch", max_payload=31)


def test_a_refusal_does_not_outlive_its_deployment(slot, folders):
    refusal_of(slot, *offer(folders["long"]))
    assert not slot.roll_back(9)
    assert (slot.prepared, slot.refusal) == (0, "")
    refusal_of(slot, *offer(folders["long"]))
    slot.prepare(10, *offer(folders["second"]))
    assert slot.refusal == ""
    assert slot.switch(10)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda digest, files: ("0" * 64, files), "not 0000"),
        (lambda digest, files: (digest, files | {WEIGHTS: files[WEIGHTS][:-1]}), "damaged"),
        (lambda digest, files: (digest, files | {CONFIG: b"{"}), "damaged"),
        (lambda digest, files: (digest, {CONFIG: files[CONFIG]}), f"{WEIGHTS} is missing"),
        (lambda digest, files: (digest, {}), f"{CONFIG} is missing"),
        (lambda digest, files: (digest, files | {"../evil": b""}), "no file '../evil'"),
        (lambda digest, files: (digest, files | {"onnx/../../evil": b""}), "no file"),
        (lambda digest, files: (digest, files | {"/evil": b""}), "no file"),
        (lambda digest, files: (digest, files | {"onnx/.hidden": b""}), "no file"),
    ],
)
def test_damage_is_refused(slot, folders, damage, said):
    assert said in refusal_of(slot, *damage(*offer(folders["second"])))


def test_nothing_is_written_outside_of_the_folder(tmp_path):
    inner = tmp_path / "inner"
    with pytest.raises(ModelError, match="evil"):
        write_files({"onnx/perceive.onnx": b"1", "../evil": b"2"}, inner)
    assert list(tmp_path.rglob("*")) == []


def test_without_an_export_robots_of_onnxruntime_refuse(folders):
    slot = PolicySlot(load(folders["first"]), "onnx")
    assert "magat export" in refusal_of(slot, *offer(folders["second"]))


def test_an_export_that_onnxruntime_cannot_load_is_refused(folders):
    """Its digests are right; only onnxruntime detects the error."""
    import hashlib

    digest, files = offer(folders["second"])
    parts = {f"{name}.onnx": b"no graph" for name in ("perceive", "hear_0")}
    contents = {"version": EXPORT_VERSION, "weights": digest}
    contents["files"] = {name: hashlib.sha256(data).hexdigest() for name, data in parts.items()}
    exported = {f"onnx/{name}": data for name, data in parts.items()}
    exported["onnx/contents.json"] = json.dumps(contents).encode()
    slot = PolicySlot(load(folders["first"]), "onnx")
    assert "onnxruntime cannot load" in refusal_of(slot, digest, files | exported)


@pytest.mark.parametrize(
    "damage",
    ["[" * 100_000, '{"policy": ' * 5000, '{"policy": {"name": "' + "x" * 100_000 + '"}}'],
    ids=["lists", "objects", "text"],
)
def test_a_hostile_configuration_is_refused_in_a_few_words(folders, damage):
    slot = PolicySlot(load(folders["first"]), "torch")
    digest, files = offer(folders["second"])
    assert 0 < len(refusal_of(slot, digest, files | {"config.json": damage.encode()})) < 600
