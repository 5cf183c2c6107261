"""Distillation: who teaches whom, and a student that learns what it is told."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import make_env
from constant_policy import constant

from surefoot.agents.load import load_policy
from surefoot.agents.network import NetworkAgent
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation.evaluate import push_lines
from surefoot.evaluation.scenarios import DIRECTIONS
from surefoot.learning.actor import network_layers
from surefoot.learning.config import TrainConfig
from surefoot.learning.distill import Distiller
from surefoot.learning.preset_file import preset
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.sb3 import SB3VecEnv
from surefoot.learning.standing import GradedValidation, share_held, standing_thresholds
from surefoot.learning.student import LabelBuffer
from surefoot.learning.train import train
from surefoot.learning.warm_start import warm_start
from surefoot.robots import Robot
from surefoot.task.memory import Memory

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
    pushes = dataclasses.replace(config.env.disturbance, lift_share=0.0)
    env = dataclasses.replace(config.env, noise_share=0.5, drop_share=0.0, disturbance=pushes)
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
        "unknown key of the teacher bold; valid: policy, beyond_standing, beyond_held, beyond, capture_point, "
        "under_noise, falling, rising, leaning, weight"
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
