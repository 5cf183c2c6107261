"""The named quantities of a tick: against MuJoCo's own, and by hand."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from conftest import PUSH, TOTAL_MASS, hold, plain_steps, stand, step_to
from scipy.spatial.transform import Rotation

from surefoot.physics import balance
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.rotations import roll_pitch, sole_corners, uprightness
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT
from surefoot.robots import Robot

# Named quantities against MuJoCo's own, in the middle of a pushed motion.


@pytest.fixture(scope="module")
def motion(robot: Robot) -> tuple[mujoco.MjModel, mujoco.MjData, StepRecord]:
    """0.4 s of a bent robot that lands and is pushed at its torso; `data` is what gave the last tick."""
    return plain_steps(robot, hold(robot, 10).reshape(-1, robot.num_joints), PUSH)


def ground_forces(model: mujoco.MjModel, data: mujoco.MjData, foot: str) -> list[tuple[float, np.ndarray]]:
    """(normal force, point) of every contact of a foot with the floor."""
    forces = []
    for i, contact in enumerate(data.contact):
        if {model.geom(contact.geom1).name, model.geom(contact.geom2).name} == {"floor", foot}:
            wrench = np.zeros(6)
            mujoco.mj_contactForce(model, data, i, wrench)
            forces.append((wrench[0], contact.pos.copy()))
    return forces


def test_com_quantities_are_mujocos(motion: tuple) -> None:
    model, data, ticks = motion
    # After mj_step, `data` still holds what was computed at the tick's start.
    np.testing.assert_array_equal(ticks.com_position[0, -1], data.subtree_com[1])
    # Mass-weighted mean of the bodies' CoMs, by hand.
    by_hand = (model.body_mass[1:, None] * data.xipos[1:]).sum(axis=0) / TOTAL_MASS
    np.testing.assert_allclose(ticks.com_position[0, -1], by_hand, atol=1e-7)
    # Velocity: the CoM's finite difference over the last two ticks, at their middle.
    difference = (ticks.com_position[0, -1] - ticks.com_position[0, -2]) / CONTROL_DT
    np.testing.assert_allclose(ticks.com_velocity[0, -1], difference, atol=2e-3)
    np.testing.assert_array_equal(ticks.com_velocity[0, -1], data.subtree_linvel[1])
    np.testing.assert_array_equal(ticks.angular_momentum[0, -1], data.subtree_angmom[1])


def test_foot_forces_and_their_centre_are_those_of_mujocos_contacts(motion: tuple) -> None:
    model, data, ticks = motion
    total, moment = 0.0, np.zeros(2)
    for side, foot in enumerate(("left_foot", "right_foot")):
        contacts = ground_forces(model, data, foot)
        force = sum(normal for normal, _ in contacts)
        assert force > 10.0
        assert ticks.foot_force[0, -1, side] == pytest.approx(force, rel=1e-9)
        assert ticks.foot_contact[0, -1, side]
        total += force
        moment += sum(normal * point[:2] for normal, point in contacts)
    np.testing.assert_allclose(ticks.center_of_pressure[0, -1], moment / total, atol=1e-6)


def test_joint_torques_are_those_of_the_actuators(motion: tuple) -> None:
    _, data, ticks = motion
    np.testing.assert_array_equal(ticks.joint_torque[0, -1], data.actuator_force)
    assert np.abs(ticks.joint_torque[0, -1]).max() > 1.0


def test_power_is_the_sum_of_torque_times_speed_over_the_joints(motion: tuple, standing: StepRecord, altered) -> None:
    _, _, ticks = motion
    by_hand = sum(abs(ticks.joint_torque[0, 7, j] * ticks.joint_velocity[0, 7, j]) for j in range(11))
    assert ticks.power[0, 7] == pytest.approx(by_hand, rel=1e-12)
    speed, torque = np.zeros(11), np.zeros(11)
    speed[[0, 3]], torque[[0, 3]] = (-2.0, 0.5), (30.0, 100.0)  # torso and left knee
    # |30 * -2| + |100 * 0.5| = 110 W: a braking joint costs too
    np.testing.assert_allclose(altered(standing, joint_velocity=speed, joint_torque=torque).power, 110.0)


def test_the_capture_point_is_the_com_plus_its_speed_times_the_pendulums_time(motion: tuple, robot: Robot) -> None:
    _, _, ticks = motion
    com, velocity = ticks.com_position[0, -1], ticks.com_velocity[0, -1]
    height = com[2] - min(ticks["left_sole_position"][0, -1, 2], ticks["right_sole_position"][0, -1, 2])
    assert ticks.com_height[0, -1] == pytest.approx(height, abs=1e-12)
    expected = com[:2] + velocity[:2] * np.sqrt(height / 9.806651)
    np.testing.assert_allclose(ticks.capture_point[0, -1], expected, atol=1e-12)
    assert np.abs(expected - com[:2]).max() > 0.05


def test_the_com_height_is_over_the_lower_sole(standing: StepRecord, altered) -> None:
    ticks = altered(
        standing, com_position=(0.0, 0.0, 1.5), left_sole_position=(0, 0, 0.3), right_sole_position=(0, 0, 0.1)
    )
    np.testing.assert_allclose(ticks.com_height, 1.4)


# Standing.


def test_a_standing_robots_feet_carry_its_weight(standing: StepRecord, robot: Robot) -> None:
    # 137.2875 kg * 9.806651 m/s^2 = 1346.33 N
    np.testing.assert_allclose(standing.foot_force.sum(axis=-1), 1346.33, rtol=2e-3)
    # The robot is almost symmetric: each foot carries half within 1 %.
    np.testing.assert_allclose(standing.foot_force, 673.17, rtol=0.01)
    assert standing.foot_contact.all()
    assert not standing.non_foot_contact.any()


def test_a_standing_robots_centre_of_pressure_is_below_its_com_and_inside_its_soles(standing: StepRecord) -> None:
    pressure, com = standing.center_of_pressure[0, -1], standing.com_position[0, -1, :2]
    np.testing.assert_allclose(pressure, com, atol=0.005)
    polygon = standing.support_polygon(0, -1)
    for direction in np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]):
        assert balance.margin(polygon, pressure, direction) > 0.02


def test_the_centre_of_pressure_weighs_the_feet_by_their_force(standing: StepRecord, altered) -> None:
    # found, force (3), torque (3), point (3), ...: 300 N at y = 0.1 and 100 N at y = -0.3 -> y = (30 - 30) / 400 = 0
    rest = [0.0] * (standing["left_foot_contact"].shape[-1] - 10)
    left = [4, 0, 0, 300, 0, 0, 0, 0.2, 0.1, 0.0, *rest]
    right = [4, 0, 0, 100, 0, 0, 0, -0.2, -0.3, 0.0, *rest]
    ticks = altered(standing, left_foot_contact=left, right_foot_contact=right)
    # x = (300 * 0.2 - 100 * 0.2) / 400 = 0.1
    np.testing.assert_allclose(ticks.center_of_pressure, np.broadcast_to([0.1, 0.0], (1, 20, 2)), atol=1e-15)


def test_there_is_no_centre_of_pressure_and_no_support_in_the_air(robot: Robot) -> None:
    ticks = step_to(stand(robot, 1, height=1.0), hold(robot, 1))
    assert np.isnan(ticks.center_of_pressure).all()
    assert not ticks.foot_contact.any()
    assert not ticks.non_foot_contact.any()
    np.testing.assert_array_equal(ticks.foot_force, 0.0)
    assert ticks.support_polygon(0, 0).shape == (0, 2)


def test_the_support_polygon_of_both_flat_feet_spans_both_soles(standing: StepRecord) -> None:
    polygon = standing.support_polygon(0, -1)
    # 0.27 m long, 2 * 0.1377 + 0.16 = 0.4354 m wide; the feet have settled by at most some millimetres
    np.testing.assert_allclose(np.ptp(polygon, axis=0), [0.27, 2 * 0.1377 + 0.16], atol=0.003)
    x, y = polygon.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)  # positive: counter-clockwise
    assert area == pytest.approx(0.27 * 0.4354, rel=0.01)


def test_the_flat_support_polygon_counts_both_soles_also_in_the_air(robot: Robot) -> None:
    start = MujocoEngine(robot, 1, num_threads=1).reset(np.array([0]), robot.pose("straight")[None], height=1.0)
    assert not start.foot_contact.any()
    x, y = 0.034874125, 0.1377046  # the sole's centre from the root, URDF
    corners = [(x - 0.135, -y - 0.08), (x + 0.135, -y - 0.08), (x + 0.135, y + 0.08), (x - 0.135, y + 0.08)]
    np.testing.assert_allclose(start.flat_support_polygon(), corners, atol=1e-9)


def test_the_support_of_one_foot_is_that_foots_sole(standing: StepRecord, altered) -> None:
    contact = standing["right_foot_contact"][0, -1].copy()
    contact[:] = 0.0
    ticks = altered(standing, right_foot_contact=contact)
    np.testing.assert_allclose(np.ptp(ticks.support_polygon(0, -1), axis=0), [0.27, 0.16], atol=0.003)
    np.testing.assert_allclose(
        ticks.support_polygon(0, -1).mean(axis=0), standing.sole_position[0, -1, 0, :2], atol=1e-9
    )
    np.testing.assert_array_equal(ticks.support_center, standing.sole_position[:, :, 0, :2])


def test_the_support_centre_is_between_both_feet_and_also_in_the_air(standing: StepRecord, altered) -> None:
    left, right = standing.sole_position[0, -1, :, :2]
    np.testing.assert_allclose(standing.support_center[0, -1], 0.5 * (left + right), atol=1e-15)
    nothing = np.zeros(standing["left_foot_contact"].shape[-1])
    in_the_air = altered(standing, left_foot_contact=nothing, right_foot_contact=nothing)
    np.testing.assert_array_equal(in_the_air.support_center, standing.support_center)


@pytest.mark.parametrize("turn", [(0.0, 0.5 * np.pi), (0.0, -0.5 * np.pi), (0.5 * np.pi, 0.0)], ids=str)
def test_a_robot_on_the_floor_has_non_foot_contact(robot: Robot, turn: tuple[float, float]) -> None:
    engine = stand(robot, 2)
    qpos, _ = engine.state
    roll, pitch = turn
    qpos[1, 3:7] = Rotation.from_euler("YX", [pitch, roll]).as_quat(scalar_first=True)
    qpos[1, 2] = 0.12
    ticks = step_to(engine, hold(robot, 2))
    assert ticks.non_foot_contact[1, :10].all()  # then it bounces
    assert not ticks.non_foot_contact[0].any()


def test_a_falling_robot_has_non_foot_contact_only_once_it_lies(robot: Robot) -> None:
    engine = stand(robot, 1)
    engine.wrench[:, :, robot.body_id("root"), 0] = 3000.0
    step_to(engine, hold(robot, 1))
    engine.wrench[:] = 0.0
    for _ in range(60):
        ticks = step_to(engine, hold(robot, 1))
        if ticks.non_foot_contact.any():
            break
    first = int(ticks.non_foot_contact[0].argmax())
    # Something far from the feet is near the floor: the root has come down from 1.1 m to below knee height.
    assert ticks["root_position"][0, first, 2] < 0.7
    assert ticks.root_uprightness[0, first] < 0.7


# Attitude.


def test_roll_and_pitch_by_hand() -> None:
    half = 0.1
    rolled = np.array([np.cos(half), np.sin(half), 0.0, 0.0])
    pitched = np.array([np.cos(half), 0.0, np.sin(half), 0.0])
    np.testing.assert_allclose(roll_pitch(rolled), [0.2, 0.0], atol=1e-15)
    np.testing.assert_allclose(roll_pitch(pitched), [0.0, 0.2], atol=1e-15)
    # Straight down on the face: cos 45 = sin 45, 2 (w y) = 1.
    down = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
    assert roll_pitch(down)[1] == pytest.approx(0.5 * np.pi, abs=1e-7)


def test_roll_and_pitch_are_the_euler_angles_z_y_x_whatever_the_yaw() -> None:
    angles = np.random.default_rng(2).uniform([-np.pi, -1.5, -3.0], [np.pi, 1.5, 3.0], (50, 3))
    quaternions = Rotation.from_euler("ZYX", angles).as_quat(scalar_first=True)
    np.testing.assert_allclose(roll_pitch(quaternions), [angles[:, 2], angles[:, 1]], atol=1e-7)


def test_uprightness_is_the_cosine_of_the_tilt_whatever_its_direction() -> None:
    assert uprightness(np.array([1.0, 0.0, 0.0, 0.0])) == 1.0
    tilt = np.radians([0.0, 20.0, 60.0, 90.0, 180.0])
    for azimuth in (0.0, 1.0, -2.5):
        axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        quaternions = Rotation.from_rotvec(tilt[:, None] * axis).as_quat(scalar_first=True)
        np.testing.assert_allclose(uprightness(quaternions), np.cos(tilt), atol=1e-15)


def test_attitudes_are_those_of_root_and_torso(robot: Robot) -> None:
    engine = stand(robot, 1, height=1.0)
    qpos, _ = engine.state
    yaw, pitch, roll = 0.8, 0.3, -0.2
    qpos[0, 3:7] = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat(scalar_first=True)
    qpos[0, 7] = 0.4  # torso pitch
    engine.batch.forward(np.array([0]))
    ticks = engine.read(np.array([0]))
    np.testing.assert_allclose(ticks.root_attitude[:, 0, 0], [roll, pitch], atol=1e-12)
    torso = Rotation.from_euler("ZYX", [yaw, pitch, roll]) * Rotation.from_euler("Y", 0.4)
    _, torso_pitch, torso_roll = torso.as_euler("ZYX")
    np.testing.assert_allclose(ticks.torso_attitude[:, 0, 0], [torso_roll, torso_pitch], atol=1e-12)
    assert ticks.torso_uprightness[0, 0] == pytest.approx(torso.as_matrix()[2, 2], abs=1e-12)
    np.testing.assert_allclose(ticks.heading[0, 0], np.exp(1j * yaw), atol=1e-12)


def test_sole_corners_by_hand() -> None:
    half = np.array([0.1, 0.05])
    flat = sole_corners(np.array([1.0, 2.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]), half)
    np.testing.assert_allclose(flat, [[1.1, 2.05, 0], [0.9, 2.05, 0], [0.9, 1.95, 0], [1.1, 1.95, 0]])
    # Turned left by 90 degrees, front is +y and left is -x.
    turned = sole_corners(np.zeros(3), np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)]), half)
    np.testing.assert_allclose(turned[0], [-0.05, 0.1, 0.0], atol=1e-15)
    # Toes down by 0.3 rad: the front corners sink by 0.1 sin 0.3.
    down = sole_corners(np.zeros(3), np.array([np.cos(0.15), 0, np.sin(0.15), 0]), half)
    np.testing.assert_allclose(down[:, 2], 0.1 * np.sin(0.3) * np.array([-1, 1, 1, -1]), atol=1e-15)
