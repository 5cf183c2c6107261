"""What an agent may ask the control loop for beside its rate: gains of its own, targets beyond the joint ranges."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import driven_loop, hold, stand, step_to

from surefoot.agents.controllers.controller import Command, ControllerAgent, State
from surefoot.agents.nominal import NominalAgent
from surefoot.robots import Robot
from surefoot.robots.model import DAMPING_COLUMN, STIFFNESS_COLUMN


def wishing(robot: Robot, target: np.ndarray, torque: float = 0.0, **wishes: object) -> ControllerAgent:
    """A controller that always answers the same, and wants what is named."""

    class Wishing:
        rate_hz = 50

        def __init__(self, robot: Robot, num_robots: int):
            vars(self).update(wishes)

        def reset(self, ids: np.ndarray) -> None:
            pass

        def __call__(self, state: State, ids: np.ndarray) -> Command:
            return Command(np.tile(target, (len(ids), 1)), np.full((len(ids), len(target)), torque))

    return ControllerAgent("wishing", Wishing, "0" * 64, robot)


def soft(robot: Robot) -> dict[str, np.ndarray]:
    return {"stiffness": 0.2 * robot.stiffness, "damping": 0.5 * robot.damping}


def test_the_joints_follow_the_gains_that_the_agent_names(robot: Robot) -> None:
    target = robot.pose("bent") + 0.01
    loop = driven_loop(wishing(robot, target, torque=3.0, **soft(robot)))
    loop.reset(np.array([0]), robot.pose("bent")[None], height=1.0)
    ticks = loop.drive()
    # u = 0.2 stiffness (q_target - q) + 3 Nm - 0.5 damping dq/dt; at first from rest 0.2 stiffness * 0.01 rad + 3 Nm.
    np.testing.assert_allclose(ticks.joint_torque[0, 0], 0.002 * robot.stiffness + 3.0, rtol=1e-9)
    q, v = ticks.joint_position[0], ticks.joint_velocity[0]
    expected = 0.2 * robot.stiffness * (target - q) + 3.0 - 0.5 * robot.damping * v
    np.testing.assert_allclose(ticks.joint_torque[0], expected, atol=1e-6)


def test_a_robot_with_an_agents_gains_moves_as_one_that_is_built_with_them(robot: Robot) -> None:
    engine, built = stand(robot, 1, height=0.01), stand(robot, 1, height=0.01)
    gains = soft(robot)
    engine.set_gains(**gains)
    motors = built.batch.expand("actuator_gainprm").reshape(-1, 10)
    np.testing.assert_array_equal(motors[:, STIFFNESS_COLUMN], robot.stiffness)
    motors[:, STIFFNESS_COLUMN], motors[:, DAMPING_COLUMN] = gains["stiffness"], gains["damping"]
    for _ in range(5):
        ours, theirs = (step_to(each, hold(robot, 1)).record.copy() for each in (engine, built))
        np.testing.assert_array_equal(ours, theirs)


def test_the_robots_own_gains_are_back_for_the_next_agent(robot: Robot) -> None:
    def motion(loop) -> np.ndarray:
        loop.reset(np.array([0]), robot.pose("bent")[None], height=0.01)
        return np.concatenate([loop.drive().record.copy() for _ in range(3)], axis=1)

    loop = driven_loop(wishing(robot, robot.pose("bent"), **soft(robot)))
    soft_motion = motion(loop)
    loop.prepare(NominalAgent(robot))
    stiff_motion = motion(loop)
    np.testing.assert_array_equal(stiff_motion, motion(driven_loop(NominalAgent(robot))))
    assert np.abs(stiff_motion - soft_motion).max() > 0.01


@pytest.mark.parametrize("clips", [True, False])
def test_targets_beyond_the_joint_ranges_pass_only_if_the_agent_says_so(robot: Robot, clips: bool) -> None:
    knee = robot.joint_names.index("left_knee_pitch")
    target = robot.pose("bent")
    target = np.where(np.arange(robot.num_joints) == knee, robot.joint_upper + 0.05, target)
    loop = driven_loop(wishing(robot, target, clips_targets=clips, stiffness=np.full(robot.num_joints, 50.0)))
    loop.reset(np.array([0]), robot.pose("bent")[None], height=1.0)
    ticks = loop.drive()
    # From rest: 50 Nm/rad times the way to the end of the range, and 50 * 0.05 = 2.5 Nm more for what lies beyond it.
    way = robot.joint_upper[knee] - robot.pose("bent")[knee]
    assert ticks.joint_torque[0, 0, knee] == pytest.approx(50.0 * way + (0.0 if clips else 2.5), rel=1e-9)


def test_the_motors_limits_hold_whatever_gains_and_targets_are_asked_for(robot: Robot) -> None:
    far = robot.joint_upper + 50.0
    loop = driven_loop(wishing(robot, far, clips_targets=False, stiffness=1e4 * np.ones(robot.num_joints)))
    loop.reset(np.array([0]), robot.pose("bent")[None], height=1.0)
    share = np.abs(loop.drive().joint_torque[0]) / robot.torque_limit
    assert share.max() == pytest.approx(1.0, abs=1e-9)


def test_the_gyroscope_and_gravity_are_what_a_sensor_on_the_root_reads(robot: Robot) -> None:
    seen: list[State] = []

    class Watching:
        rate_hz = 500

        def __init__(self, robot: Robot, num_robots: int):
            self.target = robot.pose("bent")

        def reset(self, ids: np.ndarray) -> None:
            pass

        def __call__(self, state: State, ids: np.ndarray) -> Command:
            seen.append(state)
            return Command(self.target[None])

    loop = driven_loop(ControllerAgent("watching", Watching, "0" * 64, robot))
    loop.reset(np.array([0]), robot.pose("bent")[None], height=1.0, roll=0.3, pitch=-0.4, yaw=2.0)
    loop.pushes.schedule(np.array([0]), 0, robot.body_id("torso"), np.array([30.0, 20.0, 0.0]), 0, 0.12)
    loop.drive()
    for _ in range(4):
        ticks = loop.drive()
    w, x, y, z = ticks["root_orientation"][0, -2]
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    # The last control step is decided on the tick before the last. Rows of the rotation are the world's axes seen from
    # the root: down is minus the third of them, and the angular velocity is R^T omega.
    np.testing.assert_allclose(seen[-1].gravity_direction[0], -rotation[2], atol=1e-9)
    omega = ticks["root_angular_velocity"][0, -2]
    np.testing.assert_allclose(seen[-1].gyroscope[0], rotation.T @ omega, atol=1e-9)
    assert np.linalg.norm(omega) > 0.1
