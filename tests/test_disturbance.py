from __future__ import annotations

import numpy as np
import pytest
from conftest import NUM_BODIES, step_to, write_wrench

from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.pushes import PUSH_DURATION, Push, Pushes
from surefoot.rates import CONTROL_DT, TICKS_PER_STEP
from surefoot.robots import Robot


def written(pushes: Pushes, num_steps: int, num_robots: int = 1) -> np.ndarray:
    """Wrenches over the first policy steps, (num_robots, num_steps * 20, num_bodies, 6)."""
    wrench = np.zeros((num_robots, TICKS_PER_STEP, NUM_BODIES, 6))
    steps = []
    for step in range(num_steps):
        write_wrench(pushes, wrench, np.full(num_robots, step * TICKS_PER_STEP))
        steps.append(wrench.copy())
    return np.concatenate(steps, axis=1)


def one_push(robot: Robot, start: int, duration: float = PUSH_DURATION, body: str = "root") -> Pushes:
    pushes = Pushes(robot, 1)
    impulse = np.array([[12.0, -24.0, 6.0]])
    pushes.schedule(np.array([0]), 0, np.array([robot.body_id(body)]), impulse, np.array([start]), duration)
    return pushes


def test_the_papers_push_lasts_120_ms_on_the_root() -> None:
    assert Push() == Push("root", (1.0, 0.0, 0.0), 0.0, 0.0, 0.12)


@pytest.mark.parametrize("start", [0, 7, 19, 20, 53])
def test_the_force_acts_at_60_ticks_from_the_first_however_it_lies_in_the_policy_steps(
    robot: Robot, start: int
) -> None:
    force = written(one_push(robot, start), 8)[0, :, robot.body_id("root"), :3]
    # 0.12 s / 2 ms = 60 ticks of (12, -24, 6) Ns / 0.12 s = (100, -200, 50) N
    expected = np.zeros((160, 3))
    expected[start : start + 60] = [100.0, -200.0, 50.0]
    np.testing.assert_allclose(force, expected, rtol=1e-14)
    assert np.count_nonzero(force.any(axis=1)) == 60


@pytest.mark.parametrize(("duration", "num_ticks"), [(0.12, 60), (0.025, 12), (0.04, 20), (0.001, 1), (0.0, 1)])
def test_the_impulse_is_exact_whatever_the_duration(robot: Robot, duration: float, num_ticks: int) -> None:
    wrench = written(one_push(robot, 11, duration), 6)
    force = wrench[0, :, robot.body_id("root"), :3]
    assert np.count_nonzero(force.any(axis=1)) == num_ticks
    np.testing.assert_allclose(force.sum(axis=0) * CONTROL_DT, [12.0, -24.0, 6.0], rtol=1e-12)


def test_nothing_but_the_pushed_body_feels_a_force_and_no_body_a_torque(robot: Robot) -> None:
    wrench = written(one_push(robot, 5, body="left_shank"), 5)[0]
    others = np.delete(wrench, robot.body_id("left_shank"), axis=1)
    np.testing.assert_array_equal(others, 0.0)
    np.testing.assert_array_equal(wrench[..., 3:], 0.0)
    assert wrench.any()


def test_the_wrench_is_zero_again_once_the_push_is_over(robot: Robot) -> None:
    wrench = written(one_push(robot, 30), 6)[0]
    assert wrench[30:90].any(axis=(1, 2)).all()
    np.testing.assert_array_equal(wrench[90:], 0.0)


def test_a_cancelled_push_stops_at_the_next_step(robot: Robot) -> None:
    pushes = one_push(robot, 0)
    wrench = np.zeros((1, TICKS_PER_STEP, NUM_BODIES, 6))
    write_wrench(pushes, wrench, np.array([0]))
    assert wrench.any()
    pushes.cancel(np.array([0]))
    write_wrench(pushes, wrench, np.array([20]))
    np.testing.assert_array_equal(wrench, 0.0)


