"""One way to drive whoever acts: networks and controllers move robots alike, and fail alike."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest
from conftest import TIPTOE, driven_loop, pushed

from surefoot.agents.controllers import controller_digest, load_controller, shipped_controllers
from surefoot.agents.controllers.body import Body, Legs
from surefoot.agents.controllers.controller import ControllerAgent
from surefoot.agents.load import load_agent, load_policy, usual_robot
from surefoot.agents.network import NetworkAgent
from surefoot.agents.nominal import NominalAgent
from surefoot.agents.policy_file import network_bytes
from surefoot.errors import UserError
from surefoot.evaluation.trials import run_list
from surefoot.physics.step_record import StepRecord
from surefoot.robots import Robot, load_robot
from surefoot.task import observation
from surefoot.task.agent import Command, Inputs
from surefoot.task.contract import Contract
from surefoot.task.control_loop import ControlLoop
from surefoot.task.imperfections import Imperfections


class Sick(NominalAgent):
    """Holds the pose, but fails in a way of its own from its third control step on, and wants what it is told to."""

    def __init__(self, robot: Robot, how: str, inputs: Inputs, rate_hz: int, sick: int = 1):
        super().__init__(robot)
        self.how, self.sick, self.inputs = how, sick, inputs
        self.contract = dataclasses.replace(self.contract, policy_hz=rate_hz)
        self.num_calls = 0

    def __call__(self, inputs: object, ids: np.ndarray) -> Command:
        self.num_calls += 1
        command = super().__call__(inputs, ids)
        if self.num_calls < 3 or self.sick not in ids:
            return command
        if self.how == "raised":
            raise ZeroDivisionError("no feet")
        if self.how == "too late":
            time.sleep(0.2)
        if self.how == "not finite":
            command.joint_target[ids == self.sick, 4] = np.nan
        return Command(command.joint_target[:, :-1]) if self.how == "wrong shape" else command


def standing_network(robot: Robot) -> NetworkAgent:
    """A network whose actions are zero, which mean the robot's default pose."""
    num_observations = len(observation.component_names(robot))
    layers = [(np.zeros((robot.num_joints, num_observations)), np.zeros(robot.num_joints))]
    contract = Contract.of(robot, robot.default_pose, 1.0)
    return NetworkAgent(
        network_bytes(layers, np.zeros(num_observations), np.ones(num_observations), False, contract), "standing"
    )


def standing_controller(robot: Robot, rate_hz: int, path: str = "hold") -> ControllerAgent:
    """A controller that answers the default pose at its rate."""

    class Standing:
        def __init__(self, robot: Robot, num_robots: int):
            self.pose = robot.pose()

        def reset(self, ids: np.ndarray) -> None:
            pass

        def __call__(self, state: object, ids: np.ndarray) -> Command:
            return Command(np.tile(self.pose, (len(ids), 1)))

    Standing.rate_hz, Standing.path = rate_hz, path  # type: ignore[attr-defined]
    return ControllerAgent("standing", Standing, "0" * 64, robot)


def motion(loop: ControlLoop, num_steps: int = 10, ids: np.ndarray | None = None) -> np.ndarray:
    """The record of some policy steps of robots that are pushed, (num_robots, num_ticks, ...)."""
    everyone = np.arange(loop.engine.num_robots)
    loop.pushes.schedule(everyone, 1, loop.robot.body_id("torso"), np.array([20.0, 5.0, 0.0]), 33, 0.12)
    return StepRecord.join([loop.drive(ids).copy() for _ in range(num_steps)]).record


# Driving.


@pytest.mark.parametrize("rate_hz", [25, 100, 250, 500])
@pytest.mark.parametrize("path", ["cubic", "line", "hold"])
def test_a_network_and_a_controller_that_hold_the_same_pose_move_a_robot_alike(
    robot: Robot, rate_hz: int, path: str
) -> None:
    network = motion(driven_loop(standing_network(robot), 2))
    controller = motion(driven_loop(standing_controller(robot, rate_hz, path), 2))
    np.testing.assert_array_equal(controller, network)
    assert np.ptp(network, axis=1).any()


