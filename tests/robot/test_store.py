# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Policy folders: a loaded policy decides as the saved one; damaged files are refused by name."""

import dataclasses
import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from magat_robot.policy.config import ModelError
from magat_robot.policy.policy import Policy
from magat_robot.policy.store import CARD, CONFIG, WEIGHTS, load, load_network, save


@pytest.fixture
def folder(tmp_path: Path, random_network: Callable) -> Path:
    """A saved policy."""
    save(random_network("MAGAT-B-16-P3"), tmp_path / "a" / "policy", "# how it was trained\n")
    return tmp_path / "a" / "policy"


def rewrite_config(folder: Path, change: Callable[[dict], object]) -> None:
    stored = json.loads((folder / CONFIG).read_text())
    changed = change(stored)
    (folder / CONFIG).write_text(json.dumps(stored if changed is None else changed))


def rewrite_weights(folder: Path, tensors: dict[str, torch.Tensor]) -> None:
    """Replace the weights, and update their digest."""
    save_file(tensors, folder / WEIGHTS)
    digest = hashlib.sha256((folder / WEIGHTS).read_bytes()).hexdigest()
    rewrite_config(folder, lambda stored: stored.update(sha256=digest))


def test_a_loaded_policy_decides_as_the_saved_one_to_the_last_bit(
    random_team: Callable, random_network: Callable, tmp_path: Path, variant: dict
) -> None:
    network = random_network(**variant, temperature=0.5)
    digest = save(network, tmp_path / "policy", "")
    policy = load(tmp_path / "policy")
    assert policy.config == network.config
    assert policy.digest == digest == hashlib.sha256((tmp_path / "policy" / WEIGHTS).read_bytes()).hexdigest()
    team = random_team(np.random.default_rng(0), 25)
    arguments = (team.field_of_view, team.heard, team.streams, 4)
    before, after = Policy(network).decide_together(*arguments), policy.decide_together(*arguments)
    assert after.weights.tobytes() == before.weights.tobytes()
    assert after.primitives.tolist() == before.primitives.tolist()


def test_a_policy_may_be_deployed_with_another_encoding_and_temperature(folder: Path) -> None:
    stored = load(folder)
    policy = load(folder, encoding="int8", temperature=0.5)
    assert (stored.config.encoding, stored.config.temperature) == ("float32", 1.0)
    assert policy.config == dataclasses.replace(stored.config, encoding="int8", temperature=0.5)
    assert policy.digest == stored.digest, "the weights are the same"


def test_the_encoding_of_a_policys_messages_is_stored(random_network: Callable, tmp_path: Path) -> None:
    save(random_network("MAGAT-F-16", encoding="float16"), tmp_path, "")
    assert load(tmp_path).config.encoding == "float16"
    assert load(tmp_path, encoding="float32").config.encoding == "float32"


@pytest.mark.parametrize("change", [{"encoding": "morse"}, {"temperature": 0.0}], ids=repr)
def test_a_deployment_that_is_out_of_range_is_refused(folder: Path, change: dict) -> None:
    with pytest.raises(ModelError, match=r"encoding 'morse'|temperature 0.0"):
        load(folder, **change)


def test_what_was_trained_is_stored_and_nothing_that_deployment_makes_of_it(
    random_network: Callable, tmp_path: Path, variant: dict
) -> None:
    network = random_network(**variant)
    Policy(network)  # converts a copy to fixed point
    save(network, tmp_path, "")
    stored = load_file(tmp_path / WEIGHTS)
    assert set(stored) == {*dict(network.named_parameters()), *dict(network.named_buffers())}
    assert not any("folded" in name for name in stored)
    loaded, _ = load_network(tmp_path)
    assert all(torch.equal(tensor, loaded.state_dict()[name]) for name, tensor in network.state_dict().items())
    assert all(parameter.dtype == torch.float32 for parameter in loaded.parameters())


