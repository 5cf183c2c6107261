from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot import balance
from surefoot.robot import Robot
from surefoot.simulation import (
    CONTROL_DT,
    POLICY_DT,
    TICKS_PER_STEP,
    Simulation,
    Ticks,
    roll_pitch,
    sensor_layout,
    sole_corners,
    uprightness,
)

TOTAL_MASS = 137.287494
PUSH = np.array([300.0, -150.0, 80.0])


def everyone(simulation: Simulation) -> np.ndarray:
    return np.arange(simulation.num_robots)


def stand(robot: Robot, num_robots: int, num_threads: int = 1, pose: str = "bent", **where: object) -> Simulation:
    simulation = Simulation(robot, num_robots, num_threads)
    simulation.reset(everyone(simulation), np.tile(robot.pose(pose), (num_robots, 1)), **where)
    return simulation


def hold(robot: Robot, num_robots: int, pose: str = "bent") -> np.ndarray:
    return np.tile(robot.pose(pose), (num_robots, TICKS_PER_STEP, 1))


def random_targets(robot: Robot, num_robots: int, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).uniform(-0.3, 0.3, (num_robots, TICKS_PER_STEP, robot.num_joints))
    return np.clip(robot.pose("bent") + noise, robot.joint_lower, robot.joint_upper)


def plain_steps(robot: Robot, targets: np.ndarray, push: np.ndarray) -> tuple[mujoco.MjModel, mujoco.MjData, Ticks]:
    """The bent robot from 1 cm above the floor in a loop of mj_step, `push` on its torso: (num_ticks, ...) of one."""
    model = robot.model()
    data = mujoco.MjData(model)
    data.qpos[:] = stand(robot, 1, height=0.01).state[0][0]
    mujoco.mj_forward(model, data)
    record = np.zeros((1, len(targets), model.nsensordata))
    for tick, target in enumerate(targets):
        data.ctrl[:] = target
        data.xfrc_applied[robot.body_id("torso"), :3] = push
        mujoco.mj_step(model, data)
        record[0, tick] = data.sensordata
    return model, data, Ticks(robot, sensor_layout(model), record)


# The batch.


def test_the_batch_equals_a_loop_of_mj_step_bit_for_bit(robot: Robot) -> None:
    targets = random_targets(robot, 3)
    simulation = stand(robot, 3, height=0.01)
    simulation.wrench[:, :, robot.body_id("torso"), :3] = PUSH
    batch = np.concatenate([simulation.step(targets).record.copy() for _ in range(5)], axis=1)
    for i in range(3):
        _, data, ticks = plain_steps(robot, np.tile(targets[i], (5, 1)), PUSH)
        np.testing.assert_array_equal(batch[i], ticks.record[0])
        np.testing.assert_array_equal(simulation.state[0][i], data.qpos)
        np.testing.assert_array_equal(simulation.state[1][i], data.qvel)
    # The robots did land and move.
    assert (batch[:, -1] != batch[:, 0]).any()
    assert Ticks(robot, simulation.layout, batch).foot_contact.any()


def test_one_thread_and_two_threads_give_the_same_bits(robot: Robot) -> None:
    targets = random_targets(robot, 8)
    records = []
    for num_threads in (1, 2):
        simulation = stand(robot, 8, num_threads)
        simulation.wrench[:, :, 1, :3] = np.arange(8)[:, None, None] * 30.0
        records.append([simulation.step(targets).record.copy() for _ in range(10)])
    np.testing.assert_array_equal(*records)


def test_a_robots_motion_does_not_depend_on_who_else_is_in_the_batch(robot: Robot) -> None:
    targets = random_targets(robot, 5)
    together, alone = stand(robot, 5), stand(robot, 1)
    for _ in range(5):
        of_five = together.step(targets).record[3].copy()
        np.testing.assert_array_equal(of_five, alone.step(targets[3:4]).record[0])


