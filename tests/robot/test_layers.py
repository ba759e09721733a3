# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The registry of graph layers: what a configuration learns without torch is what the classes are decorated with."""

import subprocess
import sys

import pytest

from magat_robot.policy import graph
from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.graph import GraphAttention, GraphConvolution, GraphLayer, MessageAwareAttention, layer
from magat_robot.policy.layers import LAYERS, LayerSpec, _registered

CLASSES = {
    "MAGAT": MessageAwareAttention,
    "GAT": GraphAttention,
    "GNN": GraphConvolution,
    "GNN_baseline": GraphConvolution,
}


def test_every_layer_that_is_read_from_the_source_has_a_class_and_the_other_way_round() -> None:
    assert LAYERS.keys() == graph._classes.keys()
    assert {name: graph._classes[name] for name in CLASSES} == CLASSES


def test_the_layers_of_the_paper_are_registered_as_the_paper_has_them() -> None:
    assert [LAYERS[name].attention for name in CLASSES] == [True, True, False, False]
    assert [name for name, spec in LAYERS.items() if spec.plain_cnn] == ["GNN_baseline"]


@pytest.mark.parametrize("name", LAYERS)
def test_a_layer_is_built_as_the_configuration_says(name: str) -> None:
    built = graph.build_layer(PolicyConfig(f"{name}-F-8-P3", taps=4), 6)
    assert type(built) is graph._classes[name]
    assert (built.inputs, built.heads) == (6, 3)
    assert (built.own.weight.shape, built.taps.shape) == ((3 * 8, 6), (3, 3, 6, 8))


def test_a_new_layer_is_one_class_with_one_decorator() -> None:
    source = '''
@layer("SUM", attention=False)
@torch.compile(dynamic=True)
class SumLayer(GraphLayer):
    """Nothing of it is run."""

@layer("TWO")
@layer("TWO_plain", plain_cnn=True)
class TwoLayer(GraphLayer): ...

@dataclass
class Other: ...
'''
    assert dict(_registered(source)) == {
        "SUM": LayerSpec("SUM", attention=False),
        "TWO": LayerSpec("TWO"),
        "TWO_plain": LayerSpec("TWO_plain", plain_cnn=True),
    }


@pytest.mark.parametrize(
    ("name", "options"), [("ELSEWHERE", {}), ("MAGAT", {}), ("MAGAT", {"attention": False})], ids=str
)
def test_a_layer_that_is_defined_elsewhere_or_twice_is_refused(name: str, options: dict) -> None:
    with pytest.raises(ValueError, match=rf"the layer '{name}' must be registered once.*graph\.py"):
        layer(name, **options)(GraphLayer)
    assert graph._classes.get(name) is CLASSES.get(name)


def test_names_are_known_without_torch_and_numpy() -> None:
    program = "import sys; from magat_robot.policy.config import PolicyConfig; PolicyConfig(); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert "magat_robot" in loaded
    assert not loaded & {"torch", "numpy", "rclpy"}
