"""The batch of simulated robots: it equals plain MuJoCo to the last bit, and its robots do not know of each other."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import PUSH, everyone, hold, plain_steps, random_targets, stand, step_to

from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.rotations import sole_corners
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, POLICY_DT, TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.robots.domain import DomainParameters

# The batch.


def test_the_batch_equals_a_loop_of_mj_step_bit_for_bit(robot: Robot) -> None:
    targets = random_targets(robot, 3)
    engine = stand(robot, 3, height=0.01)
    engine.wrench[:, :, robot.body_id("torso"), :3] = PUSH
    motion = StepRecord.join([step_to(engine, targets).copy() for _ in range(5)])
    batch = motion.record
    for i in range(3):
        _, data, ticks = plain_steps(robot, np.tile(targets[i], (5, 1)), PUSH)
        np.testing.assert_array_equal(batch[i], ticks.record[0])
        np.testing.assert_array_equal(engine.state[0][i], data.qpos)
        np.testing.assert_array_equal(engine.state[1][i], data.qvel)
    # The robots did land and move.
    assert (batch[:, -1] != batch[:, 0]).any()
    assert motion.foot_contact.any()


def test_one_thread_and_two_threads_give_the_same_bits(robot: Robot) -> None:
    targets = random_targets(robot, 8)
    records = []
    for num_threads in (1, 2):
        engine = stand(robot, 8, num_threads)
        engine.wrench[:, :, 1, :3] = np.arange(8)[:, None, None] * 30.0
        records.append([step_to(engine, targets).record.copy() for _ in range(10)])
    np.testing.assert_array_equal(*records)


def test_a_robots_motion_does_not_depend_on_who_else_is_in_the_batch(robot: Robot) -> None:
    targets = random_targets(robot, 5)
    together, alone = stand(robot, 5), stand(robot, 1)
    for _ in range(5):
        of_five = step_to(together, targets).record[3].copy()
        np.testing.assert_array_equal(of_five, step_to(alone, targets[3:4]).record[0])


def test_a_policy_step_is_20_ticks_of_2_ms(robot: Robot) -> None:
    assert (TICKS_PER_STEP, CONTROL_DT, POLICY_DT) == (20, 0.002, 0.04)
    engine = stand(robot, 1, height=2.0)
    ticks = step_to(engine, hold(robot, 1))
    assert engine.model.opt.timestep == CONTROL_DT
    # Falling freely, tick k is recorded k steps of 2 ms after the beginning: v = -g k dt. The second one fell further.
    expected = -robot.gravity * CONTROL_DT * np.arange(TICKS_PER_STEP)
    np.testing.assert_allclose(ticks.com_velocity[0, :, 2], expected, atol=2e-5)
    following = step_to(engine, hold(robot, 1))
    np.testing.assert_allclose(following.com_velocity[0, :, 2], expected - robot.gravity * POLICY_DT, atol=2e-5)
    assert len(following) == 20


def test_stepping_some_robots_leaves_the_others_untouched(robot: Robot) -> None:
    targets = random_targets(robot, 4)
    engine, reference = stand(robot, 4), stand(robot, 4)
    for each in (engine, reference):
        step_to(each, targets)
    qpos, qvel = (state.copy() for state in engine.state)
    ids = np.array([1, 3])
    some = step_to(engine, targets[ids], ids).record.copy()
    np.testing.assert_array_equal(engine.state[0][[0, 2]], qpos[[0, 2]])
    np.testing.assert_array_equal(engine.state[1][[0, 2]], qvel[[0, 2]])
    assert (engine.state[0][ids] != qpos[ids]).any()
    # They moved as they would have in the company of all, and so do those who waited once it is their turn.
    every = step_to(reference, targets).record.copy()
    np.testing.assert_array_equal(some, every[ids])
    np.testing.assert_array_equal(step_to(engine, targets[[0, 2]], np.array([0, 2])).record, every[[0, 2]])


def test_some_of_the_robots_make_the_step_that_they_make_among_all(robot: Robot) -> None:
    targets, ids = random_targets(robot, 3), np.array([0, 2])
    reference, engine = stand(robot, 3), stand(robot, 3)
    expected = step_to(reference, targets).record.copy()
    np.testing.assert_array_equal(step_to(engine, targets[ids], ids).record, expected[ids])
    np.testing.assert_array_equal(engine.state[0][ids], reference.state[0][ids])


@pytest.mark.parametrize("ids", [[2, 0], [2, 0, 1], [1, 1]])
def test_ids_that_are_not_in_order_are_refused_and_nobody_moves(robot: Robot, ids: list[int]) -> None:
    engine = stand(robot, 3)
    before = [part.copy() for part in engine.state]
    with pytest.raises(ValueError, match="ids must be sorted and unique"):
        step_to(engine, random_targets(robot, 3)[ids], np.array(ids))
    for part, old in zip(engine.state, before, strict=True):
        np.testing.assert_array_equal(part, old)


def test_read_gives_the_state_of_the_robots_asked_for(robot: Robot) -> None:
    engine = stand(robot, 3)
    joints = robot.pose("bent") + np.array([[0.1], [0.2], [0.3]])
    engine.reset(everyone(engine), joints, height=1.0)
    np.testing.assert_array_equal(engine.read(np.array([2, 0])).joint_position[:, 0], joints[[2, 0]])


def test_a_copied_state_moves_on_as_the_original_bit_for_bit(robot: Robot) -> None:
    original, copy = stand(robot, 3), MujocoEngine(robot, 3, num_threads=1)
    for seed in range(4):
        step_to(original, random_targets(robot, 3, seed))
    copy.copy_state(original)
    targets = random_targets(robot, 3, seed=9)
    np.testing.assert_array_equal(step_to(copy, targets).record, step_to(original, targets).record)


def test_bare_physics_under_copied_controls_moves_as_a_step_does(robot: Robot) -> None:
    original, copy = stand(robot, 3), stand(robot, 3)
    original.wrench[:, :, robot.body_id("torso"), :3] = PUSH
    step_to(original, random_targets(robot, 3))
    copy.copy_control(original)
    copy.advance()
    np.testing.assert_array_equal(copy.state[0], original.state[0])
    np.testing.assert_array_equal(copy.state[1], original.state[1])


@pytest.mark.parametrize("physics_hz", [500, 1000])
def test_a_step_in_parts_moves_a_robot_as_a_whole_one_bit_for_bit(robot: Robot, physics_hz: int) -> None:
    whole, parts = (MujocoEngine(robot, 3, 1, DomainParameters(physics_hz=physics_hz)) for _ in range(2))
    ids = np.array([0, 2])
    for engine in (whole, parts):
        engine.reset(everyone(engine), np.tile(robot.pose("bent"), (3, 1)))
        engine.joint_targets[:] = random_targets(robot, 3)
        engine.wrench[:, :, robot.body_id("torso"), :3] = PUSH
    expected = whole.step(ids)
    found = [parts.step(ids, slice(first, last)) for first, last in ((0, 1), (1, 8), (8, 20))]
    assert [len(part) for part in found] == [1, 7, 12]
    np.testing.assert_array_equal(StepRecord.join(found).record, expected.record)
    np.testing.assert_array_equal(parts.state[0], whole.state[0])


@pytest.mark.usefixtures("in_scratch_folder")
def test_who_diverged_in_any_part_of_a_step_is_known_until_the_next_one_begins(robot: Robot) -> None:
    engine = stand(robot, 2)
    engine.joint_targets[:] = hold(robot, 2)
    engine.joint_targets[1, 3] = np.nan
    found = []
    for first in range(0, TICKS_PER_STEP, 5):
        engine.step(ticks=slice(first, first + 5))
        found.append(engine.diverged.tolist())
    assert found == [[False, True]] * 4
    assert engine.num_diverged == 1
    step_to(engine, hold(robot, 2))
    assert not engine.diverged.any()


# Reset.


def test_reset_stands_the_robots_where_it_is_told(robot: Robot) -> None:
    engine = MujocoEngine(robot, 3, num_threads=1)
    joints = np.random.default_rng(1).uniform(-0.06, 0.1, (3, robot.num_joints))
    yaw, height = np.array([0.0, 0.5, -2.5]), np.array([0.1, 0.2, 0.55])
    start = engine.reset(np.arange(3), joints, yaw, height)
    assert len(start) == 1
    np.testing.assert_array_equal(start.joint_position[:, 0], joints)
    np.testing.assert_array_equal(start.joint_velocity, 0.0)
    np.testing.assert_array_equal(start.com_velocity, 0.0)
    np.testing.assert_allclose(start.heading[:, 0], np.exp(1j * np.asarray(yaw)), atol=1e-15)
    np.testing.assert_allclose(start.root_uprightness, 1.0)
    # The feet are tilted by up to 0.1 + 0.1 rad, so that the lowest corner is below the soles' centres.
    corners = sole_corners(start.sole_position, start.foot_orientation, robot.sole_half_size)
    # Put down 1 um deep, so that a sole on the floor touches it for certain.
    np.testing.assert_allclose(corners[..., 2].min(axis=(1, 2, 3)), height - 1e-6, atol=1e-12)
    assert not start.foot_contact.any()
    assert (start.sole_position[:, 0, :, 2].min(axis=-1) > height + 1e-4).all()
    # In the air the motors hold the pose that there is.
    np.testing.assert_allclose(start.joint_torque, 0.0, atol=1e-9)


@pytest.mark.parametrize("pose", ["straight", "bent"])
def test_a_robot_on_the_floor_starts_at_rest_with_its_weight_on_its_feet(robot: Robot, pose: str) -> None:
    engine = MujocoEngine(robot, 32, num_threads=1)
    noise = np.random.default_rng(1).uniform(-0.02, 0.02, (32, robot.num_joints))
    held = np.clip(robot.pose(pose) + noise, robot.joint_lower, robot.joint_upper)
    start = engine.reset(everyone(engine), held)
    np.testing.assert_array_equal(start.joint_velocity, 0.0)
    np.testing.assert_array_equal(start.com_velocity, 0.0)
    np.testing.assert_allclose(start.foot_force[:, 0].sum(axis=-1), robot.weight, rtol=0.01)
    assert (start.foot_force > 0.15 * robot.weight).all()
    assert start.foot_contact.all()
    # At rest the impedance is a spring: the torque is the stiffness times what the weight has bent the joint by.
    sag = held - start.joint_position[:, 0]
    np.testing.assert_allclose(start.joint_torque[:, 0], robot.stiffness * sag, atol=0.5)
    assert 0.005 < np.abs(sag).max() < 0.08
    # It stands on: 40 ms later each foot still carries what it did, and nothing has begun to move fast.
    step_to(engine, np.repeat(held[:, None], TICKS_PER_STEP, axis=1))
    later = engine.read(everyone(engine))
    np.testing.assert_allclose(later.foot_force, start.foot_force, atol=0.1 * robot.weight)
    assert np.linalg.norm(later.com_velocity[:, 0], axis=-1).max() < 0.05


def test_a_restart_is_the_reset_that_it_was_kept_from(robot: Robot) -> None:
    engine = MujocoEngine(robot, 3, num_threads=1)
    held = np.tile(robot.pose("bent"), (3, 1)) + np.array([[0.0], [0.01], [-0.01]])
    start = engine.reset(everyone(engine), held)
    kept, targets = engine.rest_states(everyone(engine)), np.repeat(held[:, None], TICKS_PER_STEP, axis=1)
    record, moved = start.record.copy(), step_to(engine, targets).record.copy()
    np.testing.assert_array_equal(engine.restart(np.array([0, 2]), kept[[0, 2]]).record, record[[0, 2]])
    np.testing.assert_array_equal(step_to(engine, targets[[0, 2]], np.array([0, 2])).record, moved[[0, 2]])


def test_reset_of_one_robot_leaves_the_others_and_forgets_its_past(robot: Robot) -> None:
    engine = stand(robot, 3)
    for _ in range(3):
        step_to(engine, random_targets(robot, 3))
    before = engine.state[0].copy()
    engine.reset(np.array([1]), robot.pose("bent")[None])
    np.testing.assert_array_equal(engine.state[0][[0, 2]], before[[0, 2]])
    targets = random_targets(robot, 1, seed=5)
    again = step_to(engine, targets, np.array([1])).record.copy()
    np.testing.assert_array_equal(again, step_to(stand(robot, 1), targets).record)


# Wrenches.


@pytest.mark.parametrize("body", ["root", "torso", "left_shank"])
def test_a_force_for_120_ms_changes_the_momentum_by_its_impulse_plus_gravitys(robot: Robot, body: str) -> None:
    engine = stand(robot, 1, height=5.0)
    engine.wrench[:, :, robot.body_id(body), :3] = PUSH
    velocities = [step_to(engine, hold(robot, 1)).com_velocity[0].copy() for _ in range(3)]
    engine.wrench[:] = 0.0
    velocities.append(step_to(engine, hold(robot, 1)).com_velocity[0].copy())
    change = robot.mass * (velocities[3][0] - velocities[0][0])
    # 60 ticks * 2 ms = 0.12 s: J = (36, -18, 9.6) Ns; gravity -1346.33 N * 0.12 s = -161.56 Ns
    np.testing.assert_allclose(change, [36.0, -18.0, 9.6 - 161.56], atol=0.05)
    # And no further once the force is over.
    after = robot.mass * (velocities[3][19] - velocities[3][0])
    np.testing.assert_allclose(after, [0.0, 0.0, -1346.33 * 0.038], atol=0.05)


def test_each_tick_has_its_own_wrench(robot: Robot) -> None:
    engine = stand(robot, 2, height=5.0)
    engine.wrench[1, 5, robot.body_id("root"), 1] = 1000.0  # one tick: 1000 N * 2 ms = 2 Ns
    velocity = step_to(engine, hold(robot, 2)).com_velocity[..., 1]
    np.testing.assert_allclose(velocity[0], 0.0, atol=1e-6)
    np.testing.assert_allclose(velocity[1, :6], 0.0, atol=1e-6)
    np.testing.assert_allclose(velocity[1, 6:], 2.0 / 137.2875, rtol=1e-3)
