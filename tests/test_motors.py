"""Valkyrie's joints, measured: the impedance law, torque and speed limits."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
import pytest
from conftest import posed, step_to

from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot, load_robot

JOINTS = load_robot("valkyrie").joint_names


class Drive(NamedTuple):
    stiffness: float
    damping: float
    torque: float
    speed: float


# Gains and torques: the group's public configuration. Speeds: Table V of the paper.
DRIVES = {
    "torso_pitch": Drive(3000, 300, 150, 9.0),
    "hip_roll": Drive(1500, 150, 350, 6.11),
    "hip_pitch": Drive(2000, 180, 350, 6.11),
    "knee_pitch": Drive(2000, 120, 350, 11.0),
    "ankle_pitch": Drive(2000, 120, 205, 11.0),
    "ankle_roll": Drive(1000, 100, 205, 11.0),
}


def free_model(robot: Robot) -> mujoco.MjModel:
    """The robot floating: no gravity, no contacts, no joint ranges."""
    spec = robot.build()
    spec.compiler.discardvisual = True
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)
    return spec.compile()


def test_gains_and_limits_are_those_of_the_paper_and_its_code(robot: Robot) -> None:
    for i, name in enumerate(robot.joint_names):
        drive = Drive(robot.stiffness[i], robot.damping[i], robot.torque_limit[i], robot.velocity_limit[i])
        assert drive == pytest.approx(DRIVES[robot.joint_groups[robot.joint_names.index(name)]], rel=1e-12), name


def test_a_small_error_gives_the_impedance_law_of_the_paper(robot: Robot) -> None:
    model = robot.model()
    data = posed(robot, model)
    data.ctrl[:] = 0.01
    data.qvel[6:] = 0.05
    mujoco.mj_forward(model, data)
    for i, name in enumerate(robot.joint_names):
        drive = DRIVES[robot.joint_groups[robot.joint_names.index(name)]]
        # Equation: Kp (q_target - q) - Kd q', e.g. the knee 2000 * 0.01 - 120 * 0.05 = 14 Nm
        expected = drive.stiffness * 0.01 - drive.damping * 0.05
        assert data.actuator_force[i] == pytest.approx(expected, rel=1e-9), name


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_far_target_gives_exactly_the_torque_limit_and_never_more(robot: Robot, sign: float) -> None:
    engine = MujocoEngine(robot, robot.num_joints, num_threads=1)
    engine.reset(np.arange(robot.num_joints), np.zeros((robot.num_joints, robot.num_joints)), height=5.0)
    targets = np.zeros((robot.num_joints, TICKS_PER_STEP, robot.num_joints))
    for joint in range(robot.num_joints):
        targets[joint, :, joint] = sign * 100.0
    largest = np.zeros(robot.num_joints)
    for step in range(5):
        ticks = step_to(engine, targets)
        if step == 0:
            first = np.diagonal(ticks.joint_torque[:, 0])
            np.testing.assert_array_equal(first, sign * robot.torque_limit)
        largest = np.maximum(largest, np.abs(ticks.joint_torque).max(axis=(0, 1)))
    np.testing.assert_array_equal(largest, robot.torque_limit)


def test_full_torque_up_to_85_percent_of_the_speed_limit_none_at_it_and_braking_beyond(robot: Robot) -> None:
    model = free_model(robot)
    data = posed(robot, model)
    for sign in (1.0, -1.0):
        data.ctrl[:] = sign * 1000.0
        for share, torque in ((0.0, 1.0), (0.5, 1.0), (0.85, 1.0), (1.0, 0.0), (1.2, -1.0)):
            data.qvel[6:] = sign * share * robot.velocity_limit
            mujoco.mj_forward(model, data)
            expected = sign * torque * robot.torque_limit
            np.testing.assert_allclose(data.actuator_force, expected, rtol=1e-9, atol=1e-9, err_msg=f"{share}")


def test_full_torque_is_there_to_brake_at_any_speed(robot: Robot) -> None:
    model = free_model(robot)
    data = posed(robot, model)
    data.ctrl[:] = -1000.0
    for share in (0.3, 1.0, 1.5):
        data.qvel[6:] = share * robot.velocity_limit
        mujoco.mj_forward(model, data)
        np.testing.assert_array_equal(data.actuator_force, -robot.torque_limit)


@pytest.mark.parametrize("joint", JOINTS)
def test_a_free_joint_reaches_its_speed_limit_and_passes_it_by_less_than_5_percent(robot: Robot, joint: str) -> None:
    """The rest of the floating robot swings against the joint, hence 5 % and not 0."""
    model = free_model(robot)
    index = robot.joint_names.index(joint)
    limit = DRIVES[robot.joint_groups[index]].speed
    for sign in (1.0, -1.0):
        data = posed(robot, model)
        data.ctrl[index] = sign * 1000.0
        speed = []
        for _ in range(300):
            mujoco.mj_step(model, data)
            speed.append(sign * data.qvel[6 + index])
        largest = float(max(speed))
        assert largest > 0.95 * limit
        assert largest < 1.05 * limit


@pytest.mark.parametrize("joint", JOINTS)
def test_a_joint_that_brakes_in_the_air_is_never_faster_than_it_was(robot: Robot, joint: str) -> None:
    """3 rad/s is within every joint's limit; braking must not throw the joint the other way within one tick."""
    model = free_model(robot)
    index = robot.joint_names.index(joint)
    data = posed(robot, model)
    data.qvel[6 + index] = 3.0
    speed = []
    for _ in range(100):
        mujoco.mj_step(model, data)
        speed.append(abs(float(data.qvel[6 + index])))
    largest, last = max(speed), max(speed[-10:])
    assert largest < 3.0
    assert last < 0.5
