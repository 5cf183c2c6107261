"""Is it the policy or the adapter? What `surefoot agent check` finds out on the second robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import TIPTOE
from rich.console import Console
from test_foreign import as_mjlab_writes, write_network

from surefoot.agents.load import load_agent
from surefoot.agents.nominal import NominalAgent
from surefoot.cli.agent import print_agent, print_check, verdict
from surefoot.evaluation.agent_check import AgentCheck, check_agent_by_driving
from surefoot.robots import Robot, load_robot
from surefoot.task.agent import Agent

SECONDS = 5.0
NAMES = "base_ang_vel,projected_gravity,joint_pos"


@pytest.fixture(scope="module")
def tiptoe() -> Robot:
    return load_robot(TIPTOE)


def balancing(file: Path, robot: Robot, names: list[str]) -> Agent:
    """A policy that holds the default pose and turns the ankles against a tilt; its joints are named by `names`."""
    order = robot.breadth_first
    weights = np.zeros((robot.num_joints, 6 + robot.num_joints))
    for row, joint in enumerate(order):
        if robot.joint_names[joint].startswith("ankle_pitch"):
            weights[row, 1], weights[row, 3] = 0.02, 0.2  # turning forward, and the way down seen from the root
    metadata = as_mjlab_writes(
        robot,
        order,
        joint_names=",".join(names),
        joint_stiffness=",".join(f"{value:.3f}" for value in robot.stiffness[order]),
        joint_damping=",".join(f"{value:.3f}" for value in robot.damping[order]),
        observation_names=NAMES,
        action_scale="1.0",
    )
    return load_agent(str(write_network(file, weights, metadata)), robot)


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory, tiptoe: Robot) -> tuple[Agent, AgentCheck]:
    names = [tiptoe.joint_names[joint] for joint in tiptoe.breadth_first]
    agent = balancing(tmp_path_factory.mktemp("right") / "policy.onnx", tiptoe, names)
    return agent, check_agent_by_driving(agent, SECONDS, num_threads=1)


def test_a_policy_that_stands_falls_with_its_joints_in_another_order(right: tuple[Agent, AgentCheck]) -> None:
    _, found = right
    assert found.stands
    stood = {result.way.name: result.num_stood for result in found.wrong}
    assert stood["joints breadth first, as Isaac Lab counts"] == 0
    assert stood["joints depth first, if they are breadth first"] == 0
    assert not found.better_ways


def test_what_it_was_given_and_what_it_reacts_to_is_told(right: tuple[Agent, AgentCheck]) -> None:
    agent, found = right
    assert list(found.ranges) == NAMES.split(",")
    down = found.ranges["projected_gravity"]
    assert (down.low, down.high) == (pytest.approx(-1.0, abs=0.01), pytest.approx(0.0, abs=0.15))
    reacts = {name for name, moved in found.reactions.items() if moved > 1e-9}
    assert reacts == {"gyroscope", "gravity_direction"}
    # A change of 0.05 of the way down turns both ankles of 13 joints by 0.2 * 0.05 rad: the root mean square is
    # 0.01 * sqrt(2 / 13).
    assert found.reactions["gravity_direction"] == pytest.approx(0.01 * np.sqrt(2 / 13), rel=1e-4)
    assert found.target_error.shape == (agent.robot.num_joints,)
    assert found.target_error.max() < 0.2


def test_a_policy_whose_joints_are_named_in_the_wrong_order_is_told_from_a_bad_one(
    tmp_path: Path, tiptoe: Robot
) -> None:
    agent = balancing(tmp_path / "policy.onnx", tiptoe, list(tiptoe.joint_names))
    found = check_agent_by_driving(agent, SECONDS, num_threads=1)
    assert not found.stands
    assert found.better_ways[0].way.name == "joints breadth first, as Isaac Lab counts, gains and pose too"
    assert verdict(agent, found)[-1] == (
        "It is the adapter: 4 of 4 stand with joints breadth first, as Isaac Lab counts, gains and pose too."
    )


def test_an_agent_that_is_given_observations_is_checked_too(tiptoe: Robot) -> None:
    found = check_agent_by_driving(NominalAgent(tiptoe), SECONDS, num_threads=1)
    assert found.stands
    assert not found.commands
    assert set(found.reactions.values()) == {0.0}
    assert "joint_position" in found.ranges


def test_the_tables_say_what_was_found(right: tuple[Agent, AgentCheck]) -> None:
    output = Console(record=True, width=140, file=None, quiet=False)
    with output.capture() as text:
        print_agent(right[0], output)
        print_check(*right, output)
    for words in ("50 Hz", "as given", "4 of 4", "projected_gravity", "gyroscope", "The adapter is right"):
        assert words in text.get()
