"""What ends an episode beside a fall: steps after small pushes, and joints beyond their speed limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import NO_PUSH, make_env

from surefoot.physics.step_record import StepRecord
from surefoot.robots import Robot
from surefoot.task.control_loop import ControlLoop
from surefoot.task.early_ends import EarlyEnds
from surefoot.task.random_pushes import PUSH, DisturbanceConfig


def push_anywhere(impulse: float) -> DisturbanceConfig:
    """Pushes of one size at 0.2 s in every direction."""
    return DisturbanceConfig(impulse=(impulse, impulse), first=(0.2, 0.2))


def end_of(num_steps: int = 40, num_robots: int = 8, **config: object) -> np.ndarray:
    """The first policy step in which each of some robots that hold their pose ends its episode; -1 for none."""
    env = make_env(num_robots, pose="bent", **config)
    env.reset(seed=0)
    end = np.full(num_robots, -1)
    for step in range(num_steps):
        _, _, terminated, _, _ = env.step(np.zeros((num_robots, 11)))
        end[terminated & (end < 0)] = step
    return end


def test_an_episode_ends_when_a_foot_leaves_its_place() -> None:
    falls = end_of(disturbance=push_anywhere(150.0))
    leaves = end_of(disturbance=push_anywhere(150.0), foot_shift_limit=0.025)
    # Robots that hold their pose topple over; their feet leave their places on the way.
    assert (leaves > 5).all()
    assert (leaves[falls > 0] < falls[falls > 0]).all()
    assert (end_of(disturbance=push_anywhere(6.0), foot_shift_limit=0.025, num_steps=20) == -1).all()


def test_a_foot_may_leave_its_place_after_a_push_that_is_large_enough() -> None:
    limits = {"foot_shift_limit": 0.025, "foot_shift_impulse": 100.0}
    np.testing.assert_array_equal(
        end_of(disturbance=push_anywhere(150.0), **limits), end_of(disturbance=push_anywhere(150.0))
    )
    small = push_anywhere(90.0)
    np.testing.assert_array_equal(
        end_of(disturbance=small, **limits), end_of(disturbance=small, foot_shift_limit=0.025)
    )


def test_a_foot_may_leave_its_place_after_a_push_beyond_the_limit_of_its_direction() -> None:
    env = make_env(32, pose="bent", disturbance=push_anywhere(90.0), foot_shift_limit=0.025)
    env.reset(seed=0)
    force = env.loop.pushes.force[:, PUSH]
    # Forward, left, backward and right, linear between: 100, 80, 80, 80 Ns is above 90 Ns within 45 degrees of forward.
    is_forward = np.abs(np.arctan2(force[:, 1], force[:, 0])) < np.pi / 4
    assert 0 < is_forward.sum() < 32
    limits = {"disturbance": push_anywhere(90.0), "num_robots": 32}
    free, forbidden = end_of(**limits), end_of(**limits, foot_shift_limit=0.025)
    found = end_of(**limits, foot_shift_limit=0.025, foot_shift_impulse=(100.0, 80.0, 80.0, 80.0))
    np.testing.assert_array_equal(found, np.where(is_forward, forbidden, free))
    assert (free != forbidden).any()


def test_a_foot_may_leave_its_place_after_a_push_at_another_body_than_the_root() -> None:
    at_torso = dataclasses.replace(push_anywhere(90.0), bodies=("torso",))
    np.testing.assert_array_equal(
        end_of(disturbance=at_torso, foot_shift_limit=0.025, foot_shift_impulse=100.0), end_of(disturbance=at_torso)
    )


@pytest.fixture(scope="module")
def standing(robot: Robot) -> StepRecord:
    """A policy step of a robot that stands."""
    loop = ControlLoop(robot, 1, robot.pose("bent"), num_threads=1)
    return loop.step(np.zeros((1, 11))).copy()


def moving(standing: StepRecord, robot: Robot, fast: slice, share: float) -> StepRecord:
    """The same step, but that one joint moves at a share of its limit in some of the ticks."""
    record = standing.copy()
    record["joint_velocity"][:] = 0.0
    record["joint_velocity"][0, fast, 3] = share * robot.velocity_limit[3]
    return record


@pytest.mark.parametrize(("ticks", "share", "is_too_fast"), [(5, 1.2, True), (4, 1.2, False), (5, 1.0, False)])
def test_a_speed_counts_as_its_mean_over_10_ms(
    standing: StepRecord, robot: Robot, ticks: int, share: float, is_too_fast: bool
) -> None:
    """The limit is 1.1 of the joint's: 5 ticks of 1.2 have a mean of 1.2, and 4 of them 0.96."""
    ends = EarlyEnds(robot, 1, None, 1.1)
    assert ends.too_fast(moving(standing, robot, slice(10, 10 + ticks), share))[0] == is_too_fast


def test_a_mean_speed_reaches_from_one_policy_step_into_the_next(standing: StepRecord, robot: Robot) -> None:
    ends = EarlyEnds(robot, 1, None, 1.1)
    assert not ends.too_fast(moving(standing, robot, slice(17, 20), 1.2))[0]
    assert ends.too_fast(moving(standing, robot, slice(0, 2), 1.2))[0]  # 3 + 2 ticks
    assert not ends.too_fast(moving(standing, robot, slice(17, 20), 1.2))[0]
    ends.reset(np.array([0]))
    assert not ends.too_fast(moving(standing, robot, slice(0, 2), 1.2))[0]


def test_the_place_of_a_foot_is_where_it_was_when_the_last_push_had_been_survived(
    standing: StepRecord, robot: Robot
) -> None:
    ends, nobody = EarlyEnds(robot, 1, 0.025, None), np.zeros(0, np.int64)

    def moved(distance: float) -> StepRecord:
        record = standing.copy()
        record.sole_position[..., 0] += distance
        return record

    assert not ends.stepped(moved(0.0), nobody)[0]
    assert not ends.stepped(moved(0.02), nobody)[0]
    assert ends.stepped(moved(0.03), nobody)[0]
    assert not ends.stepped(moved(0.03), np.array([0]))[0]  # the place is there now
    assert ends.stepped(moved(0.0), nobody)[0]


def test_an_episode_ends_at_a_joint_speed_with_the_probability_of_the_schedule() -> None:
    fast = {"disturbance": NO_PUSH, "joint_speed_limit": 0.02}
    never = {**fast, "speed_end_probability": ((0.0, 0.0), (1.0, 1.0))}
    rng = np.random.default_rng(0)
    env, calm = make_env(8, pose="bent", **fast), make_env(8, pose="bent", **never)
    for each in (env, calm):
        each.reset(seed=0)
    actions = rng.uniform(-1.0, 1.0, (8, 11))
    assert env.step(actions)[2].all()
    assert not calm.step(actions)[2].any()
    calm.set_progress(1.0)
    assert calm.step(-actions)[2].all()
