"""Policy files of strangers: what could act beyond the bytes of a digest, hang or grow is refused when it is loaded."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from surefoot.agents.foreign import Network
from surefoot.agents.load import load_agent, load_policy
from surefoot.agents.network import NetworkAgent
from surefoot.agents.onnx_check import OWN_OPERATORS, read_model
from surefoot.agents.policy_file import network_bytes
from surefoot.errors import UserError
from surefoot.robots import Robot
from surefoot.task.contract import Contract


@pytest.fixture(scope="module")
def contract(robot: Robot) -> Contract:
    return Contract.of(robot, "bent", 0.5)


@pytest.fixture
def model(contract: Contract) -> onnx.ModelProto:
    """A policy of one hidden layer."""
    rng = np.random.default_rng(0)
    layers = [(0.1 * rng.normal(size=(o, i)), np.zeros(o)) for i, o in ((47, 8), (8, 11))]
    return onnx.load_model_from_string(network_bytes(layers, np.zeros(47), np.ones(47), True, contract))


def refusal(model: onnx.ModelProto) -> str:
    with pytest.raises(UserError) as error:
        NetworkAgent(model.SerializeToString(), "mine")
    assert "\n" not in str(error.value)
    return str(error.value)


def test_weights_in_another_file_are_refused_even_where_that_file_is_there(
    model: onnx.ModelProto, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    onnx.save(model, "mine.onnx", save_as_external_data=True, location="weights.bin", size_threshold=0)
    assert (tmp_path / "weights.bin").exists()
    with pytest.raises(UserError, match="its tensor 'weight_0' lies in another file, which may change"):
        load_policy("mine.onnx")


def a_loop() -> onnx.NodeProto:
    """It counts to the largest number that there is."""
    body = helper.make_graph(
        [helper.make_node("Identity", ["go_on"], ["still"])],
        "body",
        [
            helper.make_tensor_value_info("i", TensorProto.INT64, []),
            helper.make_tensor_value_info("go_on", TensorProto.BOOL, []),
        ],
        [helper.make_tensor_value_info("still", TensorProto.BOOL, [])],
    )
    return helper.make_node("Loop", ["", "true"], [], body=body)


def change_nodes(*nodes: onnx.NodeProto) -> Callable[[onnx.GraphProto], None]:
    return lambda graph: graph.node.extend(nodes)


def put(name: str, array: np.ndarray) -> Callable[[onnx.GraphProto], None]:
    def change(graph: onnx.GraphProto) -> None:
        (tensor,) = (each for each in graph.initializer if each.name == name)
        tensor.CopyFrom(numpy_helper.from_array(array, name))

    return change


def huge(graph: onnx.GraphProto) -> None:
    graph.initializer[0].dims[:] = [2**40, 2**40]


def whole_numbers_in(graph: onnx.GraphProto) -> None:
    graph.input[0].type.tensor_type.elem_type = TensorProto.INT64


def for_one_robot_only(graph: onnx.GraphProto) -> None:
    graph.input[0].type.tensor_type.shape.dim[0].dim_value = 1


def two_inputs(graph: onnx.GraphProto) -> None:
    graph.input.append(helper.make_tensor_value_info("more", TensorProto.FLOAT, ["robots", 2]))


def scaled(graph: onnx.GraphProto) -> None:
    graph.node[0].attribute.append(helper.make_attribute("alpha", 2.0))


def other_names(graph: onnx.GraphProto) -> None:
    graph.initializer[0].name = graph.node[0].input[1] = "w"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (change_nodes(a_loop()), "it has the operator 'Loop'; valid: Gemm, Tanh, Relu, Elu, Identity"),
        (change_nodes(helper.make_node("Mine", ["action"], ["x"], domain="mine")), "it has the operator 'Mine'"),
        (change_nodes(helper.make_node("Tanh", ["observation"], ["x"])), "its layers are no chain"),
        (put("weight_0", np.full((8, 47), np.nan, np.float32)), "'weight_0' has numbers that are not finite"),
        (put("bias_1", np.full(11, np.inf, np.float32)), "'bias_1' has numbers that are not finite"),
        (put("bias_0", np.zeros(8)), "'bias_0' holds neither float32 nor int64 numbers"),
        (huge, "its tensor 'weight_0' has more than 8,000,000 elements"),
        (whole_numbers_in, "its input must be one float32 array"),
        (for_one_robot_only, "its input must be one float32 array"),
        (two_inputs, "its input must be one float32 array"),
        (scaled, "the operator 'Gemm' has settings that no policy has"),
        (other_names, "a layer has not just a weight and a bias of its own"),
    ],
)
def test_a_network_that_no_training_of_ours_writes_is_refused(
    change: Callable[[onnx.GraphProto], None], message: str, model: onnx.ModelProto
) -> None:
    change(model.graph)
    assert message in refusal(model)


def test_functions_and_metadata_that_two_readers_could_read_differently_are_refused(model: onnx.ModelProto) -> None:
    model.metadata_props.append(onnx.StringStringEntryProto(key="surefoot", value="{}"))
    assert "a key stands in its metadata twice" in refusal(model)
    del model.metadata_props[1:]
    model.functions.append(onnx.FunctionProto(name="Tanh", domain=""))
    assert "it has functions, training code or sparse tensors of its own" in refusal(model)


@pytest.mark.parametrize(
    ("training", "message"),
    [
        ([1], "training must be a table, not"),
        ({"algorithm": 3}, "training: algorithm must be a text, not 3"),
        ({"minutes": "long"}, "training: minutes must be a number, not long"),
        ({"after": {"after": {"seed": None}}}, "training: seed must be a whole number, not None"),
    ],
)
def test_a_training_record_that_others_could_not_read_is_refused(
    training: object, message: str, model: onnx.ModelProto, contract: Contract
) -> None:
    values = dataclasses.asdict(contract) | {"training": training}
    helper.set_model_props(model, {"surefoot": json.dumps(values)})
    assert message in refusal(model)


def test_a_list_of_operators_may_be_longer_but_never_holds_those_with_code_of_their_own(model: onnx.ModelProto) -> None:
    model.graph.node.append(helper.make_node("Relu", ["action"], ["x"]))
    read_model(model.SerializeToString(), "theirs", (*OWN_OPERATORS, "Relu"))
    model.graph.node.append(a_loop())
    with pytest.raises(UserError, match="'body' of an operator is no plain number or text"):
        read_model(model.SerializeToString(), "theirs", (*OWN_OPERATORS, "Relu", "Loop"))


def test_what_is_no_regular_file_of_a_policys_size_is_not_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.onnx")
    with pytest.raises(UserError, match="it is a device or a pipe"):
        load_policy(tmp_path / "pipe.onnx")
    with pytest.raises(UserError, match="it is a device or a pipe"):
        load_policy("/dev/zero")
    with (tmp_path / "large.onnx").open("wb") as stream:
        stream.truncate(10**10)
    with pytest.raises(UserError, match="it has 10,000,000,000 bytes, more than 64,000,000"):
        load_policy(tmp_path / "large.onnx")
    with pytest.raises(UserError, match="must be a path without NUL characters"):
        load_policy("a\0.onnx")


# Networks of other people's.


def foreign(folder: Path, *nodes: onnx.NodeProto, outside: str = "", size: int = 4) -> Path:
    """A linear network of `size` numbers, with more nodes behind it."""
    weights = numpy_helper.from_array(np.eye(size, dtype=np.float32), "weights")
    last = nodes[-1].output[0] if nodes else "linear"
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["obs", "weights"], ["linear"]), *nodes],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, size])],
        [helper.make_tensor_value_info(last, TensorProto.FLOAT, [1, "actions"])],
        [weights, numpy_helper.from_array(np.array(True), "true")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    if outside:
        data = numpy_helper.to_array(weights).tobytes()
        (folder / "weights.bin").write_bytes(data)
        tensor = model.graph.initializer[0]
        onnx.external_data_helper.set_external_data(tensor, outside, offset=0, length=len(data))
        tensor.ClearField("raw_data")
    (folder / "theirs.onnx").write_bytes(model.SerializeToString())
    return folder / "theirs.onnx"


def doubled(times: int) -> list[onnx.NodeProto]:
    """Nodes that put what they are given behind itself again and again."""
    names = ["linear", *(f"double_{i}" for i in range(times))]
    return [
        helper.make_node("Concat", [before, before], [after], axis=1)
        for before, after in zip(names, names[1:], strict=False)
    ]


def test_a_foreign_network_that_loops_is_refused_before_it_runs(tmp_path: Path) -> None:
    file = foreign(tmp_path, a_loop(), helper.make_node("Tanh", ["linear"], ["action"]))
    with pytest.raises(UserError, match=r"theirs\.onnx is refused: it has the operator 'Loop'; valid: Gemm, MatMul"):
        load_agent(str(file))


def test_a_foreign_network_whose_numbers_grow_without_end_is_refused(tmp_path: Path) -> None:
    # 4 numbers are 4 * 2^20 = 4,194,304 after 20 doublings and twice as many, more than 8,000,000, after 21.
    Network(foreign(tmp_path, *doubled(3), size=4))
    with pytest.raises(UserError, match="'double_20' has more than 8,000,000 elements"):
        Network(foreign(tmp_path, *doubled(21)))
    with pytest.raises(UserError, match="has more than 8,000,000 elements"):
        Network(foreign(tmp_path, *doubled(60)))


@pytest.mark.parametrize("place", ["../weights.bin", "/etc/passwd", "", "gone.bin", "theirs.onnx/x"])
def test_weights_of_a_foreign_network_lie_in_its_own_folder_or_nowhere(tmp_path: Path, place: str) -> None:
    (tmp_path / "policy").mkdir()
    (tmp_path / "weights.bin").write_bytes(np.eye(4, dtype=np.float32).tobytes())
    file = foreign(tmp_path / "policy", outside="weights.bin")
    np.testing.assert_array_equal(Network(file)(np.ones((3, 4))), np.ones((3, 4)))
    assert Network(file).files == (file, tmp_path / "policy" / "weights.bin")
    with pytest.raises(UserError, match=r"^[^\n]*(not in a file beside it|cannot read weights)"):
        Network(foreign(tmp_path / "policy", outside=place or "."))
