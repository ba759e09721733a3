# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""All backends compute the same messages and decisions, to the last bit."""

import json
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from magat_robot.policy.backends import ensure_exported, load_computed, load_policy
from magat_robot.policy.computed import ComputedPolicy
from magat_robot.policy.config import ModelError
from magat_robot.policy.export import export
from magat_robot.policy.onnx_policy import OnnxPolicy
from magat_robot.policy.store import load, save

MODELS = Path(__file__).resolve().parents[2] / "models"
VARIANTS = {"MAGAT-F-8": {"cnn": "centred"}, "GAT-B-6-P2": {"taps": 3}}


@pytest.fixture(scope="module", params=VARIANTS)
def folder(request: pytest.FixtureRequest, random_network: Callable, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an exported policy."""
    made = tmp_path_factory.mktemp("policy") / request.param
    save(random_network(request.param, seed=3, **VARIANTS[request.param]), made, "")
    export(made)
    return made


def said(policy: ComputedPolicy, field_of_view: np.ndarray, heard: np.ndarray) -> list[bytes]:
    """All messages, attention and decisions of the robots."""
    own = policy.perceive(field_of_view)
    result = []
    for _ in policy.config.message_sizes:
        received = own.messages[np.maximum(heard, 0)], heard >= 0
        result += [own.messages.tobytes(), policy.attention(own, *received).tobytes()]
        own = policy.hear(own, *received)
    decision = policy.decide(own, np.arange(len(field_of_view), dtype=np.uint64), 5)
    return [*result, decision.weights.tobytes(), decision.primitives.tobytes()]


@pytest.mark.parametrize("robots", [1, 2, 9, 40])
def test_onnxruntime_says_and_decides_what_torch_does_to_the_bit(
    folder: Path, random_team: Callable, robots: int
) -> None:
    team = random_team(np.random.default_rng(robots), robots)
    reference, other = load(folder, temperature=0.7), load_policy(folder, "onnx", temperature=0.7)
    assert isinstance(other, OnnxPolicy)
    assert other.digest == reference.digest
    assert said(other, team.field_of_view, team.heard) == said(reference, team.field_of_view, team.heard)


@pytest.mark.parametrize("policy", sorted(MODELS.glob("*/model.safetensors")), ids=lambda path: path.parent.name)
def test_every_policy_has_an_exported_form_of_the_same_bits(policy: Path, random_team: Callable) -> None:
    shipped = policy.parent
    # Some hundreds: a constant that is rounded to float32 changes one decision in fifty.
    team = random_team(np.random.default_rng(4), 400, side=30)
    exported = load_computed(shipped)
    assert isinstance(exported, OnnxPolicy)
    assert said(exported, team.field_of_view, team.heard) == said(load(shipped), team.field_of_view, team.heard)


def test_whole_ticks_of_many_robots_are_the_same_to_the_bit(folder: Path, random_team: Callable) -> None:
    exported, reference = pickle.loads(pickle.dumps(OnnxPolicy(folder, temperature=0.7))), load(folder, temperature=0.7)
    for tick, team in enumerate(random_team(np.random.default_rng(seed), *[40] * 8) for seed in (1, 1, 2)):
        seen = team.field_of_view, team.heard, team.streams, tick
        assert exported.decide_together(*seen).weights.tobytes() == reference.decide_together(*seen).weights.tobytes()


def test_a_robot_that_hears_nobody_decides_alike(folder: Path, random_team: Callable) -> None:
    field_of_view = random_team(np.random.default_rng(1), 5).field_of_view
    nobody = np.zeros((5, 0), dtype=np.int64)
    assert said(OnnxPolicy(folder), field_of_view, nobody) == said(load(folder), field_of_view, nobody)


@pytest.mark.parametrize("backend", ["torch", "onnx"])
def test_a_policy_loaded_before_a_fork_decides_after_it(folder: Path, random_team: Callable, backend: str) -> None:
    team = random_team(np.random.default_rng(2), 3)
    # In a separate process: this one has threads, which do not survive a fork.
    program = f"""
import os, pickle, sys
from pathlib import Path
import numpy as np
from magat_robot.policy.backends import load_policy, preload
folder, backend = Path({str(folder)!r}), {backend!r}
preload(folder, backend, encoding="int8")
field_of_view = pickle.loads({pickle.dumps(team.field_of_view)!r})
def decide(policy):
    own = policy.perceive(field_of_view)
    for _ in policy.config.message_sizes:
        own = policy.hear(own, own.messages[:, None], np.ones((3, 1), dtype=bool))
    return policy.decide(own, np.arange(3, dtype=np.uint64), 5).weights.tobytes()
sys.stdout.flush()
pid = os.fork()
if pid == 0:
    (folder / "config.json").rename(folder / "away")  # it is there already
    first = decide(load_policy(folder, backend, encoding="int8"))
    (folder / "away").rename(folder / "config.json")
    again = decide(load_policy(folder, backend, encoding="int8"))
    os._exit(0 if first == again else 1)
raise SystemExit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)


