"""Privileged observation: what a critic is told of the pushes to come."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.physics.pushes import PUSH_DURATION, Pushes
from surefoot.robots import Robot
from surefoot.task.privileged import LEVER_UNIT, SIGNS, PrivilegedObservation
from surefoot.task.random_pushes import LIFT, PUSH

NAMES = list(SIGNS)[:9]


def told(robot: Robot, body: str, force: tuple, tick: int, heading: complex = 1.0, lift: float = 0.0) -> dict:
    """What is told of a push that starts at tick 1000, and of one upwards 0.2 s before it."""
    pushes = Pushes(robot, 1, num_slots=2)
    for slot, impulse, start in ((PUSH, force, 1000), (LIFT, (0.0, 0.0, lift), 900)):
        pushes.schedule(np.array([0]), slot, robot.body_id(body), np.array(impulse), start, PUSH_DURATION)
    found = PrivilegedObservation(robot, robot.pose("bent")).next_push(pushes, np.array([tick]), np.array([heading]))
    return dict(zip(NAMES, found[0], strict=True))


@pytest.mark.parametrize(
    ("tick", "near", "left"),
    # Half a second before it: half near, of 100 / 200; in its middle, 30 of its 60 ticks are left.
    [(400, 0.0, 0.0), (750, 0.5, 0.25), (1000, 1.0, 0.5), (1030, 1.0, 0.25), (1060, 0.0, 0.0)],
)
def test_a_push_is_told_from_a_second_before_it_to_its_end(robot: Robot, tick: int, near: float, left: float) -> None:
    push = told(robot, "root", (0.0, 100.0, 0.0), tick)
    assert [push[name] for name in ("near", "impulse", "impulse_x", "impulse_y")] == pytest.approx(
        [near, left, 0, left]
    )
    assert push["side"] == push["lift"] == 0.0


def test_a_push_is_told_in_the_robots_heading(robot: Robot) -> None:
    push = told(robot, "root", (0.0, 100.0, 0.0), 1000, heading=1j)  # it faces left: the push comes along its x
    assert (push["impulse_x"], push["impulse_y"]) == pytest.approx((0.5, 0.0))


def test_the_pushed_body_is_told_by_its_height_and_its_side(robot: Robot) -> None:
    height = {body: -robot.lever_arm(robot.pose("bent"), body, 0.0) for body in ("torso", "left_shank", "right_shank")}
    assert height["torso"] > 0.1
    assert height["left_shank"] < -0.4
    for body, side in (("torso", 0.0), ("left_shank", 0.5), ("right_shank", -0.5)):
        push = told(robot, body, (0.0, -100.0, 0.0), 1000)
        assert push["side"] == side
        lever = 0.5 * height[body] / LEVER_UNIT
        assert [push[name] for name in ("lever", "lever_x", "lever_y")] == pytest.approx([lever, 0.0, -lever])


def test_a_push_upwards_is_told_too(robot: Robot) -> None:
    # At its start, 0.2 s before the other: 400 / 200; the other one is 0.8 near.
    push = told(robot, "root", (100.0, 0.0, 0.0), 900, lift=400.0)
    assert push["lift"] == pytest.approx(2.0)
    assert push["near"] == pytest.approx(0.8)


def test_a_mirrored_push_is_told_with_the_signs_of_a_mirror(robot: Robot) -> None:
    left = told(robot, "left_thigh", (30.0, 70.0, 0.0), 950, lift=200.0)
    right = told(robot, "right_thigh", (30.0, -70.0, 0.0), 950, lift=200.0)
    for name in NAMES:
        assert right[name] == pytest.approx(SIGNS[name] * left[name], abs=1e-3), name
