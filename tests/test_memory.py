"""Policies with a memory: what they are given of the past, and what their files say of it."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import onnx
import pytest

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import network_bytes
from surefoot.errors import UserError
from surefoot.robots import Robot
from surefoot.task.contract import Contract
from surefoot.task.control_loop import ControlLoop
from surefoot.task.memory import Memory


def remembering(robot: Robot, past_observations: int, past_actions: int, weights: dict[int, float]) -> bytes:
    """A linear policy file: every action is the sum of some inputs, by their places, times weights."""
    contract = Contract.of(robot, "bent", 0.5, {}, past_observations, past_actions)
    matrix = np.zeros((robot.num_joints, contract.num_inputs))
    for place, weight in weights.items():
        matrix[:, place] = weight
    nothing, ones = np.zeros(contract.num_inputs), np.ones(contract.num_inputs)
    return network_bytes([(matrix, np.zeros(robot.num_joints))], nothing, ones, False, contract)


def refusal(data: bytes) -> str:
    with pytest.raises(UserError) as error:
        NetworkAgent(data, "mine")
    return str(error.value)


def test_the_past_comes_newest_first_and_begins_with_the_first_observation() -> None:
    memory = Memory(past_observations=2, past_actions=2, observation_size=1, action_size=1)
    memory.prepare(1)
    robot, seen = np.array([0]), []
    for observation, action in ((1.0, 0.1), (2.0, 0.2), (3.0, 0.3), (4.0, 7.0), (5.0, 0.5)):
        now = np.array([[observation]])
        seen.append(memory.inputs(now, robot)[0].tolist())
        memory.add(now, np.array([[action]]), robot)
    # Present observation, two past ones, two past actions; the action of 7 was clipped to 1.
    assert seen == [
        [1.0, 1.0, 1.0, 0.0, 0.0],
        [2.0, 1.0, 1.0, 0.1, 0.0],
        [3.0, 2.0, 1.0, 0.2, 0.1],
        [4.0, 3.0, 2.0, 0.3, 0.2],
        [5.0, 4.0, 3.0, 1.0, 0.3],
    ]


def test_a_robot_that_begins_anew_is_forgotten_and_the_others_are_not() -> None:
    memory = Memory(1, 1, 1, 1)
    memory.prepare(3)
    both = np.array([0, 2])
    memory.inputs(np.array([[1.0], [2.0]]), both)
    memory.add(np.array([[1.0], [2.0]]), np.array([[0.1], [0.2]]), both)
    memory.reset(np.array([2]))
    np.testing.assert_array_equal(memory.inputs(np.array([[5.0], [6.0]]), both), [[5.0, 1.0, 0.1], [6.0, 6.0, 0.0]])


def test_a_policy_file_with_a_memory_acts_on_its_own_past(robot: Robot) -> None:
    # Inputs: 47 observations, 47 of the step before, 11 actions of the step before. Each action is
    # 0.1 x first observation + 0.2 x first observation before + 0.5 x first action before.
    agent = NetworkAgent(remembering(robot, 1, 1, {0: 0.1, 47: 0.2, 94: 0.5}), "mine")
    agent.prepare(1)
    nominal, found = np.array(agent.contract.nominal_pose), []
    for value in (1.0, 2.0, 0.0, 0.0):
        observation = np.zeros((1, 47))
        observation[0, 0] = value
        found.append(((agent(observation, np.array([0])).joint_target[0] - nominal) / 0.5)[0])
    # 0.1 + 0.2 = 0.3; 0.2 + 0.2 + 0.15 = 0.55; 0 + 0.4 + 0.275 = 0.675; 0.3375
    np.testing.assert_allclose(found, [0.3, 0.55, 0.675, 0.3375], atol=1e-6)


def test_a_trial_does_not_depend_on_what_an_agent_with_a_memory_did_before(robot: Robot) -> None:
    agent = NetworkAgent(remembering(robot, 2, 1, {0: 0.5, 47: -0.4, 94: 0.2, 141: 0.3}), "mine")
    loop = ControlLoop(robot, 2, robot.pose("bent"), num_threads=1)
    loop.prepare(agent)
    start = np.tile(robot.pose("bent"), (2, 1))

    def joints() -> np.ndarray:
        loop.reset(np.arange(2), start)
        return np.array([loop.drive().joint_position[:, -1].copy() for _ in range(5)])

    first = joints()
    np.testing.assert_array_equal(joints(), first)
    assert np.abs(first[-1] - first[0]).max() > 1e-3


def test_the_contract_says_how_much_of_the_past_a_policy_takes(robot: Robot) -> None:
    contract = NetworkAgent(remembering(robot, 7, 8, {}), "mine").contract
    # 47 + 7 x 47 + 8 x 11
    assert (contract.past_observations, contract.past_actions, contract.format, contract.num_inputs) == (7, 8, 2, 464)
    assert Contract.from_json(contract.to_json()) == contract


def test_a_contract_without_a_memory_is_written_as_before(robot: Robot) -> None:
    text = Contract.of(robot, "bent", 0.5).to_json()
    assert json.loads(text)["format"] == 1
    assert "past" not in text
    assert Contract.from_json(text).num_inputs == 47


@pytest.mark.parametrize("number", [-1, 1.0, True, "2", None, 10**9])
def test_a_past_of_a_wrong_size_is_the_users_error(robot: Robot, number: object) -> None:
    data = remembering(robot, 1, 0, {})
    model = onnx.load_model_from_string(data)
    values = dataclasses.asdict(NetworkAgent(data, "mine").contract) | {"past_observations": number}
    onnx.helper.set_model_props(model, {"surefoot": json.dumps(values)})
    assert "past_observations must be a whole number from 0 to 250" in refusal(model.SerializeToString())


def test_a_network_that_takes_another_past_than_its_contract_says_is_refused(robot: Robot) -> None:
    model = onnx.load_model_from_string(remembering(robot, 1, 0, {}))
    contract = Contract.of(robot, "bent", 0.5, {}, 2, 0)
    onnx.helper.set_model_props(model, {"surefoot": contract.to_json()})
    # 47 + 47 inputs, where the contract has 47 + 94
    assert "not [141] to [11]" in refusal(model.SerializeToString())
