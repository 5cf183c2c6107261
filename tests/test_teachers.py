"""Teachers: to whom a student's robots listen, and what they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import TIPTOE, make_env
from constant_policy import constant

from surefoot.agents.network import NetworkAgent
from surefoot.errors import UserError
from surefoot.learning.capture_points import from_feet, held_capture_points
from surefoot.learning.teachers import Teacher, Teachers
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.robots import Robot, load_robot
from surefoot.task import observation
from surefoot.task.random_pushes import DisturbanceConfig


def agent(robot: Robot, action: float, scale: float = 0.8) -> NetworkAgent:
    return NetworkAgent(constant(robot, action, scale), f"always {action}")


def pushed(impulse: float, num_robots: int = 1, **config: object) -> DisturbanceConfig:
    return DisturbanceConfig(impulse=(impulse, impulse), first=(0.2, 0.2), **config)


def test_a_robot_listens_to_the_teacher_for_what_it_has_felt_so_far(robot: Robot) -> None:
    env = make_env(1, pose="bent", action_scale=0.8, disturbance=pushed(120.0))
    teachers = Teachers([Teacher(agent(robot, 0.0)), Teacher(agent(robot, 0.1), {"root": [50.0]})], env)
    env.reset(seed=0)
    clear = env.loop.observe(slice(None), with_errors=False)
    teachers.begin(clear)
    levels, felt = [], []
    for _ in range(8):
        env.step(np.zeros((1, 11)))
        teachers.update(env.loop.observe(slice(None)), np.zeros(1, bool))
        levels.append(int(teachers.level[0]))
        felt.append(round(float(np.abs(env.felt_push()[1][0])), 6))
    # The push of 1000 N begins at 0.2 s, after five policy steps, and gives 40 Ns in each of three.
    assert felt == [0, 0, 0, 0, 0, 40, 80, 120]
    assert levels == [0, 0, 0, 0, 0, 0, 1, 1]


def test_borders_depend_on_the_direction_as_the_robot_sees_it(robot: Robot) -> None:
    env = make_env(32, pose="bent", action_scale=0.8, disturbance=pushed(60.0))
    # 100 Ns forward and backward, 20 Ns to the sides: 60 Ns are beyond the border nearer to the sides than 45 degrees.
    borders = {"root": [100.0, 20.0, 100.0, 20.0]}
    teachers = Teachers([Teacher(agent(robot, 0.0)), Teacher(agent(robot, 0.1), borders)], env)
    env.reset(seed=0)
    teachers.begin(env.loop.observe(slice(None)))
    for _ in range(8):
        env.step(np.zeros((32, 11)))
        teachers.update(env.loop.observe(slice(None)), np.zeros(32, bool))
    _, impulse = env.felt_push()
    np.testing.assert_allclose(np.abs(impulse), 60.0)
    away = np.degrees(np.arcsin(np.abs(impulse.imag) / 60.0))
    clear = np.abs(away - 45.0) > 2.0
    np.testing.assert_array_equal(teachers.level[clear], (away > 45.0)[clear])


def reached(robot: Robot, impulse: float, reach: float, num_robots: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Push robots that hold their pose at 0.2 s, with no border but the capture point's.

    Returns:
        levels, and how far the capture points are from their place [m], after each of eight policy steps: (8, N) each.
    """
    env = make_env(num_robots, pose="bent", action_scale=0.8, disturbance=pushed(impulse))
    second = Teacher(agent(robot, 0.1), {"root": [1000.0]}, capture_point=[reach] * 4)
    teachers = Teachers([Teacher(agent(robot, 0.0)), second], env)
    env.reset(seed=0)
    clear = env.loop.observe(slice(None))
    teachers.begin(clear)
    home = np.median(from_feet(robot, clear), axis=0)
    levels, away = [], []
    for _ in range(8):
        env.step(np.zeros((num_robots, 11)))
        clear = env.loop.observe(slice(None))
        teachers.update(clear, np.zeros(num_robots, bool))
        levels.append(teachers.level.copy())
        away.append(np.linalg.norm(from_feet(robot, clear) - home, axis=1))
    return np.array(levels), np.array(away)