def test_a_policy_step_is_20_ticks_of_2_ms(robot: Robot) -> None:
    assert (TICKS_PER_STEP, CONTROL_DT, POLICY_DT) == (20, 0.002, 0.04)
    simulation = stand(robot, 1, height=2.0)
    ticks = simulation.step(hold(robot, 1))
    assert simulation.model.opt.timestep == CONTROL_DT
    # Falling freely, tick k is recorded k steps of 2 ms after the beginning: v = -g k dt. The second one fell further.
    expected = -robot.gravity * CONTROL_DT * np.arange(TICKS_PER_STEP)
    np.testing.assert_allclose(ticks.com_velocity[0, :, 2], expected, atol=2e-5)
    following = simulation.step(hold(robot, 1))
    np.testing.assert_allclose(following.com_velocity[0, :, 2], expected - robot.gravity * POLICY_DT, atol=2e-5)
    assert len(following) == 20


def test_stepping_some_robots_leaves_the_others_untouched(robot: Robot) -> None:
    targets = random_targets(robot, 4)
    simulation, reference = stand(robot, 4), stand(robot, 4)
    for each in (simulation, reference):
        each.step(targets)
    qpos, qvel = (state.copy() for state in simulation.state)
    ids = np.array([1, 3])
    some = simulation.step(targets[ids], ids).record.copy()
    np.testing.assert_array_equal(simulation.state[0][[0, 2]], qpos[[0, 2]])
    np.testing.assert_array_equal(simulation.state[1][[0, 2]], qvel[[0, 2]])
    assert (simulation.state[0][ids] != qpos[ids]).any()
    # They moved as they would have in the company of all, and so do those who waited once it is their turn.
    every = reference.step(targets).record.copy()
    np.testing.assert_array_equal(some, every[ids])
    np.testing.assert_array_equal(simulation.step(targets[[0, 2]], np.array([0, 2])).record, every[[0, 2]])


@pytest.mark.parametrize("ids", [[0, 2], [2, 0], [2, 0, 1]], ids=["sorted", "some", "all"])
def test_ids_out_of_order_are_honoured_or_refused_but_never_mixed_up(robot: Robot, ids: list[int]) -> None:
    targets = random_targets(robot, 3)
    reference, simulation = stand(robot, 3), stand(robot, 3)
    expected = reference.step(targets).record.copy()
    try:
        record = simulation.step(targets[ids], np.array(ids)).record
    except ValueError:
        assert ids != sorted(ids)
        return
    np.testing.assert_array_equal(record, expected[ids])
    np.testing.assert_array_equal(simulation.state[0][ids], reference.state[0][ids])


def test_read_gives_the_state_of_the_robots_asked_for(robot: Robot) -> None:
    simulation = stand(robot, 3)
    joints = robot.pose("bent") + np.array([[0.1], [0.2], [0.3]])
    simulation.reset(everyone(simulation), joints, height=1.0)
    np.testing.assert_array_equal(simulation.read(np.array([2, 0])).joint_position[:, 0], joints[[2, 0]])


def test_a_copied_state_moves_on_as_the_original_bit_for_bit(robot: Robot) -> None:
    original, copy = stand(robot, 3), Simulation(robot, 3, num_threads=1)
    for seed in range(4):
        original.step(random_targets(robot, 3, seed))
    copy.copy_state(original)
    targets = random_targets(robot, 3, seed=9)
    np.testing.assert_array_equal(copy.step(targets).record, original.step(targets).record)


def test_bare_physics_under_copied_controls_moves_as_a_step_does(robot: Robot) -> None:
    original, copy = stand(robot, 3), stand(robot, 3)
    original.wrench[:, :, robot.body_id("torso"), :3] = PUSH
    original.step(random_targets(robot, 3))
    copy.copy_control(original)
    copy.advance()
    np.testing.assert_array_equal(copy.state[0], original.state[0])
    np.testing.assert_array_equal(copy.state[1], original.state[1])


# Reset.


