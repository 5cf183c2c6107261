"""What motion costs in the environment, and what its configuration sets."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from conftest import NO_PUSH, make_env

from surefoot.errors import UserError
from surefoot.physics.step_record import StepRecord
from surefoot.task.environment import PushRecoveryVectorEnv
from surefoot.task.random_pushes import DisturbanceConfig
from surefoot.task.reward import RewardContext, Term


def test_the_power_weight_follows_its_schedule() -> None:
    env = make_env(1, power_weight=((0.0, 0.0), (0.5, 0.0), (1.0, 2e-4)))
    assert env.power_weight == 0.0
    weights = []
    for progress in (0.25, 0.5, 0.75, 1.0):
        env.set_progress(progress)
        weights.append(env.power_weight)
    assert weights == pytest.approx([0.0, 0.0, 1e-4, 2e-4])


def test_power_is_paid_for_by_its_weight() -> None:
    rewards = []
    for weight in (0.0, 1e-3):
        env = make_env(1, pose="bent", disturbance=NO_PUSH, power_weight=((0.0, weight),))
        env.reset(seed=0)
        rewards.append(env.step(np.full((1, 11), 0.1))[1][0])
        power = env.reward_means["power"]
    # The motion is the same: the rewards differ by 0.1 * weight * watts.
    assert rewards[1] - rewards[0] == pytest.approx(0.1 * power, rel=1e-9)
    assert power < -1e-3


@pytest.mark.parametrize(("impulse", "share"), [(40.0, 1.0), (90.0, 0.5), (200.0, 0.0)])
def test_foot_travel_costs_after_small_pushes_and_is_free_for_a_while_after_large_ones(
    impulse: float, share: float
) -> None:
    """Free from 60 to 120 Ns on: 90 Ns is half way."""
    push = DisturbanceConfig(impulse=(impulse, impulse), first=(0.4, 0.4))
    env = make_env(
        1,
        pose="bent",
        disturbance=push,
        foot_travel_weight=((0.0, 2.0),),
        step_penalty_fade=(60.0, 120.0),
        step_penalty_waiver_s=0.5,
    )
    env.reset(seed=0)
    paid = []
    for _ in range(24):
        env.step(np.zeros((1, 11)))
        paid.append(float(env.step_penalty_share()[0]))
    # Steps of 0.04 s: before the push at 0.4 s all costs; from its first step on the share; 0.5 s later all again.
    np.testing.assert_allclose(paid[:10], 1.0)
    np.testing.assert_allclose(paid[10:22], share)
    np.testing.assert_allclose(paid[22:], 1.0)


@pytest.mark.parametrize(("impulse", "pays"), [(50.0, True), (90.0, False)])
def test_the_nominal_pose_is_asked_for_until_the_first_push_after_which_stepping_is_free(
    impulse: float, pays: bool
) -> None:
    push = DisturbanceConfig(impulse=(impulse, impulse), first=(0.4, 0.4))
    weights = {"posture_weight": ((0.0, 2.0),), "step_penalty_fade": (60.0, 120.0), "step_penalty_waiver_s": 0.2}
    env = make_env(1, pose="bent", disturbance=push, **weights)
    env.reset(seed=0)
    paid = []
    for _ in range(24):
        env.step(np.full((1, 11), 0.1))
        paid.append(env.reward_means["posture"] < 0.0)
    # Steps of 0.04 s, the push at 0.4 s. Foot travel costs again 0.2 s later, the posture only in the next episode.
    assert paid == [True] * 10 + [pays] * 14
    env.reset()
    env.step(np.full((1, 11), 0.1))
    assert env.reward_means["posture"] < 0.0


def test_moving_is_free_after_a_drop_and_stepping_also_to_robots_with_noise() -> None:
    weights = {"foot_travel_weight": ((0.0, 2.0),), "sway_weight": ((0.0, 2.0),), "step_penalty_fade": (60.0, 120.0)}
    drop, noise = {"drop_share": 1.0, "drop_height": (0.1, 0.1)}, {"noise_share": 1.0, "action_noise": 0.1}
    for config, paid in ((drop, (False, False)), (noise, (False, True)), ({}, (True, True))):
        env = make_env(2, disturbance=NO_PUSH, **weights, **config)
        env.reset(seed=0)
        env.step(np.full((2, 11), 0.2))
        assert (env.reward_means["foot_travel"] < 0.0, env.reward_means["sway"] < 0.0) == paid


def test_a_share_of_the_episodes_has_noise_of_any_size_up_to_the_largest() -> None:
    n = 400
    env = make_env(n, pose="bent", disturbance=NO_PUSH, noise_share=0.25, observation_noise=0.4, action_noise=0.1)
    env.reset(seed=0)
    noisy = env.loop.imperfect
    assert noisy.mean() == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / n))
    sizes = env.loop._action_noise._std
    np.testing.assert_array_equal(sizes > 0.0, noisy)
    np.testing.assert_allclose(env.loop._observation_noise._std, 4.0 * sizes)
    # Uniform up to 0.1: mean 0.05, its deviation over 100 draws 0.1 / sqrt(12 * 100) = 0.003.
    assert sizes[noisy].mean() == pytest.approx(0.05, abs=4 * 0.003)


def test_a_critic_is_told_the_share_of_the_step_penalties_and_how_noisy_its_robot_is() -> None:
    config = {
        "pose": "bent",
        "foot_travel_weight": ((0.0, 1.0),),
        "step_penalty_fade": (50.0, 150.0),
        "noise_share": 0.5,
        "action_noise": 0.01,
        "disturbance": DisturbanceConfig(impulse=(75.0, 75.0), first=(0.1, 0.1)),
    }
    env = make_env(40, **config)
    env.reset(seed=0)
    np.testing.assert_array_equal(env.privileged_observation()[:, 9:11], 1.0)
    for _ in range(4):  # 0.16 s: pushed
        env.step(np.zeros((40, 11)))
    told = env.privileged_observation()
    # 75 Ns are a quarter of the way from 50 to 150: three quarters of the price; and it is no longer all of it.
    np.testing.assert_allclose(told[:, 9], 0.75)
    np.testing.assert_array_equal(told[:, 10], 0.0)
    np.testing.assert_allclose(told[:, 11], env.loop._action_noise._std / 0.01)
    assert 0.2 < np.mean(told[:, 11] == 0.0) < 0.8


def test_pushes_of_the_config_reach_the_robot() -> None:
    """Two environments that differ by their pushes only move alike up to the first push and not thereafter."""
    speeds = []
    for impulse in (0.0, 60.0):
        config = DisturbanceConfig(impulse=(impulse, impulse), first=(0.4, 0.4))
        env = make_env(1, pose="bent", disturbance=config, joint_noise=0.0)
        env.reset(seed=0)
        for _ in range(10):
            env.step(np.zeros((1, 11)))
        before = env.loop.observation.copy()
        for _ in range(3):
            env.step(np.zeros((1, 11)))
        speeds.append((before, np.linalg.norm(env.loop.observation[0, 30:32])))
    np.testing.assert_array_equal(speeds[0][0], speeds[1][0])
    # 60 Ns / 137 kg = 0.44 m/s, less what the feet take and the filter's delay.
    assert speeds[0][1] < 0.05
    assert 0.2 < speeds[1][1] < 0.44


def test_unknown_names_in_the_config_are_answered_with_the_known_ones() -> None:
    for config, message in (
        ({"robot": "atlas"}, "unknown robot 'atlas'; valid: g1, g1_arms, h1, valkyrie, or a description (.toml)"),
        ({"pose": "sitting"}, "unknown pose 'sitting' of valkyrie; valid: straight, bent"),
    ):
        with pytest.raises(UserError) as error:
            make_env(1, **config)
        assert str(error.value) == message


def test_gymnasiums_vector_wrappers_accept_the_environment() -> None:
    env = gym.wrappers.vector.RecordEpisodeStatistics(make_env(2, pose="bent", disturbance=NO_PUSH, episode_s=0.4))
    env.reset(seed=0)
    total = np.zeros(2)
    for _ in range(10):
        _, rewards, _, truncated, info = env.step(np.zeros((2, 11), np.float32))
        total += rewards
    assert truncated.all()
    np.testing.assert_allclose(info["episode"]["r"], total, rtol=1e-6)
    np.testing.assert_array_equal(info["episode"]["l"], [10, 10])


def test_a_reward_term_of_ones_own_is_added_by_configuration() -> None:
    def torso_height(record: StepRecord, context: RewardContext) -> np.ndarray:
        return np.full((3, len(record)), 0.5)

    def make(**config: object) -> PushRecoveryVectorEnv:
        env = make_env(3, pose="bent", disturbance=NO_PUSH, **config)
        env.reset(seed=0)
        return env

    plain, own = make(), make(extra_terms={"torso_height": Term(torso_height, weight=0.4)})
    _, without, *_ = plain.step(np.zeros((3, 11)))
    _, rewards, *_ = own.step(np.zeros((3, 11)))
    # A penalty of 0.4 per unit of 0.5: 0.1 * 0.4 * 0.5 = 0.02 of a step.
    np.testing.assert_allclose(without - rewards, 0.02, rtol=1e-9)
    assert own.reward_means == {**plain.reward_means, "torso_height": pytest.approx(-0.2)}
    with pytest.raises(UserError, match="the reward has a term 'sway' already"):
        make(extra_terms={"sway": Term(torso_height, weight=0.4)})
