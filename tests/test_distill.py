"""Distillation: who teaches whom, and a student that learns what it is told."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import make_env

from surefoot.agents.load import load_policy
from surefoot.agents.network import NetworkAgent
from surefoot.agents.nominal import NominalAgent
from surefoot.agents.policy_file import network_bytes
from surefoot.errors import UserError
from surefoot.evaluation.evaluate import push_lines
from surefoot.evaluation.scenarios import DIRECTIONS
from surefoot.learning.actor import network_layers
from surefoot.learning.capture_points import from_feet, held_capture_points
from surefoot.learning.config import TrainConfig
from surefoot.learning.distill import Distiller
from surefoot.learning.preset_file import preset
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.sb3 import SB3VecEnv
from surefoot.learning.standing import GradedValidation, share_held, standing_thresholds
from surefoot.learning.student import LabelBuffer
from surefoot.learning.teachers import Teacher, Teachers
from surefoot.learning.train import train
from surefoot.learning.warm_start import warm_start
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.robots import Robot, load_robot
from surefoot.task.contract import Contract
from surefoot.task.memory import Memory
from surefoot.task.random_pushes import DisturbanceConfig


def constant(robot: Robot, action: float, scale: float = 0.8, past: int = 0) -> bytes:
    """A policy that always does the same with every joint."""
    contract = Contract.of(robot, "bent", scale, {"algorithm": "trpo"}, past)
    size = contract.num_inputs
    layers = [(np.zeros((robot.num_joints, size)), np.full(robot.num_joints, action))]
    return network_bytes(layers, np.zeros(size), np.ones(size), False, contract)


def agent(robot: Robot, action: float, scale: float = 0.8) -> NetworkAgent:
    return NetworkAgent(constant(robot, action, scale), f"always {action}")


def pushed(impulse: float, num_robots: int = 1, **config: object) -> DisturbanceConfig:
    return DisturbanceConfig(impulse=(impulse, impulse), first=(0.2, 0.2), **config)


# Teachers.


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
    second, third = Teacher(agent(robot, 0.1), {"root": [1e3]}), Teacher(agent(robot, 0.2), vertical_speed=2.0)
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


# Standing.


def test_a_robot_that_holds_its_pose_stands_through_the_smallest_pushes_only(robot: Robot) -> None:
    nominal = NominalAgent(robot, "bent")
    share = share_held(nominal, push_lines(4)[:1], cells=(1, 30), num_threads=1)
    np.testing.assert_array_equal(share, [[1.0, 0.0]])
    scenario = dataclasses.replace(push_lines()[0].scenario, directions=1)
    found = standing_thresholds(nominal, scenario, num_trials=1, num_threads=1)
    assert all(0.0 <= impulse < 60.0 and impulse % 6.0 == 0.0 for impulse in found)


# Students.


def test_the_newest_labels_are_kept() -> None:
    labels = LabelBuffer(4, 1, 1)
    for first in (0.0, 3.0):
        values = first + np.arange(3.0)[:, None]
        labels.add(values, 10.0 * values, np.ones(3))
    inputs, told, weights = labels.draw(200, np.random.default_rng(0))
    # Six were given: 0 and 1 are gone.
    assert sorted(set(inputs[:, 0].tolist())) == [2.0, 3.0, 4.0, 5.0]
    np.testing.assert_array_equal(told, 10.0 * inputs)
    assert (weights == 1.0).all()


def student_config(**changes: object) -> TrainConfig:
    """The preset's student with few robots, taught by two files beside its run."""
    config = preset("best/student", "ddpg")
    teachers = (
        {"policy": "still", "weight": 3.0},
        {"policy": "bold", "beyond": {"root": (40.0,), "torso": (40.0,)}},
    )
    hyper = {
        **config.hyper,
        "mixture": False,
        "teachers": teachers,
        "buffer_size": 2000,
        "batch_size": 64,
        "learning_rate": 3e-3,
    }
    env = dataclasses.replace(config.env, noise_share=0.5)
    return dataclasses.replace(config, hyper=hyper, env=env, num_envs=8, actor=(16,), **changes)


@pytest.fixture
def runs(tmp_path: Path, robot: Robot) -> Path:
    for name, action in (("still", 0.4), ("bold", 0.5)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "best.onnx").write_bytes(constant(robot, action))
    return tmp_path


def test_a_student_learns_what_it_is_told_and_remembers_its_past(runs: Path) -> None:
    config = student_config()
    distiller = Distiller(config, RunFolder.create(runs / "student", config), num_threads=1)
    observations, _ = distiller.env.reset(seed=0)
    distiller.teachers.begin(distiller.env.loop.observe(slice(None), with_errors=False))

    def error() -> float:
        actions = distiller.student.act(distiller.student.inputs(observations))
        return float(np.square(actions - np.where(distiller.teachers.level == 1, 0.5, 0.4)[:, None]).mean())

    before = error()
    for _ in range(40):
        observations = distiller.step(observations)
    assert error() < 0.1 * before
    data = distiller.student.policy_bytes({})
    policy = NetworkAgent(data, "student")
    assert (policy.contract.past_observations, policy.contract.past_actions) == (7, 8)
    # The file acts on raw inputs as the student does on normalised ones.
    raw = distiller.student.memory.inputs(observations, np.arange(8))
    expected = distiller.student.act(distiller.student.normalise(raw))
    np.testing.assert_allclose(np.clip(policy.actions(raw), -1.0, 1.0), expected, atol=1e-5)