def test_reset_stands_the_robots_where_it_is_told(robot: Robot) -> None:
    simulation = Simulation(robot, 3, num_threads=1)
    joints = np.random.default_rng(1).uniform(-0.06, 0.1, (3, robot.num_joints))
    yaw, height = np.array([0.0, 0.5, -2.5]), np.array([0.0, 0.2, 0.55])
    start = simulation.reset(np.arange(3), joints, yaw, height)
    assert len(start) == 1
    np.testing.assert_array_equal(start.joint_position[:, 0], joints)
    np.testing.assert_array_equal(start.joint_velocity, 0.0)
    np.testing.assert_array_equal(start.com_velocity, 0.0)
    np.testing.assert_allclose(start.heading[:, 0], np.exp(1j * np.asarray(yaw)), atol=1e-15)
    np.testing.assert_allclose(start.pelvis_uprightness, 1.0)
    # The feet are tilted by up to 0.1 + 0.1 rad, so that the lowest corner is below the soles' centres.
    corners = sole_corners(start.sole_position, start.foot_orientation, robot.sole_half_size)
    # Put down 1 um deep, so that a sole on the floor touches it for certain.
    np.testing.assert_allclose(corners[..., 2].min(axis=(1, 2, 3)), height - 1e-6, atol=1e-12)
    assert start.foot_contact[0].any()
    assert (start.sole_position[:, 0, :, 2].min(axis=-1) > height + 1e-4).all()


def test_reset_of_one_robot_leaves_the_others_and_forgets_its_past(robot: Robot) -> None:
    simulation = stand(robot, 3)
    for _ in range(3):
        simulation.step(random_targets(robot, 3))
    before = simulation.state[0].copy()
    simulation.reset(np.array([1]), robot.pose("bent")[None])
    np.testing.assert_array_equal(simulation.state[0][[0, 2]], before[[0, 2]])
    targets = random_targets(robot, 1, seed=5)
    again = simulation.step(targets, np.array([1])).record.copy()
    np.testing.assert_array_equal(again, stand(robot, 1).step(targets).record)


# Named quantities against MuJoCo's own, in the middle of a pushed motion.


@pytest.fixture(scope="module")
def motion(robot: Robot) -> tuple[mujoco.MjModel, mujoco.MjData, Ticks]:
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


def test_power_is_the_sum_of_torque_times_speed_over_the_joints(motion: tuple, standing: Ticks, altered) -> None:
    _, _, ticks = motion
    by_hand = sum(abs(ticks.joint_torque[0, 7, j] * ticks.joint_velocity[0, 7, j]) for j in range(11))
    assert ticks.power[0, 7] == pytest.approx(by_hand, rel=1e-12)
    still = {f"{name}_velocity": 0.0 for name in standing.robot.joint_names}
    moving = {"torso_pitch_velocity": -2.0, "torso_pitch_torque": 30.0}
    moving |= {"left_knee_pitch_velocity": 0.5, "left_knee_pitch_torque": 100.0}
    # |30 * -2| + |100 * 0.5| = 110 W: a braking joint costs too
    np.testing.assert_allclose(altered(standing, **(still | moving)).power, 110.0)


def test_the_capture_point_is_the_com_plus_its_speed_times_the_pendulums_time(motion: tuple, robot: Robot) -> None:
    _, _, ticks = motion
    com, velocity = ticks.com_position[0, -1], ticks.com_velocity[0, -1]
    height = com[2] - min(ticks["left_sole_position"][0, -1, 2], ticks["right_sole_position"][0, -1, 2])
    assert ticks.com_height[0, -1] == pytest.approx(height, abs=1e-12)
    expected = com[:2] + velocity[:2] * np.sqrt(height / 9.806651)
    np.testing.assert_allclose(ticks.capture_point[0, -1], expected, atol=1e-12)
    assert np.abs(expected - com[:2]).max() > 0.05


def test_the_com_height_is_over_the_lower_sole(standing: Ticks, altered) -> None:
    ticks = altered(
        standing, com_position=(0.0, 0.0, 1.5), left_sole_position=(0, 0, 0.3), right_sole_position=(0, 0, 0.1)
    )
    np.testing.assert_allclose(ticks.com_height, 1.4)


# Standing.