def test_robots_are_pushed_each_at_its_own_body_time_and_clock(robot: Robot) -> None:
    pushes = Pushes(robot, 3)
    bodies = np.array([robot.body_id("root"), robot.body_id("torso")])
    impulse = np.array([[6.0, 0.0, 0.0], [0.0, 12.0, 0.0]])
    pushes.schedule(np.array([0, 2]), 0, bodies, impulse, np.array([3, 1008]), 0.12)
    wrench = np.zeros((3, TICKS_PER_STEP, NUM_BODIES, 6))
    write_wrench(pushes, wrench, np.array([0, 0, 1000]))  # robot 2 is already in its tick 1000
    expected = np.zeros_like(wrench)
    expected[0, 3:, bodies[0], 0] = 50.0  # 6 Ns / 0.12 s
    expected[2, 8:, bodies[1], 1] = 100.0
    np.testing.assert_allclose(wrench, expected, rtol=1e-14)


def test_a_new_push_replaces_one_on_another_body(robot: Robot) -> None:
    pushes = one_push(robot, 0, body="torso")
    wrench = np.zeros((1, TICKS_PER_STEP, NUM_BODIES, 6))
    write_wrench(pushes, wrench, np.array([0]))
    root = robot.body_id("root")
    pushes.schedule(np.array([0]), 0, np.array([root]), np.array([[0.0, 0.0, 1.2]]), np.array([20]), 0.12)
    write_wrench(pushes, wrench, np.array([20]))
    np.testing.assert_array_equal(wrench[0, :, robot.body_id("torso")], 0.0)
    np.testing.assert_allclose(wrench[0, :, root, 2], 10.0)


def test_a_push_gives_a_flying_robot_its_impulse(robot: Robot) -> None:
    engine = MujocoEngine(robot, 1, num_threads=1)
    pose = robot.pose("bent")[None]
    engine.reset(np.array([0]), pose, height=5.0)
    pushes = one_push(robot, 13)
    for step in range(5):
        write_wrench(pushes, engine.wrench, np.array([step * TICKS_PER_STEP]))
        ticks = step_to(engine, np.tile(pose[:, None], (1, TICKS_PER_STEP, 1)))
    # 19 ticks after the record's first: 99 steps of gravity; m v = J.
    momentum = 137.2875 * ticks.com_velocity[0, -1]
    np.testing.assert_allclose(momentum, [12.0, -24.0, 6.0 - 1346.33 * 99 * 0.002], atol=0.02)


# Levers, and two pushes at once.


def test_a_lever_arm_gives_a_torque_of_arm_times_force(robot: Robot) -> None:
    pushes = Pushes(robot, 2)
    impulse = np.array([[12.0, -24.0, 6.0], [12.0, -24.0, 6.0]])
    pushes.schedule(
        np.arange(2), 0, np.full(2, robot.body_id("torso")), impulse, np.zeros(2), 0.12, np.array([0.3, -0.5])
    )
    wrench = written(pushes, 1, num_robots=2)[:, 0, robot.body_id("torso")]
    # (0, 0, h) x (100, -200, 50) N = (200 h, 100 h, 0) Nm
    np.testing.assert_allclose(wrench[:, :3], [[100.0, -200.0, 50.0]] * 2, rtol=1e-14)
    np.testing.assert_allclose(wrench[:, 3:], [[60.0, 30.0, 0.0], [-100.0, -50.0, 0.0]], rtol=1e-14)


@pytest.mark.parametrize(
    ("body", "lever", "arm"),
    [
        # Straight, from the root frame up (test_robot.py): the robot's CoM is at -0.0672277, the root's at
        # -0.0544803, the torso's at 0.2336136, the thigh's at -0.454075, the shank's at -0.866577.
        ("root", 0.0, -0.0672277 + 0.0544803),
        ("torso", 0.32, 0.32 - 0.0672277 - 0.2336136),
        ("left_thigh", -0.50, -0.50 - 0.0672277 + 0.454075),
        ("left_shank", -0.70, -0.70 - 0.0672277 + 0.866577),
    ],
)
def test_a_lever_counts_from_the_robots_com_an_arm_from_the_bodys(
    robot: Robot, body: str, lever: float, arm: float
) -> None:
    assert robot.lever_arm(robot.pose("straight"), body, lever) == pytest.approx(arm, abs=2e-6)


