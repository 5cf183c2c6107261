"""Write what runtime.cpp needs of a policy file as plain text: python flatten.py POLICY.onnx FILE.txt.

Each line is a name, how many numbers follow, and the numbers. A layer's line holds its outputs, its inputs, what
follows (0 nothing, 1 tanh, 2 ReLU, 3 ELU), its weights row by row, and its biases.
"""

import json
import sys

import onnx
from onnx import numpy_helper

FOLLOWS = {"Tanh": 1, "Relu": 2, "Elu": 3}


def lines_of(model):
    """The lines of a file."""
    metadata = {pair.key: pair.value for pair in model.metadata_props}
    if "surefoot_terms" not in metadata:
        sys.exit("the policy has no terms; surefoot export POLICY --onnx FILE writes a file with them")
    contract, terms = json.loads(metadata["surefoot"]), json.loads(metadata["surefoot_terms"])
    values = {
        "past": [contract.get("past_observations", 0), contract.get("past_actions", 0)],
        "ticks": [terms["loop"]["target_ticks"]],
        "filter": [contract["filter_cutoff_hz"], contract["control_hz"]],
        "action_scale": [contract["action_scale"]],
        "lower": [joint["lower"] for joint in terms["joints"]],
        "upper": [joint["upper"] for joint in terms["joints"]],
        "stall": [terms["motors"]["stall_torque_ratio"]],
        "foot_force": [terms["units"]["foot_force"]],
    }
    for name in ("nominal_pose", "stiffness", "damping", "torque_limit", "velocity_limit"):
        values[name] = contract[name]
    tensors = {tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer}
    kinds = [node.op_type for node in model.graph.node if node.op_type != "Identity"]
    number = 0
    for place, kind in enumerate(kinds):
        if kind == "Gemm":
            weight, bias = tensors[f"weight_{number}"], tensors[f"bias_{number}"]
            follows = FOLLOWS.get(kinds[place + 1], 0) if place + 1 < len(kinds) else 0
            values[f"layer_{number}"] = [*weight.shape, follows, *weight.ravel().tolist(), *bias.tolist()]
            number += 1
    return [f"{name} {len(numbers)} " + " ".join(map(repr, map(float, numbers))) for name, numbers in values.items()]


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python flatten.py POLICY.onnx FILE.txt")
    with open(sys.argv[2], "w") as stream:
        stream.write("\n".join(lines_of(onnx.load(sys.argv[1]))) + "\n")