def test_a_standing_robots_feet_carry_its_weight(standing: Ticks, robot: Robot) -> None:
    # 137.2875 kg * 9.806651 m/s^2 = 1346.33 N
    np.testing.assert_allclose(standing.foot_force.sum(axis=-1), 1346.33, rtol=2e-3)
    # The robot is almost symmetric: each foot carries half within 1 %.
    np.testing.assert_allclose(standing.foot_force, 673.17, rtol=0.01)
    assert standing.foot_contact.all()
    assert not standing.non_foot_contact.any()


def test_a_standing_robots_centre_of_pressure_is_below_its_com_and_inside_its_soles(standing: Ticks) -> None:
    pressure, com = standing.center_of_pressure[0, -1], standing.com_position[0, -1, :2]
    np.testing.assert_allclose(pressure, com, atol=0.005)
    polygon = standing.support_polygon(0, -1)
    for direction in np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]):
        assert balance.margin(polygon, pressure, direction) > 0.02


def test_the_centre_of_pressure_weighs_the_feet_by_their_force(standing: Ticks, altered) -> None:
    # found, force (3), torque (3), point (3), ...: 300 N at y = 0.1 and 100 N at y = -0.3 -> y = (30 - 30) / 400 = 0
    rest = [0.0] * (standing["left_foot_contact"].shape[-1] - 10)
    left = [4, 0, 0, 300, 0, 0, 0, 0.2, 0.1, 0.0, *rest]
    right = [4, 0, 0, 100, 0, 0, 0, -0.2, -0.3, 0.0, *rest]
    ticks = altered(standing, left_foot_contact=left, right_foot_contact=right)
    # x = (300 * 0.2 - 100 * 0.2) / 400 = 0.1
    np.testing.assert_allclose(ticks.center_of_pressure, np.broadcast_to([0.1, 0.0], (1, 20, 2)), atol=1e-15)


def test_there_is_no_centre_of_pressure_and_no_support_in_the_air(robot: Robot) -> None:
    ticks = stand(robot, 1, height=1.0).step(hold(robot, 1))
    assert np.isnan(ticks.center_of_pressure).all()
    assert not ticks.foot_contact.any()
    assert not ticks.non_foot_contact.any()
    np.testing.assert_array_equal(ticks.foot_force, 0.0)
    assert ticks.support_polygon(0, 0).shape == (0, 2)


def test_the_support_polygon_of_both_flat_feet_spans_both_soles(standing: Ticks) -> None:
    polygon = standing.support_polygon(0, -1)
    # 0.27 m long, 2 * 0.1377 + 0.16 = 0.4354 m wide; the feet have settled by at most some millimetres
    np.testing.assert_allclose(np.ptp(polygon, axis=0), [0.27, 2 * 0.1377 + 0.16], atol=0.003)
    x, y = polygon.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)  # positive: counter-clockwise
    assert area == pytest.approx(0.27 * 0.4354, rel=0.01)


def test_the_flat_support_polygon_counts_both_soles_also_in_the_air(robot: Robot) -> None:
    start = Simulation(robot, 1, num_threads=1).reset(np.array([0]), robot.pose("straight")[None], height=1.0)
    assert not start.foot_contact.any()
    x, y = 0.034874125, 0.1377046  # the sole's centre from the pelvis, URDF
    corners = [(x - 0.135, -y - 0.08), (x + 0.135, -y - 0.08), (x + 0.135, y + 0.08), (x - 0.135, y + 0.08)]
    np.testing.assert_allclose(start.flat_support_polygon(), corners, atol=1e-9)


def test_the_support_of_one_foot_is_that_foots_sole(standing: Ticks, altered) -> None:
    contact = standing["right_foot_contact"][0, -1].copy()
    contact[:] = 0.0
    ticks = altered(standing, right_foot_contact=contact)
    np.testing.assert_allclose(np.ptp(ticks.support_polygon(0, -1), axis=0), [0.27, 0.16], atol=0.003)
    np.testing.assert_allclose(
        ticks.support_polygon(0, -1).mean(axis=0), standing.sole_position[0, -1, 0, :2], atol=1e-9
    )
    np.testing.assert_array_equal(ticks.support_center, standing.sole_position[:, :, 0, :2])


