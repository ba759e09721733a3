"""A deployed policy is prepared, switched to and rolled back, and refused where it cannot be carried."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import read_files, read_folder, write_files
from magat_robot.policy.store import CONFIG, WEIGHTS, load, save
from magat_robot.policy_slot import PolicySlot


@pytest.fixture
def folders(tmp_path: Path, random_network: Callable) -> dict[str, Path]:
    """Policies, the longest messages of which are of 64, 64, 32 and 128 bytes as float32."""
    for name, network in {
        "first": random_network("MAGAT-F-16"),
        "second": random_network("GNN-F-16", seed=1),
        "short": random_network("MAGAT-B-8"),
        "long": random_network("MAGAT-F-16", taps=3),
    }.items():
        save(network, tmp_path / name, "")
    return {folder.name: folder for folder in tmp_path.iterdir()}


@pytest.fixture
def carried(folders: dict[str, Path]) -> PolicySlot:
    return PolicySlot(load(folders["first"], encoding="float16"), "torch")


def offer(folder: Path) -> tuple[str, dict[str, bytes]]:
    return read_folder(folder)[1], read_files(folder)


def test_a_policy_is_prepared_then_carried_then_rolled_back(carried, folders):
    first, (digest, files) = carried.policy, offer(folders["second"])
    carried.prepare(7, digest, files)
    assert (carried.prepared, carried.refusal, carried.deployment) == (7, "", 0)
    assert carried.policy is first, "it is only prepared"
    assert carried.switch(7)
    assert (carried.deployment, carried.policy.digest) == (7, digest)
    assert carried.policy.config.name == "GNN-F-16"
    assert carried.policy.config.encoding == "float16", "that of the team"
    assert carried.roll_back(7)
    assert (carried.deployment, carried.prepared) == (0, 0)
    assert carried.policy is first


def test_what_is_done_is_not_done_again(carried, folders):
    digest, files = offer(folders["second"])
    for _ in range(2):
        carried.prepare(7, digest, files)
    assert carried.switch(7)
    second = carried.policy
    carried.prepare(7, digest, files)
    assert not carried.switch(7)
    assert carried.policy is second
    assert carried.roll_back(7)
    assert not carried.roll_back(7)


def test_orders_of_other_deployments_change_nothing(carried, folders):
    first = carried.policy
    assert not carried.switch(7)
    carried.prepare(7, *offer(folders["second"]))
    assert not carried.switch(8)
    assert not carried.roll_back(8)
    assert carried.prepared == 7
    assert carried.policy is first
    carried.prepare(8, *offer(folders["short"]))
    assert not carried.switch(7), "another one has taken its place"
    assert carried.switch(8)
    assert carried.policy.config.name == "MAGAT-B-8"


def test_what_is_only_prepared_is_forgotten_when_it_is_rolled_back(carried, folders):
    carried.prepare(7, *offer(folders["second"]))
    assert not carried.roll_back(7)
    assert carried.prepared == 0
    assert not carried.switch(7)


def test_a_second_deployment_goes_back_to_the_first(carried, folders):
    for number, name in ((7, "second"), (8, "short")):
        carried.prepare(number, *offer(folders[name]))
        assert carried.switch(number)
    assert carried.roll_back(8)
    assert (carried.deployment, carried.policy.config.name) == (7, "GNN-F-16")


def refusal_of(carried: PolicySlot, digest: str, files: dict[str, bytes]) -> str:
    """Why a deployment is refused, which changes nothing else."""
    policy = carried.policy
    carried.prepare(9, digest, files)
    assert carried.prepared == 9
    assert carried.refusal
    assert not carried.switch(9)
    assert carried.policy is policy
    return carried.refusal


def test_messages_that_are_too_long_are_refused(carried, folders):
    assert carried.max_payload == 32
    assert "sends up to 64 bytes in a message, as float16, and the robots' limit is 32" in refusal_of(
        carried, *offer(folders["long"])
    )
    roomy = PolicySlot(carried.policy, "torch", max_payload=64)
    roomy.prepare(1, *offer(folders["long"]))
    assert roomy.switch(1)
    with pytest.raises(ModelError, match="limit is 31"):
        PolicySlot(carried.policy, "torch", max_payload=31)


def test_a_refusal_does_not_outlive_its_deployment(carried, folders):
    refusal_of(carried, *offer(folders["long"]))
    assert not carried.roll_back(9)
    assert (carried.prepared, carried.refusal) == (0, "")
    refusal_of(carried, *offer(folders["long"]))
    carried.prepare(10, *offer(folders["second"]))
    assert carried.refusal == ""
    assert carried.switch(10)


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
def test_damage_is_refused(carried, folders, damage, said):
    assert said in refusal_of(carried, *damage(*offer(folders["second"])))


def test_nothing_is_written_outside_of_the_folder(tmp_path):
    inner = tmp_path / "inner"
    with pytest.raises(ModelError, match="evil"):
        write_files({"onnx/look.onnx": b"1", "../evil": b"2"}, inner)
    assert list(tmp_path.rglob("*")) == []


def test_without_an_export_robots_of_onnxruntime_refuse(folders):
    carried = PolicySlot(load(folders["first"]), "onnx")
    assert "magat export" in refusal_of(carried, *offer(folders["second"]))


def test_an_export_that_onnxruntime_cannot_load_is_refused(folders):
    """Its digests are right; only onnxruntime can tell."""
    import hashlib

    digest, files = offer(folders["second"])
    parts = {f"{name}.onnx": b"no graph" for name in ("look", "hear_0")}
    contents = {"weights": digest, "files": {name: hashlib.sha256(data).hexdigest() for name, data in parts.items()}}
    exported = {f"onnx/{name}": data for name, data in parts.items()}
    exported["onnx/contents.json"] = json.dumps(contents).encode()
    carried = PolicySlot(load(folders["first"]), "onnx")
    assert "onnxruntime cannot load" in refusal_of(carried, digest, files | exported)