def test_robots_that_are_driven_apart_move_as_those_that_are_driven_together(robot: Robot) -> None:
    for agent in (load_policy("trpo"), load_agent("controllers/ankle")):
        together, apart = motion(driven_loop(agent, 3), 5), driven_loop(agent, 3)
        some = motion(apart, 5, np.array([0, 2]))
        np.testing.assert_allclose(some, together[[0, 2]], atol=1e-6)
        assert apart.tick.tolist() == [100, 0, 100]


def test_a_network_may_decide_more_often_than_at_25_hz(robot: Robot) -> None:
    agent = Sick(robot, "", "observation", 100)
    loop = driven_loop(agent)
    loop.set_imperfections(0, Imperfections(observation_noise=0.1, latency=0.01), seed=0)
    moved = motion(loop, 3)
    assert agent.num_calls == 12
    assert moved.shape[1] == 60


def test_another_agent_takes_over_in_the_middle_with_inputs_of_its_own(robot: Robot) -> None:
    loop = driven_loop(NominalAgent(robot))
    loop.drive()
    loop.prepare(load_agent("controllers/ankle"))
    for _ in range(3):
        ticks = loop.drive()
    assert not loop.failed
    loop.prepare(NominalAgent(robot))
    # The observation begins with what is measured now.
    np.testing.assert_allclose(loop.observation[0, :11], ticks.joint_position[0, -1], atol=1e-12)
    assert len(loop.drive()) == 20


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"policy_hz": 60}, "nominal-bent must have a rate_hz of 25, 50, 100, 125, 250, 500, not 60"),
        ({"target_path": "zigzag"}, "nominal-bent's path must be cubic or line or hold, not zigzag"),
    ],
)
def test_an_agent_with_wishes_that_the_loop_cannot_meet_is_refused(robot: Robot, change: dict, message: str) -> None:
    agent = NominalAgent(robot)
    agent.contract = dataclasses.replace(agent.contract, **change)
    with pytest.raises(UserError) as error:
        driven_loop(agent)
    assert str(error.value) == message


@pytest.mark.parametrize("name", ["nominal", *shipped_controllers()])
def test_every_controller_stands_on_a_robot_that_it_was_not_made_for(name: str) -> None:
    tiptoe = load_robot(TIPTOE)
    agent = load_agent(name, tiptoe)
    # 0.02 Ns/kg: a push that moves the CoM by 2 cm/s.
    trial = dataclasses.replace(pushed(0.02 * tiptoe.mass, 0), horizon=2.0, quiet_from=1.0)
    outcome = run_list(agent, [trial], num_slots=1, num_threads=1)[trial]
    assert (outcome.reason, agent.failures) == ("recovered", {})


def test_the_lengths_of_the_legs_are_measured_on_the_model(robot: Robot) -> None:
    legs = Legs.of(robot)
    # valkyrie.xml: hip pitch 0.1853 + 0.0609 below the root, in the plane of the ankle at 0.1377; the sole's centre is
    # 0.045 ahead of the ankle and 0.088 below it; 0.98 of the 0.8381 from hip to ankle.
    np.testing.assert_allclose(legs.hips, [[0.0, 0.1377, -0.2462], [0.0, -0.1377, -0.2462]])
    np.testing.assert_allclose(legs.ankles, [[-0.045, 0.0, 0.088]] * 2)
    assert legs.reach == 0.82
    assert Body(robot, 1).torso_joint == robot.joint_names.index("torso_pitch")
    tiptoe = load_robot(TIPTOE)
    assert Body(tiptoe, 1).torso_joint is None  # its waist only yaws


# Failing.


