"""Ceilings: each direction's pushes grow while robots survive them, and shrink while they do not."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_pushes import random_pushes

from surefoot.physics.pushes import PUSH_DURATION
from surefoot.robots import Robot
from surefoot.task.random_pushes import PUSH, RandomPushes


def give_push(random: RandomPushes, degrees: float, impulse: float) -> None:
    """Robot 0's next push: drawn until it is the one wanted, within 11.25 degrees and 5 %."""
    for _ in range(100_000):
        random.reset(np.array([0]))
        x, y, _ = random.pushes.force[0, PUSH] * PUSH_DURATION
        off = (np.degrees(np.arctan2(y, x)) - degrees + 180.0) % 360.0 - 180.0
        if abs(off) < 11.25 and abs(np.hypot(x, y) / impulse - 1.0) < 0.05:
            return
    raise AssertionError("no such push is ever drawn")


def test_without_a_target_of_survival_the_ceiling_is_the_ranges_end_for_ever(robot: Robot) -> None:
    random, _ = random_pushes(robot, 8)
    for tick in (1500, 4000, 6500):
        random.advance(np.full(8, tick))
    random.fell(np.arange(8), np.full(8, 9000))
    np.testing.assert_array_equal(random.ceiling, np.full(16, 106.0))


# With this target every direction begins at 60 Ns and ends at 300.
RISING = {"survival_target": 0.6, "impulse": (10.0, 60.0), "max_impulse": 300.0}


def test_a_ceiling_begins_at_the_ranges_upper_end_in_every_direction(robot: Robot) -> None:
    _, pushes = random_pushes(robot, 2000, **RISING)
    magnitude = np.linalg.norm(pushes.force, axis=1) * PUSH_DURATION
    assert (magnitude.min(), magnitude.max()) == (pytest.approx(10.0, abs=0.2), pytest.approx(60.0, abs=0.2))


@pytest.mark.parametrize(("degrees", "sector"), [(0.0, 0), (90.0, 4), (180.0, 8), (-90.0, 12), (-22.5, 15)])
def test_a_survived_hard_push_raises_its_own_sector_only(robot: Robot, degrees: float, sector: int) -> None:
    random, pushes = random_pushes(robot, 1, **RISING)
    give_push(random, degrees, 55.0)  # hard: above 0.7 * 60 = 42 Ns
    random.advance(pushes.start + 1000)  # 2 s later
    expected = np.full(16, 60.0)
    expected[sector] += 4.0 * (1.0 - 0.6)
    np.testing.assert_allclose(random.ceiling, expected, rtol=1e-14)


def test_a_fall_after_a_hard_push_sinks_its_own_sector_only(robot: Robot) -> None:
    random, pushes = random_pushes(robot, 1, **RISING)
    random.ceiling += 10.0
    give_push(random, 90.0, 65.0)
    random.fell(np.array([0]), pushes.start + 300)
    expected = np.full(16, 70.0)
    expected[4] -= 4.0 * 0.6
    np.testing.assert_allclose(random.ceiling, expected, rtol=1e-14)


def test_weak_pushes_and_falls_before_the_push_teach_nothing(robot: Robot) -> None:
    random, pushes = random_pushes(robot, 1, **RISING)
    random.ceiling += 10.0
    give_push(random, 0.0, 30.0)
    random.fell(np.array([0]), pushes.start + 300)
    give_push(random, 0.0, 30.0)
    random.advance(pushes.start + 1000)
    give_push(random, 0.0, 65.0)
    random.fell(np.array([0]), pushes.start - 1)
    np.testing.assert_array_equal(random.ceiling, np.full(16, 70.0))


def test_the_ceiling_settles_where_the_share_survived_is_the_one_asked_for(robot: Robot) -> None:
    """A robot that survives exactly the pushes below 150 Ns, from every direction."""
    n = 48
    random, pushes = random_pushes(robot, n, **RISING)
    everyone = np.arange(n)
    ceilings = []
    for _ in range(1000):
        falls = np.linalg.norm(pushes.force, axis=1) * PUSH_DURATION > 150.0
        random.fell(everyone[falls], pushes.start[falls] + 100)
        random.reset(everyone[falls])
        random.advance(np.where(falls, 0, pushes.start + 1000))
        pushes.start -= pushes.start - 500  # each begins anew
        ceilings.append(random.ceiling.mean())
    # Hard pushes are uniform above 0.7 c, and nearly none is below 10: 60 % of (0.7 c, c) survive when
    # 0.7 c + 0.6 * 0.3 c = 0.88 c = 150, c = 170 Ns.
    assert np.mean(ceilings[-500:]) == pytest.approx(150.0 / 0.88, rel=0.03)


def test_a_ceiling_never_leaves_its_range(robot: Robot) -> None:
    random, pushes = random_pushes(robot, 300, survival_target=0.5, impulse=(80.0, 85.0), max_impulse=90.0)
    for _ in range(30):
        magnitude = np.linalg.norm(pushes.force, axis=1) * PUSH_DURATION
        assert magnitude.min() > 80.0 - 1e-9
        assert magnitude.max() < 90.0 + 1e-9
        random.advance(pushes.start + 1000)
    random.fell(np.repeat(np.arange(300), 100), np.repeat(pushes.start + 1, 100))
    assert random.ceiling.min() == 85.0
