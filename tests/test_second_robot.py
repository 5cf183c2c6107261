"""A robot from outside the package goes the whole way: it is pushed, evaluated, learned on, drawn and played."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from conftest import TIPTOE, tiny

from surefoot.agents.load import load_policy
from surefoot.agents.nominal import NominalAgent
from surefoot.cli.benchmarks import environment_over_physics
from surefoot.evaluation.evaluate import run_scenarios
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.trials import Trial, run_list
from surefoot.learning.robot_scale import for_robot
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.train import train
from surefoot.physics.pushes import Push
from surefoot.rendering.recording import record
from surefoot.rendering.strip import filmstrip
from surefoot.robots import Robot, load_robot
from surefoot.viewer.session import Session


@pytest.fixture(scope="module")
def tiptoe() -> Robot:
    return load_robot(TIPTOE)


def trial(impulse: float, direction: tuple[float, float, float] = (1.0, 0.0, 0.0), body: str = "root") -> Trial:
    return Trial(Push(body, direction, impulse), seed=1)


def test_it_survives_a_small_push_and_falls_after_a_large_one(tiptoe: Robot) -> None:
    small, large = trial(0.36), trial(12.0)
    outcomes = run_list(NominalAgent(tiptoe), [small, large], num_slots=2, num_threads=1)
    assert outcomes[small].reason == "recovered"
    assert outcomes[small].torque_ratio < 0.5
    assert outcomes[large].reason == "fell"


@pytest.mark.slow
def test_its_thresholds_lie_on_its_own_grid(tiptoe: Robot) -> None:
    scenario = Scenario("root_push", directions=("forward", "left"))
    found = run_scenarios(NominalAgent(tiptoe), [scenario], num_slots=64)
    for threshold in found:
        cells = threshold.size / 0.36
        assert cells == pytest.approx(round(cells), abs=1e-9)
        # 8 kg, CoM at 0.466 m, 9 cm to the border: equation (6) gives 8 sqrt(9.81 / 0.466) 0.09 = 3.3 Ns.
        assert 0.36 <= threshold.size <= 3.4


def test_it_is_learned_on_and_its_policy_knows_the_robot(tmp_path: Path, tiptoe: Robot) -> None:
    config = tiny("ppo")
    pushes = dataclasses.replace(config.env.disturbance, impulse=(0.5, 3.0))
    env = dataclasses.replace(config.env, robot=str(TIPTOE), pose="crouched", disturbance=pushes)
    train(dataclasses.replace(config, env=env), tmp_path / "run")
    policy = load_policy(tmp_path / "run")
    assert policy.contract.robot == str(TIPTOE)
    assert policy.contract.joints == tiptoe.joint_names
    push = trial(0.36)
    # A new network holds the nominal pose, and has learned for two seconds: it still stands after a small push.
    assert run_list(policy, [push], num_slots=1, num_threads=1)[push].reason == "recovered"


def test_it_is_drawn_with_its_stl_mesh(tiptoe: Robot) -> None:
    recording = record(NominalAgent(tiptoe), trial(1.0, (0.0, 1.0, 0.0)))
    strip = filmstrip([recording], times=(0.1, 1.0), cell=(200, 240))
    assert strip.shape[2] == 3
    # Not one plain colour: robot, floor and sky differ.
    assert len(np.unique(strip.reshape(-1, 3), axis=0)) > 200


def test_it_is_played_and_pushed_by_hand(tiptoe: Robot) -> None:
    session = Session(NominalAgent(tiptoe), 2, num_threads=1)
    session.push(Push("left_shank", (0.0, 1.0, 0.0), 0.2))
    for _ in range(60):
        ticks = session.step()
    assert not ticks.non_foot_contact.any()


def test_the_speed_of_its_environment_is_measured_beside_its_physics() -> None:
    found = environment_over_physics(0.2, num_envs=4, robot=str(TIPTOE))
    # The physics of a policy step is part of the environment's. The bounds are wide, for the machine is shared.
    assert 0.02 < found["bench.env_over_physics"] < 5.0
    assert found["bench.physics_steps_per_s"] > 0


@pytest.mark.slow
def test_a_lopsided_robot_is_told_of_and_learns_without_a_mirror(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for file in TIPTOE.parent.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    model = tmp_path / "tiptoe.xml"
    text = model.read_text()
    assert text.count('name="shank_r" pos="0 0 -0.2"') == 1
    model.write_text(text.replace('name="shank_r" pos="0 0 -0.2"', 'name="shank_r" pos="0 0.01 -0.2"'))
    name = str(tmp_path / TIPTOE.name)
    config = for_robot(dataclasses.replace(tiny("ddpg"), mirror=True), name)
    assert "joint 'knee_l_joint' has no mirror image" in capsys.readouterr().err
    assert not config.mirror
    train(config, tmp_path / "run")
    assert load_policy(tmp_path / "run").contract.robot == name
    assert not RunFolder(tmp_path / "run").config().mirror