def test_a_network_trained_in_another_memory_format_is_saved_as_it_is(random_network: Callable, tmp_path: Path) -> None:
    network = random_network()
    plain = save(network, tmp_path / "plain", "")
    assert save(network.to(memory_format=torch.channels_last), tmp_path / "turned", "") == plain
    loaded, _ = load_network(tmp_path / "turned")
    assert all(torch.equal(tensor, loaded.state_dict()[name]) for name, tensor in network.state_dict().items())


def test_a_folder_holds_weights_configuration_and_card(folder: Path) -> None:
    assert sorted(file.name for file in folder.iterdir()) == ["card.md", "config.json", "model.safetensors"]
    assert (folder / CARD).read_text() == "# how it was trained\n"
    assert json.loads((folder / CONFIG).read_text())["policy"]["name"] == "MAGAT-B-16-P3"
    assert load(folder).config.heads == 3


@pytest.mark.parametrize("name", [WEIGHTS, CONFIG])
def test_a_missing_file_is_named(folder: Path, name: str) -> None:
    (folder / name).unlink()
    with pytest.raises(ModelError, match=f"{name} is missing"):
        load(folder)


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="nowhere"):
        load(tmp_path / "nowhere")


@pytest.mark.parametrize("keep", [0, 7, 200, -1])
def test_truncated_weights_are_refused(folder: Path, keep: int) -> None:
    data = (folder / WEIGHTS).read_bytes()
    (folder / WEIGHTS).write_bytes(data[:keep])
    with pytest.raises(ModelError, match=WEIGHTS):
        load(folder)


@pytest.mark.parametrize("place", [0, 100, 0.5, -1], ids=["first", "header", "middle", "last"])
def test_a_flipped_bit_is_noticed(folder: Path, place: float) -> None:
    data = bytearray((folder / WEIGHTS).read_bytes())
    data[int(place * len(data)) if isinstance(place, float) else place] ^= 1
    (folder / WEIGHTS).write_bytes(data)
    with pytest.raises(ModelError, match=rf"{WEIGHTS} is damaged"):
        load(folder)


def test_weights_of_another_policy_are_refused(folder: Path, random_network: Callable, tmp_path: Path) -> None:
    save(random_network("MAGAT-B-16-P3", seed=1), tmp_path / "other", "")
    (folder / WEIGHTS).write_bytes((tmp_path / "other" / WEIGHTS).read_bytes())
    with pytest.raises(ModelError, match=rf"{WEIGHTS} .*another policy"):
        load(folder)


@pytest.mark.parametrize(
    ("name", "sizes"),
    [
        ("MAGAT-F-16-P3", {}),
        ("MAGAT-B-8-P3", {}),
        ("MAGAT-B-16", {}),
        ("GAT-B-16-P3", {}),
        ("GNN-B-16-P3", {}),
        ("GNN_baseline-B-16-P3", {}),
        ("MAGAT-B-16-P3", {"taps": 3}),
        ("MAGAT-B-16-P3", {"taps": 1}),
        ("MAGAT-B-16-P3", {"layers": 2}),
    ],
    ids=str,
)
def test_weights_of_another_configuration_are_refused_though_their_digest_is_right(
    folder: Path, random_network: Callable, name: str, sizes: dict
) -> None:
    rewrite_weights(folder, random_network(name, **sizes).state_dict())
    with pytest.raises(ModelError, match=rf"{WEIGHTS} .*MAGAT-B-16-P3"):
        load(folder)


def test_tensors_that_are_missing_or_too_many_are_refused(folder: Path, random_network: Callable) -> None:
    tensors = random_network("MAGAT-B-16-P3").state_dict()
    rewrite_weights(folder, {name: tensor for name, tensor in tensors.items() if name != "action.bias"})
    with pytest.raises(ModelError, match=WEIGHTS):
        load(folder)
    rewrite_weights(folder, tensors | {"more": torch.zeros(2)})
    with pytest.raises(ModelError, match=WEIGHTS):
        load(folder)


