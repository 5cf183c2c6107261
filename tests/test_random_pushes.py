"""Who is pushed when, how hard and where in training: ranges, lifts, focus and rising ceilings."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import NUM_BODIES, write_wrench
from drawn_pushes import Slot, random_pushes

from surefoot.errors import UserError
from surefoot.physics.pushes import PUSH_DURATION
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.task.random_pushes import LIFT, RandomPushes


def test_the_papers_pushes_come_at_1_6_and_11_s_of_an_episode(robot: Robot) -> None:
    random, pushes = random_pushes(robot, 5)
    starts = []
    for tick in range(0, 16 * 500, TICKS_PER_STEP):
        random.advance(np.full(5, tick))
        starts.append(pushes.start.copy())
    per_robot = {tuple(np.unique(column)) for column in np.array(starts).T}
    # 1 s, 6 s, 11 s; and one at 16 s that the end of the episode forestalls.
    assert per_robot == {(500, 3000, 5500, 8000)}


def test_random_pushes_are_horizontal_isotropic_and_within_their_range(robot: Robot) -> None:
    n = 4000
    _, pushes = random_pushes(robot, n)
    impulse = pushes.force * PUSH_DURATION
    np.testing.assert_array_equal(impulse[:, 2], 0.0)
    magnitude = np.linalg.norm(impulse, axis=1)
    assert magnitude.min() > 26.5
    assert magnitude.max() < 106.0
    # Uniform: mean (26.5 + 106) / 2 = 66.25, deviation 79.5 / sqrt(12) = 22.9, of the mean of 4000 0.36.
    assert magnitude.mean() == pytest.approx(66.25, abs=4 * 0.36)
    assert magnitude.std() == pytest.approx(22.9, abs=0.7)
    # The mean of n unit vectors has components of deviation 1 / sqrt(2 n) = 0.011; four directions equally often.
    direction = impulse / magnitude[:, None]
    assert np.abs(direction.mean(axis=0)).max() < 4 * 0.0112
    quadrant = np.bincount(2 * (direction[:, 0] > 0) + (direction[:, 1] > 0), minlength=4)
    assert np.abs(quadrant - n / 4).max() < 4 * np.sqrt(n * 0.25 * 0.75)
    # Second moments: isotropy, not just symmetry.
    assert np.mean(direction[:, 0] ** 2) == pytest.approx(0.5, abs=4 * np.sqrt(1 / 8 / n))
    # Magnitude and direction are drawn apart.
    assert abs(np.corrcoef(magnitude, direction[:, 0])[0, 1]) < 4 / np.sqrt(n)


def test_ranges_of_bodies_start_and_interval_are_drawn_from(robot: Robot) -> None:
    n = 2000
    config = {"bodies": ("torso", "left_thigh"), "first": (0.5, 1.5), "interval": (2.0, 4.0), "duration": 0.2}
    random, pushes = random_pushes(robot, n, **config)
    first = pushes.start.copy()
    assert (first.min(), first.max()) == (pytest.approx(250, abs=3), pytest.approx(750, abs=3))
    np.testing.assert_array_equal(pushes.end - pushes.start, 100)  # 0.2 s
    bodies = [robot.body_id("torso"), robot.body_id("left_thigh")]
    assert set(pushes.body) == set(bodies)
    assert np.mean(pushes.body == bodies[0]) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(n))
    random.advance(np.full(n, 10_000))  # all are over
    wait = pushes.start - first
    assert (wait.min(), wait.max()) == (pytest.approx(1000, abs=5), pytest.approx(2000, abs=5))


def test_the_next_push_is_drawn_once_the_last_one_was_survived_for_2_s(robot: Robot) -> None:
    random, pushes = random_pushes(robot, 4)
    before = pushes.force.copy()
    # Before it, in it, and just before and at the policy step that ends 2 s after its start at tick 500.
    random.advance(np.array([0, 520, 1479, 1480]))
    np.testing.assert_array_equal(pushes.start, [500, 500, 500, 3000])
    np.testing.assert_array_equal(pushes.force[:3], before[:3])
    assert (pushes.force[3] != before[3]).any()


def test_pushes_that_follow_each_other_quickly_all_come(robot: Robot) -> None:
    random, _ = random_pushes(robot, 1, first=(0.5, 0.5), interval=(0.3, 0.3))
    wrench = np.zeros((1, TICKS_PER_STEP, NUM_BODIES, 6))
    pushed = []
    for tick in range(0, 1000, TICKS_PER_STEP):
        random.advance(np.array([tick]))
        write_wrench(random.pushes, wrench, np.array([tick]))
        pushed.append(wrench[0].any(axis=(1, 2)).copy())
    begins = np.flatnonzero(np.diff(np.concatenate([[False], *pushed]).astype(int)) == 1)
    np.testing.assert_array_equal(begins, [250, 400, 550, 700, 850])  # every 0.3 s


def test_a_long_push_is_not_cut_short_by_the_next_draw(robot: Robot) -> None:
    random, _ = random_pushes(robot, 1, duration=3.0)
    wrench = np.zeros((1, TICKS_PER_STEP, NUM_BODIES, 6))
    num_ticks = 0
    for tick in range(0, 3000, TICKS_PER_STEP):  # up to the second push
        random.advance(np.array([tick]))
        write_wrench(random.pushes, wrench, np.array([tick]))
        num_ticks += np.count_nonzero(wrench[0].any(axis=(1, 2)))
    assert num_ticks == 1500  # 3 s


def test_some_pushes_come_a_quarter_of_a_second_after_one_upwards(robot: Robot) -> None:
    n = 400
    config = {"impulse": (60.0, 60.0), "first": (1.0, 1.0), "lift": (200.0, 500.0), "lift_share": 0.25}
    random, pushes = random_pushes(robot, n, **config)
    lifts = Slot(random.pushes, LIFT)
    lifted = pushes.start == 620  # 1 s and 0.24 s, at 500 ticks a second
    assert lifted.mean() == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / n))
    assert set(pushes.start[~lifted]) == {500}
    assert set(lifts.start[lifted]) == {500}
    assert (lifts.start[~lifted] > 10**9).all()  # none
    size = np.linalg.norm(pushes.force, axis=1) * 0.12
    np.testing.assert_allclose(size, np.where(lifted, 30.0, 60.0))
    impulse = lifts.force[lifted] * 0.12
    np.testing.assert_array_equal(impulse[:, :2], 0.0)
    assert 200.0 <= impulse[:, 2].min() < 230.0
    assert 470.0 < impulse[:, 2].max() <= 500.0


def test_a_share_of_the_pushes_is_small(robot: Robot) -> None:
    n = 2000
    _, pushes = random_pushes(robot, n, impulse=(100.0, 400.0), small=(6.0, 90.0), small_share=0.25)
    size = np.linalg.norm(pushes.force, axis=1) * PUSH_DURATION
    small = size < 95.0
    assert small.mean() == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / n))
    # Uniform over 84 Ns: the mean is 48, its deviation 84 / sqrt(12 * 500) = 1.1.
    assert size[small].mean() == pytest.approx(48.0, abs=4 * 1.1)
    assert size[~small].min() > 100.0


def test_the_latest_push_is_the_one_that_has_begun(robot: Robot) -> None:
    random, pushes = random_pushes(robot, 2, impulse=(60.0, 60.0), first=(1.0, 1.0), interval=(4.0, 4.0))
    pushes.start[1] = 900
    impulse, since = random.latest(np.array([520, 520]))
    np.testing.assert_allclose(impulse, [60.0, 0.0])  # the second robot waits for its first one
    np.testing.assert_array_equal(since, [20, 520])
    random.advance(np.array([1600, 1600]))  # robot 0's next push is drawn for tick 2500
    assert pushes.start[0] == 2500
    np.testing.assert_array_equal(random.latest(np.array([1620, 1620]))[1], [1120, 720])
    random.reset(np.array([0]))
    np.testing.assert_allclose(random.latest(np.array([0, 1640]))[0], [0.0, 60.0])


def test_pushes_with_a_push_upwards_count_as_larger_than_any(robot: Robot) -> None:
    config = {"impulse": (60.0, 60.0), "first": (1.0, 1.0), "lift": (200.0, 500.0), "lift_share": 0.5}
    random, pushes = random_pushes(robot, 8, **config)
    lifted = pushes.start > 500
    assert 0 < lifted.sum() < 8
    np.testing.assert_array_equal(random.latest(np.full(8, 700))[0], np.where(lifted, np.inf, 60.0))


# Focus.

SIDE, BACK = 4, 8
"""Sectors of 22.5 degrees, counter-clockwise from forward."""


def focused(robot: Robot, n: int, **config: object) -> tuple[RandomPushes, Slot]:
    """Pushes of 30 to 300 Ns of which none have fallen yet."""
    random, pushes = random_pushes(robot, n, impulse=(30.0, 300.0), **config)
    random.falls.share[:] = 0.0
    return random, pushes


def drawn(pushes: Slot) -> tuple[np.ndarray, np.ndarray]:
    """Directions [degrees] and impulses [Ns]."""
    x, y, _ = pushes.force.T * PUSH_DURATION
    return np.degrees(np.arctan2(y, x)), np.hypot(x, y)


def test_pushes_with_a_focus_go_where_robots_sometimes_fall(robot: Robot) -> None:
    n = 2000
    random, pushes = focused(robot, n, bodies=("torso", "root", "root"), focus=0.5)
    # All fall where the weight f (1 - f) is 0 too; the root sometimes at 120 to 150 Ns about 45 degrees to a side.
    random.falls.share[0, 6], random.falls.share[1, 2, 4] = 1.0, 0.3
    random.reset(np.arange(n))
    degrees, impulse = drawn(pushes)
    there = (np.abs(np.abs(degrees) - 45.0) <= 11.25 + 1e-9) & (impulse >= 120.0) & (impulse <= 150.0)
    there &= pushes.body == robot.body_id("root")
    # And of the others, uniform over two bodies in three, 16 directions and 270 Ns: 2/3 * 2/16 * 30/270 = 0.0093.
    assert there.mean() == pytest.approx(0.5 * (1.0 + 0.0093), abs=4 * 0.5 / np.sqrt(n))
    assert np.mean(degrees[there] > 0.0) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(n / 2))


def test_one_thigh_pushed_outwards_is_the_other_in_the_mirror(robot: Robot) -> None:
    n = 400
    random, pushes = focused(robot, n, bodies=("left_thigh", "right_thigh"), focus=1.0)
    assert random.falls.share.shape == (1, 16, 10)
    random.falls.share[0, SIDE, 5] = 0.5
    random.reset(np.arange(n))
    degrees, _ = drawn(pushes)
    left = pushes.body == robot.body_id("left_thigh")
    np.testing.assert_array_equal(pushes.body[~left], robot.body_id("right_thigh"))
    assert left.mean() == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(n))
    np.testing.assert_allclose(np.where(left, degrees, -degrees), 90.0, atol=11.25 + 1e-9)
    # Of all that fall the left thigh's share rises: 1 - 0.5 * 0.95^400 is 1.
    random.fell(np.arange(n), pushes.start + 100)
    assert random.falls.share[0, SIDE, 5] == pytest.approx(1.0)
    assert np.count_nonzero(random.falls.share) == 1


def test_falls_are_counted_with_the_mirror_image_and_forgotten_slowly(robot: Robot) -> None:
    random, pushes = focused(robot, 1, focus=1.0)
    random.falls.share[0, SIDE, 2] = 0.5
    random.reset(np.array([0]))  # 60 to 90 Ns to one side
    random.fell(np.array([0]), pushes.start + 100)
    assert random.falls.share[0, SIDE, 2] == pytest.approx(0.95 * 0.5 + 0.05)
    random.advance(pushes.start + 1000)  # and survived
    assert random.falls.share[0, SIDE, 2] == pytest.approx(0.95 * (0.95 * 0.5 + 0.05))
    assert np.count_nonzero(random.falls.share) == 1


def test_pushes_in_the_middle_are_thought_to_fall_half_the_time_at_first_on_one_side_only(robot: Robot) -> None:
    random, _ = random_pushes(robot, 1, bodies=("root", "left_shank", "right_shank"), focus=0.5)
    root, shank = random.falls.share
    assert (root[: BACK + 1] == 0.5).all()
    assert (root[BACK + 1 :] == 0.0).all()
    assert (shank == 0.5).all()


# What users and seeds decide.


def test_the_same_seed_draws_the_same_pushes_and_another_does_not(robot: Robot) -> None:
    draws = []
    for seed in (7, 7, 8):
        random, pushes = random_pushes(robot, 10, seed, interval=(1.0, 5.0), bodies=("root", "torso"))
        random.advance(np.full(10, 560))
        draws.append(np.column_stack([pushes.start, pushes.body, pushes.force]))
    np.testing.assert_array_equal(draws[0], draws[1])
    assert (draws[0] != draws[2]).any()


def test_an_unknown_body_is_answered_with_the_known_ones(robot: Robot) -> None:
    with pytest.raises(UserError) as error:
        random_pushes(robot, 1, bodies=("root", "knee"))
    valid = "pelvis, torso, left_thigh, right_thigh, left_shank, right_shank"
    assert str(error.value) == f"unknown body 'knee' of valkyrie; valid: {valid}"


def test_impulses_are_scaled_by_the_body_that_is_pushed(robot: Robot) -> None:
    _, pushes = random_pushes(robot, 400, bodies=("root", "torso"), impulse=(50.0, 50.0), body_scale=(1.0, 0.6))
    magnitude = np.linalg.norm(pushes.force, axis=1) * PUSH_DURATION
    np.testing.assert_allclose(magnitude[pushes.body == robot.body_id("root")], 50.0)
    np.testing.assert_allclose(magnitude[pushes.body == robot.body_id("torso")], 30.0)


def test_pushes_can_be_mostly_forward_and_backward(robot: Robot) -> None:
    n = 8000
    _, pushes = random_pushes(robot, n, sagittal=0.3)
    angle = np.arctan2(pushes.force[:, 1], pushes.force[:, 0])
    # Angles a = u - 0.3 sin(2 u) of a uniform u. Within 15 degrees of forward |u| < 0.545: u - 0.3 sin(2 u) = 0.262
    # there, so that 2 x 2 x 0.545 / (2 pi) = 0.347 of them go forward or backward; without it 1 / 6.
    share = np.mean(np.abs(np.sin(angle)) < np.sin(np.radians(15.0)))
    assert share == pytest.approx(0.347, abs=4 * np.sqrt(0.347 * 0.653 / n))
    assert abs(np.mean(np.cos(angle))) < 0.04  # forward as often as backward


def test_a_share_of_the_pushes_is_hard(robot: Robot) -> None:
    n = 4000
    _, pushes = random_pushes(robot, n, impulse=(0.0, 100.0), survival_target=0.5, hard_share=0.6)
    magnitude = np.linalg.norm(pushes.force, axis=1) * PUSH_DURATION
    # Hard ones lie above 70 Ns, as do 0.3 of the others: 0.6 + 0.4 x 0.3 = 0.72.
    assert np.mean(magnitude > 70.0) == pytest.approx(0.72, abs=4 * np.sqrt(0.72 * 0.28 / n))
    assert magnitude.max() < 100.0


def test_advance_tells_who_has_survived(robot: Robot) -> None:
    random, pushes = random_pushes(robot, 3, first=(1.0, 1.0))
    assert random.advance(np.zeros(3, np.int64)).tolist() == []
    pushes.start[1] = 10_000
    # Pushes begin at 1 s; 2 s later, less the policy step in which the next one is drawn, they are survived.
    assert random.advance(np.full(3, 1500)).tolist() == [0, 2]
