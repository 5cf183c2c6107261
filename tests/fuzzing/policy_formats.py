"""Policies, ours and foreign ones: a whole file of each, damaged, loaded, and asked for actions."""

from __future__ import annotations

import functools
import json
import random
from pathlib import Path

import numpy as np
import onnx

from fuzzing.mutations import damaged_bytes, damaged_text, damaged_value
from surefoot.agents.foreign.load import is_foreign, load_foreign
from surefoot.agents.load import usual_robot
from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import METADATA_KEY, network_bytes
from surefoot.errors import UserError
from surefoot.robots import load_robot
from surefoot.task.contract import Contract
from surefoot.task.control_loop import ControlLoop

TIPTOE = Path(__file__).parents[1] / "robots" / "tiptoe"


@functools.cache
def a_policy() -> bytes:
    rng = np.random.default_rng(0)
    layers = [(0.1 * rng.normal(size=(o, i)), np.zeros(o)) for i, o in ((47, 8), (8, 11))]
    contract = Contract.of(usual_robot(), "bent", 0.5, {"algorithm": "ppo", "seed": 0, "minutes": 1.5})
    return network_bytes(layers, np.zeros(47), np.ones(47), True, contract)


def policy_bytes(rng: random.Random, folder: Path) -> None:
    _run_policy(damaged_bytes(rng, a_policy()))


def policy_contract(rng: random.Random, folder: Path) -> None:
    model = onnx.load_model_from_string(a_policy())
    values = json.loads(model.metadata_props[0].value)
    onnx.helper.set_model_props(model, {METADATA_KEY: json.dumps(damaged_value(rng, values))})
    _run_policy(model.SerializeToString())


def _run_policy(data: bytes) -> None:
    agent = NetworkAgent(data, "fuzzed")
    agent(np.zeros((2, len(agent.contract.observations))), np.arange(2))
    agent.hidden  # noqa: B018 what a warm start asks for


@functools.cache
def a_foreign_policy() -> bytes:
    """A linear network for the robot Tiptoe, with the metadata that mjlab writes."""
    robot = load_robot(TIPTOE / "tiptoe.toml")
    size = 6 + 2 * robot.num_joints
    values = {
        "joint_names": robot.joint_names,
        "joint_stiffness": robot.stiffness,
        "joint_damping": robot.damping,
        "default_joint_pos": robot.pose(),
        "observation_names": ("base_ang_vel", "projected_gravity", "joint_pos", "joint_vel"),
        "observation_terms_history_length": ("1",) * 4,
        "observation_terms_scale": ("1.0",) * 4,
        "action_scale": np.full(robot.num_joints, 0.25),
        "step_dt": (0.02,),
    }
    graph = onnx.helper.make_graph(
        [
            onnx.helper.make_node("MatMul", ["obs", "weights"], ["hidden"]),
            onnx.helper.make_node("Concat", ["hidden", "hidden"], ["twice"], axis=1),
            onnx.helper.make_node("Reshape", ["twice", "shape"], ["pairs"]),
            onnx.helper.make_node("ReduceMean", ["pairs"], ["actions"], axes=[1], keepdims=0),
        ],
        "policy",
        [onnx.helper.make_tensor_value_info("obs", onnx.TensorProto.FLOAT, [1, size])],
        [onnx.helper.make_tensor_value_info("actions", onnx.TensorProto.FLOAT, [1, robot.num_joints])],
        [
            onnx.numpy_helper.from_array(np.full((size, robot.num_joints), 0.01, np.float32), "weights"),
            onnx.numpy_helper.from_array(np.array([-1, 2, robot.num_joints]), "shape"),
        ],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9)
    onnx.helper.set_model_props(model, {key: ",".join(map(str, value)) for key, value in values.items()})
    return model.SerializeToString()


def foreign_bytes(rng: random.Random, folder: Path) -> None:
    _run_foreign(damaged_bytes(rng, a_foreign_policy()), folder)


def foreign_metadata(rng: random.Random, folder: Path) -> None:
    model = onnx.load_model_from_string(a_foreign_policy())
    values = {pair.key: pair.value.split(",") for pair in model.metadata_props}
    said = damaged_value(rng, values)
    props = said if isinstance(said, dict) else {"said": said}
    texts = {key: ",".join(map(str, value)) if isinstance(value, list) else str(value) for key, value in props.items()}
    texts = {key: text.encode("utf-8", "replace").decode()[:20_000] for key, text in texts.items()}
    onnx.helper.set_model_props(model, texts)
    _run_foreign(model.SerializeToString(), folder)


def deploy_yaml(rng: random.Random, folder: Path) -> None:
    model = onnx.load_model_from_string(a_foreign_policy())
    del model.metadata_props[:]
    robot = load_robot(TIPTOE / "tiptoe.toml")
    plain = {"scale": [1.0], "clip": None, "history_length": 1, "params": {}}
    values = {
        "joint_ids_map": list(range(robot.num_joints)),
        "step_dt": 0.02,
        "stiffness": robot.stiffness.tolist(),
        "damping": robot.damping.tolist(),
        "default_joint_pos": robot.pose().tolist(),
        "actions": {"JointPositionAction": {"scale": [0.25] * robot.num_joints, "clip": None, "offset": None}},
        "observations": dict.fromkeys(("base_ang_vel", "projected_gravity", "joint_pos_rel", "joint_vel_rel"), plain),
    }
    text = json.dumps(damaged_value(rng, values))  # JSON is YAML
    (folder / "deploy.yaml").write_text(damaged_text(rng, text) if rng.random() < 0.5 else text)
    _run_foreign(model.SerializeToString(), folder)


def _run_foreign(data: bytes, folder: Path) -> None:
    """Load a foreign policy, and let it decide one control step of two robots."""
    (folder / "theirs.onnx").write_bytes(data)
    robot = load_robot(TIPTOE / "tiptoe.toml")
    if not is_foreign(str(folder / "theirs.onnx")):
        raise UserError("not a foreign policy")
    agent = load_foreign(str(folder / "theirs.onnx"), robot)
    loop = ControlLoop(robot, 2, np.array(agent.contract.nominal_pose), num_threads=1)
    loop.prepare(agent)
    loop.drive()