@pytest.mark.parametrize(("inputs", "rate_hz"), [("observation", 25), ("state", 100)])
@pytest.mark.parametrize("how", ["raised", "not finite", "wrong shape", "too late"])
def test_an_agent_that_fails_is_named_by_how_and_its_robots_hold_their_last_targets(
    robot: Robot, inputs: Inputs, rate_hz: int, how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("surefoot.task.guard.PATIENCE_S", 0.005)  # 0.1 s a call
    agent = Sick(robot, how, inputs, rate_hz)
    loop = driven_loop(agent, 3)
    steps = [loop.drive().copy() for _ in range(4)]
    # A wrong shape and a call without end concern all the robots of the call.
    alone = how in ("raised", "not finite")
    assert loop.failed == ({1: how} if alone else dict.fromkeys(range(3), how))
    assert sum(agent.failures.values()) == len(loop.failed)
    assert loop.error == ("ZeroDivisionError: no feet" if how == "raised" else "")
    np.testing.assert_allclose(loop.engine.joint_targets[:, -1], np.tile(robot.pose(), (3, 1)))
    assert all(len(step) == 20 for step in steps)


def test_a_reset_gives_an_agent_that_failed_another_chance(robot: Robot) -> None:
    agent = Sick(robot, "not finite", "observation", 25)
    loop = driven_loop(agent, 2)
    for _ in range(3):
        loop.drive()
    assert loop.failed == {1: "not finite"}
    loop.reset(np.array([1]), robot.pose()[None])
    assert loop.failed == {}
    agent.how = ""
    loop.drive()
    assert loop.failed == {}


def test_an_agent_that_fails_one_robot_does_not_change_a_bit_of_the_others(robot: Robot) -> None:
    healthy = motion(driven_loop(Sick(robot, "", "observation", 25), 3))
    for how in ("raised", "not finite"):
        found = motion(driven_loop(Sick(robot, how, "observation", 25), 3))
        np.testing.assert_array_equal(found[[0, 2]], healthy[[0, 2]])


# Names and digests.


def test_the_robot_of_the_best_policy_is_driven_where_none_is_named(robot: Robot) -> None:
    assert usual_robot() is load_policy("best").robot is robot
    assert load_agent("nominal").robot is robot
    assert load_agent("controllers/stand").robot is robot
    assert load_agent("nominal", robot).contract.nominal_pose == tuple(robot.pose())


def test_a_policy_for_a_robot_of_the_same_name_with_other_masses_is_refused(robot: Robot) -> None:
    contract = Contract.of(robot, "bent", 1.0)
    assert contract.robot_fingerprint == robot.fingerprint
    assert dataclasses.replace(contract, robot_fingerprint="").check() is robot  # of before there were any
    with pytest.raises(UserError, match="policy is for a valkyrie with other masses, joints or motors"):
        dataclasses.replace(contract, robot_fingerprint="0" * 12).check()


CODE = "class Mine:\n    rate_hz = 50\n"


@pytest.mark.parametrize(
    ("code", "is_same"),
    [
        ("# A comment.\nclass Mine:\n\n    rate_hz = (50)\n", True),
        ('"""Doc."""\nimport numpy as np\nfrom os import path\nclass Mine:\n    """Doc."""\n    rate_hz = 50\n', True),
        ("class Mine:\n    rate_hz = 100\n", False),
        ("class Mine:\n    rate_hz = 50\n    path = 'line'\n", False),
    ],
)
def test_a_controllers_digest_is_that_of_what_its_code_does(code: str, is_same: bool) -> None:
    made = type("Mine", (), {"rate_hz": 50})
    assert (controller_digest(made, code) == controller_digest(made, CODE)) == is_same


def test_a_controllers_digest_holds_what_it_inherits_and_what_it_stands_on(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    ankle, hip = (load_controller(f"controllers/{name}", robot) for name in ("ankle", "hip"))
    before = ankle.digest, hip.digest
    assert before[0] != before[1]
    monkeypatch.setattr("surefoot.agents.controllers.FOUNDATION_VERSION", 2)
    after = tuple(load_controller(f"controllers/{name}", robot).digest for name in ("ankle", "hip"))
    assert not set(before) & set(after)
    monkeypatch.undo()
    monkeypatch.setattr("surefoot.agents.controllers._source", lambda module: "x = 1" if "ankle" in module else "")
    # `Hip` inherits from `Ankle`.
    changed = tuple(controller_digest(agent.make) for agent in (ankle, hip))
    monkeypatch.setattr("surefoot.agents.controllers._source", lambda module: "x = 2" if "ankle" in module else "")
    assert not set(changed) & {controller_digest(agent.make) for agent in (ankle, hip)}