def test_a_robot_whose_capture_point_is_out_of_reach_listens_to_the_second_teacher_whatever_it_has_felt(
    robot: Robot,
) -> None:
    levels, away = reached(robot, 24.0, reach=0.025, num_robots=32)
    np.testing.assert_array_equal(levels, np.maximum.accumulate(away, axis=0) > 0.025)
    # 24 Ns on 137 kg are 0.17 m/s; times sqrt(z / g) of about 0.32 s that is 5.6 cm, in three steps of less than 2 cm:
    # no robot is 2 cm beyond the border at the next step that is not beyond it now.
    assert (levels[-1] == 1).all()


def test_a_hard_push_hands_over_before_the_capture_point_is_out_of_reach(robot: Robot) -> None:
    # 300 Ns give 137 kg 0.73 m/s in each policy step, and the capture point with 0.32 s some 23 cm. The filter shows
    # half of the first step: 12 cm are within 13 cm, but 24 cm after another such step are more than 2 cm beyond.
    levels, away = reached(robot, 300.0, reach=0.13)  # the push begins with the sixth policy step
    assert 0.08 < away[5, 0] < 0.13
    assert levels[5, 0] == 1
    # 40 Ns are 3 cm in each step: three of them are 9 cm, and a fourth one would lead to 12 cm.
    levels, away = reached(robot, 40.0, reach=0.13)
    assert (levels == 0).all()
    assert away.max() < 0.13


def test_a_robot_that_falls_fast_listens_to_the_teacher_for_that_and_a_dropped_one_at_least_to_the_second(
    robot: Robot,
) -> None:
    config = {"drop_share": 1.0, "drop_height": (1.0, 1.0), "disturbance": pushed(60.0)}
    env = make_env(1, pose="bent", action_scale=0.8, **config)
    second, third = Teacher(agent(robot, 0.1), {"root": [1e3]}), Teacher(agent(robot, 0.2), falling=2.0)
    teachers = Teachers([Teacher(agent(robot, 0.0)), second, third], env)
    env.reset(seed=0)
    teachers.begin(env.loop.observe(slice(None)))
    levels = []
    for _ in range(8):
        env.step(np.zeros((1, 11)))
        teachers.update(env.loop.observe(slice(None)), np.zeros(1, bool))
        levels.append(int(teachers.level[0]))
    # g t is 2 m/s at 0.204 s, and at 0.24 s, the end of the sixth policy step, 2.4 m/s, of which the filter shows more
    # than 2. 60 Ns at 0.2 s are 0.4 m/s, none of them downwards.
    assert levels == [1, 1, 1, 1, 1, 2, 2, 2]


def test_a_dropped_robot_that_leans_listens_to_the_teacher_for_that_until_it_has_landed(robot: Robot) -> None:
    def levels(lean: float) -> list[int]:
        env = make_env(1, pose="bent", action_scale=0.8, drop_share=1.0, drop_height=(0.3, 0.3))
        second, third = Teacher(agent(robot, 0.1)), Teacher(agent(robot, 0.2), leaning=0.1)
        teachers = Teachers([Teacher(agent(robot, 0.0)), second, third], env)
        env.reset(seed=0)
        at_rest = env.loop.observe(slice(None))
        teachers.begin(at_rest)
        at_rest[0, observation.parts(robot).index(("root_attitude", "roll"))] = lean
        found = []
        for _ in range(3):
            env.step(np.zeros((1, 11)))
            teachers.update(at_rest, np.zeros(1, bool))
            found.append(int(teachers.level[0]))
        return found

    assert levels(0.09) == [1, 1, 1]
    assert levels(-0.11) == [2, 2, 2]


def test_teachers_may_be_for_a_robot_whose_root_is_no_pelvis() -> None:
    env = make_env(1, robot=str(TIPTOE), pose="crouched")
    assert "base_attitude.roll" in observation.component_names(env.robot)
    still = NetworkAgent(constant(env.robot, 0.0, pose="crouched"), "still")
    teachers = Teachers([Teacher(still), Teacher(still, leaning=0.1)], env)
    env.reset(seed=0)
    observations = env.loop.observe(slice(None))
    teachers.begin(observations)
    teachers.update(observations, np.zeros(1, bool))
    assert teachers.level.tolist() == [0]