@pytest.mark.parametrize(
    ("body", "lever"), [("root", 0.0), ("torso", 0.32), ("left_thigh", -0.5), ("left_shank", -0.7)]
)
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0)])
def test_a_push_with_a_lever_turns_a_flying_robot_about_its_com(
    robot: Robot, body: str, lever: float, direction: tuple[float, float]
) -> None:
    engine = MujocoEngine(robot, 1, num_threads=1)
    pose = robot.pose("bent")
    engine.reset(np.array([0]), pose[None], height=5.0)
    pushes = Pushes(robot, 1)
    impulse = 10.0 * np.array([[*direction, 0.0]])
    arm = robot.lever_arm(pose, body, lever)
    pushes.schedule(np.array([0]), 0, np.array([robot.body_id(body)]), impulse, np.array([5]), CONTROL_DT, arm)
    write_wrench(pushes, engine.wrench, np.array([0]))
    momentum = step_to(engine, np.tile(pose, (1, TICKS_PER_STEP, 1))).angular_momentum[0]
    # (0, 0, lever) x J, at once; what the joints do about it afterwards changes nothing. About z it is the body's
    # place in the horizontal plane that counts.
    expected = 10.0 * lever * np.array([-direction[1], direction[0]])
    np.testing.assert_allclose(momentum[:6], 0.0, atol=1e-6)
    np.testing.assert_allclose(momentum[8, :2], expected, atol=0.02)


def both_written(robot: Robot, bodies: tuple[str, str], starts: tuple[int, int], num_steps: int = 6) -> np.ndarray:
    """Wrenches of a push of (12, 0, 0) Ns and one of (0, 6, 0) Ns, (num_ticks, num_bodies, 6)."""
    pushes, impulses = Pushes(robot, 1, num_slots=2), np.array([[12.0, 0.0, 0.0], [0.0, 6.0, 0.0]])
    for slot in (0, 1):
        pushes.schedule(np.array([0]), slot, robot.body_id(bodies[slot]), impulses[slot], starts[slot], 0.12)
    return written(pushes, num_steps)[0]


@pytest.mark.parametrize("bodies", [("root", "root"), ("root", "torso"), ("torso", "root")])
@pytest.mark.parametrize("starts", [(0, 0), (5, 31), (40, 3)])
def test_overlapping_pushes_add_up(robot: Robot, bodies: tuple[str, str], starts: tuple[int, int]) -> None:
    expected = np.zeros((120, NUM_BODIES, 6))
    # 60 ticks of 12 Ns / 0.12 s = 100 N and of 50 N
    expected[starts[0] : starts[0] + 60, robot.body_id(bodies[0]), 0] += 100.0
    expected[starts[1] : starts[1] + 60, robot.body_id(bodies[1]), 1] += 50.0
    np.testing.assert_allclose(both_written(robot, bodies, starts), expected, rtol=1e-14)


@pytest.mark.parametrize("num_slots", [1, 2, 3, 5])
def test_a_robot_feels_the_sum_of_the_pushes_in_all_its_slots(robot: Robot, num_slots: int) -> None:
    pushes = Pushes(robot, 2, num_slots)
    for slot in range(num_slots):
        # 0.12, 0.24, ... Ns / 0.12 s = 1, 2, ... N; each begins ten ticks after the one before.
        impulse = np.array([0.12 * (slot + 1), 0.0, 0.0])
        pushes.schedule(np.array([1]), slot, robot.body_id("torso"), impulse, 10 * slot, 0.12)
    wrench = written(pushes, 2, num_robots=2)
    assert not wrench[0].any()
    # At tick 39 the first four have begun, as far as there are so many: 1 + 2 + 3 + 4 N.
    assert wrench[1, 39, robot.body_id("torso"), 0] == pytest.approx(sum(range(1, min(num_slots, 4) + 1)))
    pushes.cancel(np.array([1]), num_slots - 1)
    assert written(pushes, 4, 2)[1, 79, :, 0].sum() == pytest.approx(sum(n for n in range(1, num_slots) if n > 2))


def test_write_names_the_robots_whose_wrenches_it_has_touched(robot: Robot) -> None:
    pushes, wrench = Pushes(robot, 4, num_slots=2), np.zeros((4, TICKS_PER_STEP, NUM_BODIES, 6))
    assert not len(pushes.write(wrench, np.zeros(4, np.int64)))
    for ids, slot in (([1, 3], 0), ([3], 1)):
        pushes.schedule(np.array(ids), slot, robot.body_id("root"), np.array([1.0, 0.0, 0.0]), 30, 0.12)
    assert not len(pushes.write(wrench, np.zeros(4, np.int64)))
    touched = pushes.write(wrench, np.full(4, 20))
    assert sorted(set(touched.tolist())) == [1, 3]
    wrench[touched] = 0.0
    assert not wrench.any()
