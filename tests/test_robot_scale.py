"""What is scaled to the size of a robot: a training run, the reward, the package's suites."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import TIPTOE

from surefoot.evaluation.scenario_file import suite
from surefoot.learning.preset_file import preset
from surefoot.learning.robot_scale import for_robot
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.robots import Robot, load_robot
from surefoot.task import observation
from surefoot.task.reward import TERMS, RewardContext, step_reward

MASS = 8.0 / 137.287494
LENGTH = 0.455 / 0.986129
"""Of the second robot over the paper's."""


@pytest.fixture(scope="module")
def tiptoe() -> Robot:
    return load_robot(TIPTOE)


def test_a_preset_for_its_own_robot_is_the_preset() -> None:
    config = preset("complete/everything", "ddpg")
    assert for_robot(config, config.env.robot) == config


def test_pushes_go_with_the_mass_times_with_the_root_of_the_length_and_penalties_with_the_power(tiptoe: Robot) -> None:
    config = preset("fast", "ddpg")
    scaled = for_robot(config, str(TIPTOE)).env
    assert (scaled.robot, scaled.pose) == (str(TIPTOE), "crouched")
    np.testing.assert_allclose(scaled.disturbance.impulse, [30.0 * MASS, 300.0 * MASS], rtol=1e-5)
    np.testing.assert_allclose(scaled.disturbance.max_impulse, 600.0 * MASS, rtol=1e-5)
    np.testing.assert_allclose(scaled.episode_s, 16.0 * math.sqrt(LENGTH), rtol=1e-5)
    np.testing.assert_allclose(scaled.disturbance.first, np.array([0.4, 3.4]) * math.sqrt(LENGTH), rtol=1e-5)
    assert scaled.disturbance.duration == 0.12
    # A watt of a small robot is much: it costs as many times more as all its powers are smaller.
    power = MASS * math.sqrt(LENGTH)
    assert scaled.power_weight[0][1] * power == pytest.approx(1e-3, rel=1e-4)
    assert scaled.power_log_scale == pytest.approx(50.0 * power, rel=1e-4)


def test_lengths_and_speeds_of_a_stage_are_scaled_too() -> None:
    config = preset("complete/everything", "ddpg")
    scaled = for_robot(config, str(TIPTOE)).env
    np.testing.assert_allclose(scaled.drop_height, np.array(config.env.drop_height) * LENGTH, atol=1e-6)
    told, found = config.env.foot_travel_weight[-1][1], scaled.foot_travel_weight[-1][1]
    assert found * math.sqrt(LENGTH) == pytest.approx(told, rel=1e-4)
    assert config.env.step_penalty_fade is not None
    assert scaled.step_penalty_fade is not None
    np.testing.assert_allclose(scaled.step_penalty_fade, np.array(config.env.step_penalty_fade) * MASS, rtol=1e-4)


def test_a_robot_without_a_mirror_learns_without_one(tmp_path: Path) -> None:
    shutil.copytree(TIPTOE.parent, tmp_path / "tiptoe")
    waived = tmp_path / "tiptoe" / "waived.toml"
    waived.write_text("symmetric = false\n" + TIPTOE.read_text())
    config = preset("fast", "ddpg")
    assert config.mirror
    assert for_robot(config, str(TIPTOE)).mirror
    assert not for_robot(config, str(waived)).mirror


def test_a_motion_that_is_the_same_on_the_robots_scale_earns_the_same(tiptoe: Robot, robot: Robot) -> None:
    earned = []
    for each in (robot, tiptoe):
        engine = MujocoEngine(each, 1, num_threads=1)
        record = engine.reset(np.array([0]), each.pose()[None])
        higher = RewardContext(float(record.com_height[0, 0]) + 0.05 * each.length_scale, each.pose())
        _, means = step_reward(record, higher, {"com_height": TERMS["com_height"], "power": TERMS["power"]})
        earned.append(means["com_height"])
    # 5 cm too low for the paper's robot: exp(-113.84 x 0.05^2); 2.3 cm are as much for the second one.
    np.testing.assert_allclose(earned, math.exp(-113.84 * 0.05**2), rtol=1e-6)


def test_an_observations_typical_deviations_are_those_of_the_robots_size(tiptoe: Robot, robot: Robot) -> None:
    for each, length, share in ((robot, 1.0, 0.2), (tiptoe, LENGTH, 0.2)):
        found = dict(zip(observation.component_names(each), observation.scales(each), strict=True))
        assert found["com_position.x"] == pytest.approx(0.1 * length)
        assert found["com_velocity.y"] == pytest.approx(0.5 * math.sqrt(length))
        assert found["left_foot_position.z"] == pytest.approx(0.2 * length)
        # 11 rad/s in the second robot's time are 16.2 rad/s, more than any of its joints can do.
        assert found[f"joint_velocity.{each.joint_names[0]}"] == pytest.approx(share)


def test_the_packages_suites_are_scaled_to_the_robot_that_is_tested(tiptoe: Robot, robot: Robot) -> None:
    assert suite("paper", robot) == suite("paper")
    told = {scenario.name: scenario for scenario in suite("paper", tiptoe)}
    # 24 Ns are four cells of 6 Ns, and a cell of the second robot is 0.36 Ns.
    assert told["sagittal_24"].impulse == 1.44
    assert told["combined"].preceding_impulse == pytest.approx(500.0 / 6.0 * 0.36)
    assert told["shank_push"].lever == pytest.approx(-0.7 * LENGTH)
    assert told["drop_055"].drop == pytest.approx(0.55 * LENGTH)