def test_for_a_robot_with_more_than_half_of_the_noise_the_border_is_nearer(robot: Robot) -> None:
    env = make_env(1, pose="bent", action_scale=0.8, disturbance=pushed(24.0))
    env.reset(seed=0)
    start = env.loop.observe(slice(None))
    for _ in range(8):
        env.step(np.zeros((1, 11)))
    pushed_away = env.loop.observe(slice(None))
    away = float(np.linalg.norm(from_feet(robot, pushed_away) - from_feet(robot, start)))
    second = Teacher(agent(robot, 0.1), capture_point=[1.6 * away] * 4, under_noise=0.5)
    teachers = Teachers([Teacher(agent(robot, 0.0)), second], env)
    levels = []
    for noise in (0.0, 0.5, 0.6, 1.0):
        env.noise_share[:] = noise
        teachers.begin(start)
        teachers.update(pushed_away, np.ones(1, bool))
        levels.append(int(teachers.level[0]))
    # The border is 1.6 times as far as the capture point, and half of it, 0.8, for a robot with much noise.
    assert levels == [0, 0, 1, 1]


def test_a_capture_point_that_is_held_is_nearer_than_one_that_is_lost(robot: Robot) -> None:
    config = make_env(1, pose="bent", action_scale=0.8).config
    held = held_capture_points(agent(robot, 0.0), config, num_threads=1, num_robots=48)
    # Without turning the trunk or the arms nothing brings a capture point back that has left the soles, whose corners
    # are farthest away; while it holds its pose, a robot turns its trunk a little.
    start = MujocoEngine(robot, 1).reset(np.array([0]), robot.pose("bent")[None], height=1.0)
    polygon = start.flat_support_polygon()
    corner = np.linalg.norm(polygon - polygon.mean(axis=0), axis=1).max()
    assert len(held) == 16
    assert 0.02 < min(held) < max(held) < 1.1 * corner
    np.testing.assert_array_equal(held[1:], held[:0:-1])  # the sides are alike


def test_labels_are_in_the_students_units_and_clipped(robot: Robot) -> None:
    env = make_env(2, pose="bent", action_scale=0.5)
    teachers = Teachers([Teacher(agent(robot, 0.25, scale=0.8)), Teacher(agent(robot, 0.9, scale=0.8))], env)
    teachers.level[1] = 1
    labels, levels = teachers.labels(env.loop.observe(slice(None)), np.zeros((2, 11)), either=0.0)
    # 0.25 x 0.8 rad = 0.4 x 0.5 rad; 0.9 x 0.8 rad are beyond the student's 0.5 rad.
    np.testing.assert_allclose(labels[0], 0.4, atol=1e-6)
    np.testing.assert_allclose(labels[1], 1.0, atol=1e-6)
    assert levels.tolist() == [0, 1]


def test_of_two_ways_to_recover_the_student_is_told_the_one_that_it_is_on(robot: Robot) -> None:
    env = make_env(2, pose="bent", action_scale=0.8)
    teachers = Teachers([Teacher(agent(robot, action)) for action in (0.0, 0.2, 0.6)], env)
    teachers.level[:] = 1
    actions = np.repeat([[0.25], [0.55]], 11, axis=1)
    labels, levels = teachers.labels(env.loop.observe(slice(None)), actions, either=0.35)
    np.testing.assert_allclose(labels[:, 0], [0.2, 0.6], atol=1e-6)
    assert levels.tolist() == [1, 2]


def test_a_teacher_for_another_robot_is_refused(robot: Robot) -> None:
    env = make_env(1)
    other = agent(robot, 0.0)
    other.robot = load_robot(str(Path(__file__).parent / "robots" / "tiptoe" / "tiptoe.toml"))
    with pytest.raises(UserError, match=r"the teacher always 0\.0 is for .*tiptoe.*, not for valkyrie"):
        Teachers([Teacher(other)], env)