def test_the_support_centre_is_between_both_feet_and_also_in_the_air(standing: Ticks, altered) -> None:
    left, right = standing.sole_position[0, -1, :, :2]
    np.testing.assert_allclose(standing.support_center[0, -1], 0.5 * (left + right), atol=1e-15)
    nothing = np.zeros(standing["left_foot_contact"].shape[-1])
    in_the_air = altered(standing, left_foot_contact=nothing, right_foot_contact=nothing)
    np.testing.assert_array_equal(in_the_air.support_center, standing.support_center)


@pytest.mark.parametrize("turn", [(0.0, 0.5 * np.pi), (0.0, -0.5 * np.pi), (0.5 * np.pi, 0.0)], ids=str)
def test_a_robot_on_the_floor_has_non_foot_contact(robot: Robot, turn: tuple[float, float]) -> None:
    simulation = stand(robot, 2)
    qpos, _ = simulation.state
    roll, pitch = turn
    qpos[1, 3:7] = Rotation.from_euler("YX", [pitch, roll]).as_quat(scalar_first=True)
    qpos[1, 2] = 0.12
    ticks = simulation.step(hold(robot, 2))
    assert ticks.non_foot_contact[1, :10].all()  # then it bounces
    assert not ticks.non_foot_contact[0].any()


def test_a_falling_robot_has_non_foot_contact_only_once_it_lies(robot: Robot) -> None:
    simulation = stand(robot, 1)
    simulation.wrench[:, :, robot.body_id("pelvis"), 0] = 3000.0
    simulation.step(hold(robot, 1))
    simulation.wrench[:] = 0.0
    for _ in range(60):
        ticks = simulation.step(hold(robot, 1))
        if ticks.non_foot_contact.any():
            break
    first = int(ticks.non_foot_contact[0].argmax())
    # Something far from the feet is near the floor: the pelvis has come down from 1.1 m to below knee height.
    assert ticks["pelvis_position"][0, first, 2] < 0.7
    assert ticks.pelvis_uprightness[0, first] < 0.7


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


def test_attitudes_are_those_of_pelvis_and_torso(robot: Robot) -> None:
    simulation = stand(robot, 1, height=1.0)
    qpos, _ = simulation.state
    yaw, pitch, roll = 0.8, 0.3, -0.2
    qpos[0, 3:7] = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat(scalar_first=True)
    qpos[0, 7] = 0.4  # torso pitch
    simulation.batch.forward(np.array([0]))
    ticks = simulation.read(np.array([0]))
    np.testing.assert_allclose(ticks.pelvis_attitude[:, 0, 0], [roll, pitch], atol=1e-12)
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


# Wrenches.


@pytest.mark.parametrize("body", ["pelvis", "torso", "left_shank"])
def test_a_force_for_120_ms_changes_the_momentum_by_its_impulse_plus_gravitys(robot: Robot, body: str) -> None:
    simulation = stand(robot, 1, height=5.0)
    simulation.wrench[:, :, robot.body_id(body), :3] = PUSH
    velocities = [simulation.step(hold(robot, 1)).com_velocity[0].copy() for _ in range(3)]
    simulation.wrench[:] = 0.0
    velocities.append(simulation.step(hold(robot, 1)).com_velocity[0].copy())
    change = robot.mass * (velocities[3][0] - velocities[0][0])
    # 60 ticks * 2 ms = 0.12 s: J = (36, -18, 9.6) Ns; gravity -1346.33 N * 0.12 s = -161.56 Ns
    np.testing.assert_allclose(change, [36.0, -18.0, 9.6 - 161.56], atol=0.05)
    # And no further once the force is over.
    after = robot.mass * (velocities[3][19] - velocities[3][0])
    np.testing.assert_allclose(after, [0.0, 0.0, -1346.33 * 0.038], atol=0.05)