@pytest.mark.slow
def test_a_distillation_goes_on_from_its_checkpoint_and_hands_on_its_student(runs: Path) -> None:
    config = student_config(steps=400)
    train(config, runs / "student")
    record = load_policy(runs / "student").contract.training
    assert (record["algorithm"], record["policy_steps"]) == ("dagger", 400)
    folder = RunFolder(runs / "student")
    assert {"held", "standing_forward", "loss_0", "loss_1"} <= set(folder.curve()[-1])
    more = train(dataclasses.replace(config, steps=800), runs / "student", resume=True)
    assert more.progress.steps == 800
    assert len(folder.curve()) == 2
    start = warm_start(config, runs / "student")
    assert isinstance(start, NetworkAgent)
    heir = Distiller(config, RunFolder.create(runs / "heir", config), start=start, num_threads=1)
    assert heir.origin.record["policy_steps"] in (400, 800)  # whichever was the best
    layers = start.layers(heir.student.normalise.mean, heir.student.normalise.std)
    for (weight, _), (expected, _) in zip(network_layers(heir.student.network), layers, strict=True):
        np.testing.assert_array_equal(weight, expected)


def test_a_distillation_of_so_many_steps_is_the_same_to_the_last_bit(
    runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    none = dict.fromkeys(DIRECTIONS, 0.0)
    found = GradedValidation(0.5, 0.5, 0.5, none, none, 0.0, 0.0)
    monkeypatch.setattr("surefoot.learning.distill.validate_graded", lambda policy, num_threads: found)
    config = student_config(steps=400)
    torch.set_num_threads(1)
    first = train(config, runs / "first")
    # The second one meets other conditions: threads, generators that were used, and a checkpoint at every step.
    torch.set_num_threads(2)
    torch.rand(5)
    monkeypatch.setattr("surefoot.learning.distill.CHECKPOINT_S", 0.0)
    second = train(config, runs / "second")
    other = train(dataclasses.replace(config, seed=1), runs / "other")
    observations = np.random.default_rng(0).standard_normal((20, len(first.student.normalise.mean)))
    actions = [
        NetworkAgent(run.student.policy_bytes({}), "run").actions(observations) for run in (first, second, other)
    ]
    np.testing.assert_array_equal(actions[0], actions[1])
    assert not np.array_equal(actions[0], actions[2])
    rows = [(runs / name / "curve.csv").read_text().splitlines()[1].split(",", 1)[1] for name in ("first", "second")]
    assert rows[0] == rows[1], "all columns but the minutes"


def test_a_wrong_teacher_gets_one_line(runs: Path, robot: Robot) -> None:
    def refusal(teacher: dict[str, object]) -> str:
        config = student_config()
        config = dataclasses.replace(config, hyper={**config.hyper, "teachers": ({"policy": "still"}, teacher)})
        with pytest.raises(UserError) as error:
            Distiller(config, RunFolder(runs / "student"), num_threads=1)
        return str(error.value)

    assert refusal({"policy": "nobody"}).startswith("cannot read policy nobody")
    assert refusal({"policy": "bold", "wait": 2.0}) == (
        "unknown key of the teacher bold; valid: policy, beyond, beyond_standing, capture_point, beyond_held, "
        "vertical_speed, weight"
    )
    (runs / "bold" / "best.onnx").write_bytes(constant(robot, 0.5, past=2))
    assert "has a memory" in refusal({"policy": "bold"})


# Reinforcement learning with a memory.


def test_the_networks_of_a_run_with_a_memory_are_given_what_the_policy_file_will_be() -> None:
    venv = SB3VecEnv(make_env(2, pose="bent", episode_s=0.12), past_observations=1, past_actions=1)
    venv.seed(0)
    env, rng, everyone = venv.env, np.random.default_rng(1), np.arange(2)
    memory = Memory(1, 1, 47, 11)
    memory.prepare(2)
    seen = venv.reset()
    observations = env.loop.observation.astype(np.float32)
    for step in range(5):
        inputs = memory.inputs(observations, everyone)
        np.testing.assert_allclose(seen, venv.normalise(inputs), atol=1e-5)
        actions = rng.uniform(-1.0, 1.0, (2, 11))
        memory.add(observations, actions, everyone)
        seen, _, dones, infos = venv.step(actions)
        observations = env.loop.observation.astype(np.float32)
        assert dones.all() == (step == 2)  # an episode lasts three policy steps
        if dones.all():
            # Its last inputs still hold its own past.
            past = venv.normalise(np.concatenate([np.zeros((2, 47)), memory._observed[:, 0], memory._acted[:, 0]], 1))
            np.testing.assert_allclose([info["terminal_observation"][47:] for info in infos], past[:, 47:], atol=1e-5)
            memory.reset(everyone)