def test_an_observation_of_another_kind_is_refused(folder: Path) -> None:
    with pytest.raises(ValueError, match="shape"):
        OnnxPolicy(folder).perceive(np.zeros((1, 3, 9, 9), np.uint8))
    with pytest.raises(ValueError, match="not 2"):
        OnnxPolicy(folder).perceive(np.full((1, 3, 11, 11), 2, np.uint8))


def test_it_needs_no_torch(folder: Path) -> None:
    program = (
        "import sys; from pathlib import Path; from magat_robot.crew import Crew; "
        "from magat_robot.policy.backends import load_policy; "
        f"load_policy(Path({str(folder)!r}), 'onnx'); sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_what_is_missing_damaged_or_of_other_weights_is_refused(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    untouched = (copy / "onnx" / "contents.json").stat().st_mtime_ns
    ensure_exported(copy)
    assert (copy / "onnx" / "contents.json").stat().st_mtime_ns == untouched
    part = copy / "onnx" / "perceive.onnx"
    before = part.read_bytes()
    part.write_bytes(before[:-1] + bytes([before[-1] ^ 1]))
    with pytest.raises(ModelError, match="damaged: export the policy"):
        OnnxPolicy(copy)
    part.unlink()
    with pytest.raises(ModelError, match="cannot be used"):
        OnnxPolicy(copy)
    part.write_bytes(before)
    contents = json.loads((copy / "onnx" / "contents.json").read_text())
    (copy / "onnx" / "contents.json").write_text(json.dumps(contents | {"weights": "0" * 64}))
    with pytest.raises(ModelError, match="exported from the weights 000000000000"):
        OnnxPolicy(copy)


def test_an_export_that_is_not_there_is_made(random_network: Callable, tmp_path: Path) -> None:
    save(random_network("MAGAT-F-4", taps=1), tmp_path, "")
    assert not isinstance(load_computed(tmp_path), OnnxPolicy)
    ensure_exported(tmp_path)
    assert OnnxPolicy(tmp_path).config.name == "MAGAT-F-4"


def test_new_weights_have_no_old_export(random_network: Callable, folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    save(random_network("MAGAT-F-4"), copy, "")
    assert not (copy / "onnx").exists()


def test_an_export_of_another_version_is_refused(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    contents = json.loads((copy / "onnx" / "contents.json").read_text())
    (copy / "onnx" / "contents.json").write_text(json.dumps(contents | {"version": 1}))
    with pytest.raises(ModelError, match="of version 1, and robots need 2: export the policy"):
        OnnxPolicy(copy)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("load_policy(folder, 'torch')", "take the backend onnx"),
        ("load_computed(folder)", "is not exported, and "),
        ("ensure_exported(folder)", "cannot be used"),
    ],
)
def test_where_torch_is_missing_the_error_says_what_to_install(
    random_network: Callable, tmp_path: Path, call: str, said: str
) -> None:
    save(random_network("MAGAT-F-4", taps=1), tmp_path, "")
    program = (
        "import sys; from pathlib import Path; sys.modules['torch'] = None; "
        "from magat_robot.policy.config import ModelError; "
        "from magat_robot.policy.backends import ensure_exported, load_computed, load_policy\n"
        f"folder = Path({str(tmp_path)!r})\ntry: {call}\nexcept ModelError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert said in done.stdout
    assert "requirements-train.txt" in done.stdout


def test_only_what_is_a_matter_of_deployment_can_be_changed(folder: Path) -> None:
    for backend in ("torch", "onnx", "echo"):
        assert load_policy(folder, backend, encoding="int8").config.encoding == "int8"
        with pytest.raises(ModelError, match="hidden cannot be changed"):
            load_policy(folder, backend, hidden=3)
        with pytest.raises(ModelError, match="float8"):
            load_policy(folder, backend, encoding="float8")


def test_echo_robots_send_messages_of_the_right_size_and_walk_at_random(folder: Path) -> None:
    echo = load_policy(folder, "echo")
    own = echo.perceive(np.zeros((500, 3, 11, 11), np.uint8))
    for size in echo.config.message_sizes:
        assert own.messages.shape == (500, size)
        own = echo.hear(own, own.messages[:, None], np.ones((500, 1), bool))
    primitives = echo.decide(own, np.arange(500, dtype=np.uint64), 0).primitives
    assert np.bincount(primitives, minlength=5).min() > 60