def test_each_tick_has_its_own_wrench(robot: Robot) -> None:
    simulation = stand(robot, 2, height=5.0)
    simulation.wrench[1, 5, robot.body_id("pelvis"), 1] = 1000.0  # one tick: 1000 N * 2 ms = 2 Ns
    velocity = simulation.step(hold(robot, 2)).com_velocity[..., 1]
    np.testing.assert_allclose(velocity[0], 0.0, atol=1e-6)
    np.testing.assert_allclose(velocity[1, :6], 0.0, atol=1e-6)
    np.testing.assert_allclose(velocity[1, 6:], 2.0 / 137.2875, rtol=1e-3)


# Divergence.


def diverge(robot: Robot, simulation: Simulation, who: int) -> Ticks:
    targets = hold(robot, simulation.num_robots)
    targets[who] = np.nan
    return simulation.step(targets)


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_that_diverges_is_flagged_and_counted_and_its_record_is_finite(robot: Robot) -> None:
    simulation = stand(robot, 4)
    assert (simulation.diverged.tolist(), simulation.num_diverged) == ([False] * 4, 0)
    ticks = diverge(robot, simulation, 2)
    assert (simulation.diverged.tolist(), simulation.num_diverged) == ([False, False, True, False], 1)
    assert np.isfinite(ticks.record).all()
    assert np.isfinite(simulation.state[0]).all()
    simulation.step(hold(robot, 4))
    assert (simulation.diverged.tolist(), simulation.num_diverged) == ([False] * 4, 1)


@pytest.mark.usefixtures("in_scratch_folder")
@pytest.mark.parametrize("cause", ["target", "wrench", "velocity"])
def test_whatever_became_non_finite_is_noticed(robot: Robot, cause: str) -> None:
    simulation = stand(robot, 3)
    targets = hold(robot, 3)
    if cause == "target":
        targets[1, 7, 3] = np.inf
    elif cause == "wrench":
        simulation.wrench[1, 7, 1, 2] = np.nan
    else:
        simulation.state[1][1, 8] = np.nan
    ticks = simulation.step(targets)
    assert simulation.diverged.tolist() == [False, True, False]
    assert np.isfinite(ticks.record).all()


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_that_diverges_does_not_change_a_bit_of_the_others(robot: Robot) -> None:
    targets = random_targets(robot, 4)
    simulation, reference = stand(robot, 4), stand(robot, 4)
    broken = targets.copy()
    broken[2, 3:] = np.nan
    simulation.step(broken)
    reference.step(targets)
    for _ in range(3):
        np.testing.assert_array_equal(
            simulation.step(targets).record[[0, 1, 3]], reference.step(targets).record[[0, 1, 3]]
        )


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_that_diverges_is_put_back_to_its_default_state(robot: Robot) -> None:
    simulation = stand(robot, 2)
    diverge(robot, simulation, 1)
    np.testing.assert_allclose(simulation.state[0][1], simulation.model.qpos0, atol=0.01)
    np.testing.assert_allclose(simulation.state[1][1], 0.0, atol=0.1)


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_that_diverges_again_after_a_reset_is_flagged_again(robot: Robot) -> None:
    simulation = stand(robot, 2)
    for count in (1, 2, 3):
        diverge(robot, simulation, 1)
        assert simulation.diverged.tolist() == [False, True]
        assert simulation.num_diverged == count
        simulation.reset(np.array([1]), robot.pose("bent")[None])


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_that_diverges_in_a_partial_step_is_flagged_by_its_own_number(robot: Robot) -> None:
    simulation = stand(robot, 4)
    targets = hold(robot, 2)
    targets[1] = np.nan
    ticks = simulation.step(targets, np.array([1, 3]))
    assert simulation.diverged.tolist() == [False, False, False, True]
    assert np.isfinite(ticks.record).all()


def test_the_world_is_left_silent_by_a_healthy_run(robot: Robot) -> None:
    simulation = stand(robot, 2)
    for _ in range(10):
        simulation.step(random_targets(robot, 2))
    assert simulation.num_diverged == 0
    assert not simulation.batch.warning[..., 1].any()