def test_a_file_with_the_right_digest_that_is_no_safetensors_is_refused(folder: Path) -> None:
    (folder / WEIGHTS).write_bytes(b"anything else")
    digest = hashlib.sha256(b"anything else").hexdigest()
    rewrite_config(folder, lambda stored: stored.update(sha256=digest))
    with pytest.raises(ModelError, match=WEIGHTS):
        load(folder)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["action.weight", "extractor.blocks.0.first.norm.running_var"])
def test_weights_that_are_not_finite_are_refused_by_name(
    folder: Path, random_network: Callable, name: str, value: float
) -> None:
    tensors = random_network("MAGAT-B-16-P3").state_dict()
    tensors[name].view(-1)[0] = value
    rewrite_weights(folder, tensors)
    with pytest.raises(ModelError, match=rf"{WEIGHTS} .*{name}"):
        load(folder)


def test_weights_that_cannot_be_deployed_are_refused(folder: Path, random_network: Callable) -> None:
    tensors = random_network("MAGAT-B-16-P3").state_dict()
    tensors["extractor.stem.conv.weight"].mul_(1e9)
    rewrite_weights(folder, tensors)
    load_network(folder)
    with pytest.raises(ModelError, match="too large"):
        load(folder)


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(b"", id="empty"),
        pytest.param(b'{"policy": {', id="cut off"),
        pytest.param(b"\xff\xfe\x00", id="not text"),
        pytest.param(b"[]", id="a list"),
        pytest.param(b"null", id="null"),
        pytest.param(b"{}", id="nothing in it"),
        pytest.param(b'{"policy": 3, "sha256": "0"}', id="a number for a policy"),
        pytest.param(b'{"policy": ' + 5000 * b"9" + b', "sha256": "0"}', id="a number too long to read"),
    ],
)
def test_a_damaged_configuration_is_refused_by_the_name_of_its_file(folder: Path, text: bytes) -> None:
    (folder / CONFIG).write_bytes(text)
    with pytest.raises(ModelError, match=CONFIG):
        load(folder)


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda stored: stored["policy"].update(extra=1), id="an unknown key"),
        pytest.param(lambda stored: stored["policy"].pop("hidden"), id="a missing key"),
        pytest.param(lambda stored: stored["policy"].update(hidden="wide"), id="a value of another kind"),
        pytest.param(lambda stored: stored["policy"].update(temperature=0), id="a value out of range"),
        pytest.param(lambda stored: stored["policy"].update(temperature=10**400), id="a value beyond all ranges"),
        pytest.param(lambda stored: stored["policy"].update(taps="two"), id="taps in words"),
        pytest.param(lambda stored: stored["policy"].update(layers=1.5), id="half a layer"),
        pytest.param(lambda stored: stored["policy"].update(layers=True), id="a truth value for a number"),
        pytest.param(lambda stored: stored["policy"].update(normalise=1), id="a number for a truth value"),
        pytest.param(lambda stored: stored["policy"].pop("taps"), id="no taps"),
        pytest.param(lambda stored: stored["policy"].pop("encoding"), id="no encoding"),
        pytest.param(lambda stored: stored["policy"].update(encoding="morse"), id="an unknown encoding"),
        pytest.param(lambda stored: stored["policy"].update(name="GAT-X"), id="an unknown policy"),
        pytest.param(lambda stored: stored.pop("sha256"), id="no digest"),
        pytest.param(lambda stored: stored.update(sha256=None), id="an empty digest"),
    ],
)
def test_an_unusable_configuration_is_refused_by_the_name_of_its_file(folder: Path, change: Callable) -> None:
    rewrite_config(folder, lambda stored: change(stored) and None)
    with pytest.raises(ModelError, match=CONFIG):
        load(folder)


@pytest.mark.parametrize("change", [{"hidden": 10**15}, {"taps": 10**15}, {"layers": 10**15}], ids=repr)
def test_a_configuration_too_large_for_any_machine_is_refused(folder: Path, change: dict) -> None:
    rewrite_config(folder, lambda stored: stored["policy"].update(change))
    with pytest.raises(ModelError, match=CONFIG):
        load(folder)
