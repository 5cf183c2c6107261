"""Policy files: one ONNX network whose metadata holds its contract and the contract's terms for other runtimes."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from surefoot.robots import load_robot
from surefoot.task.contract import Contract
from surefoot.task.terms import terms

if TYPE_CHECKING:
    from onnx import GraphProto, ModelProto

SUFFIX = ".onnx"
ACTIVATIONS = {"tanh": "Tanh", "relu": "Relu", "elu": "Elu"}
"""Activations between the layers of a policy: name and ONNX operator."""
METADATA_KEY = "surefoot"
"""Of a policy file's metadata, under which its contract stands."""
TERMS_KEY = "surefoot_terms"
"""Under which the contract's terms stand; files of before there were any have none."""


def network_bytes(
    layers: list[tuple[np.ndarray, np.ndarray]],
    mean: np.ndarray,
    std: np.ndarray,
    squash: bool,
    contract: Contract,
    activation: str = "tanh",
) -> bytes:
    """A policy file: (inputs - mean) / std through a network of linear layers.

    Args:
        layers: (weight (out, in), bias (out,)) of every linear layer.
        mean: of the network's inputs (num_inputs,).
        std: of the network's inputs (num_inputs,).
        squash: tanh on the output too.
        contract: what the file says about the robot.
        activation: between the layers, a key of `ACTIVATIONS`.
    """
    import onnx
    from onnx import helper

    # The normalisation is folded into the first layer: W (x - mean) / std + b.
    first_weight, first_bias = layers[0]
    scaled = first_weight / std
    layers = [(scaled, first_bias - scaled @ mean), *layers[1:]]
    graph = _graph(layers, [*[activation] * (len(layers) - 1), "tanh" if squash else None])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    _set_contract(model, contract)
    onnx.checker.check_model(model)
    return model.SerializeToString()


def _graph(layers: list[tuple[np.ndarray, np.ndarray]], activations: list[str | None]) -> GraphProto:
    """A chain of linear layers, each with the activation that follows it."""
    from onnx import TensorProto, helper, numpy_helper

    nodes, tensors, value = [], [], "observation"
    for i, ((weight, bias), activation) in enumerate(zip(layers, activations, strict=True)):
        tensors.append(numpy_helper.from_array(weight.astype(np.float32), f"weight_{i}"))
        tensors.append(numpy_helper.from_array(bias.astype(np.float32), f"bias_{i}"))
        nodes.append(helper.make_node("Gemm", [value, f"weight_{i}", f"bias_{i}"], [f"linear_{i}"], transB=1))
        value = f"linear_{i}"
        if activation:
            nodes.append(helper.make_node(ACTIVATIONS[activation], [value], [f"{activation}_{i}"]))
            value = f"{activation}_{i}"
    nodes.append(helper.make_node("Identity", [value], ["action"]))
    return helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["robots", layers[0][0].shape[1]])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["robots", layers[-1][0].shape[0]])],
        tensors,
    )


def with_record(data: bytes, **entries: Any) -> bytes:
    """A policy file with further entries in its training record."""
    import onnx

    model = onnx.load_model_from_string(data)
    contract = _contract_in(model)
    _set_contract(model, dataclasses.replace(contract, training=contract.training | entries))
    return model.SerializeToString()


def with_terms(data: bytes) -> bytes:
    """A policy file with the terms of its contract as this version of surefoot writes them; its network is the same.

    Raises:
        UserError: the policy is for a robot that is not there.
    """
    import onnx

    model = onnx.load_model_from_string(data)
    _set_contract(model, _contract_in(model))
    return model.SerializeToString()


def _contract_in(model: ModelProto) -> Contract:
    (text,) = [pair.value for pair in model.metadata_props if pair.key == METADATA_KEY]
    return Contract.from_json(text)


def _set_contract(model: ModelProto, contract: Contract) -> None:
    """Write a contract and its terms into a model's metadata, in place of what stands there."""
    import onnx

    found = json.dumps(terms(load_robot(contract.robot), contract))
    del model.metadata_props[:]
    onnx.helper.set_model_props(model, {METADATA_KEY: contract.to_json(), TERMS_KEY: found})


def mean_bytes(policies: Sequence[bytes], **entries: Any) -> bytes:
    """A policy file whose weights are the mean of several's, else like the last one.

    Args:
        policies: files of one network's shape, from a single run.
        entries: for its training record.
    """
    import onnx
    from onnx import numpy_helper

    models = [onnx.load_model_from_string(data) for data in policies]
    for tensors in zip(*(model.graph.initializer for model in models), strict=True):
        mean = np.mean([numpy_helper.to_array(tensor) for tensor in tensors], axis=0)
        tensors[-1].CopyFrom(numpy_helper.from_array(mean, tensors[-1].name))
    return with_record(models[-1].SerializeToString(), mean_of=len(models), **entries)
