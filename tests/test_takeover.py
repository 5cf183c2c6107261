"""Takeover: while a robot is beyond a border a given policy drives it, and nothing of that is learned from."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import tiny
from gymnasium.spaces import Box

from surefoot.agents.load import load_policy
from surefoot.errors import UserError
from surefoot.learning.config import TakeoverConfig, TrainConfig
from surefoot.learning.preset_file import preset
from surefoot.learning.takeover import OwnActionsBuffer, TakeoverVectorEnv
from surefoot.learning.train import train
from surefoot.learning.warm_start import CRITIC_FIRST_STEPS
from surefoot.task.environment import EnvConfig
from surefoot.task.random_pushes import DisturbanceConfig

ROBOTS = 4


def robots(begin: float, impulse: float) -> EnvConfig:
    """The task of `ppo` with pushes of one size, `begin` seconds after the start and never again."""
    pushes = DisturbanceConfig(impulse=(impulse, impulse), first=(begin, begin), interval=(50.0, 50.0))
    return EnvConfig("valkyrie", "bent", action_scale=0.6, episode_s=16.0, disturbance=pushes)


def test_a_robot_beyond_the_border_does_as_the_given_policy_says_whatever_the_other_one_does() -> None:
    """A border of 0.1 mm: all robots are beyond it after their first policy step."""
    envs = [TakeoverVectorEnv(ROBOTS, robots(5.0, 6.0), TakeoverConfig("ppo", capture_point=(1e-4,))) for _ in range(2)]
    seen = [env.reset(seed=3)[0] for env in envs]
    assert np.array_equal(*seen)
    zero = np.zeros((ROBOTS, 11))
    other = [zero, np.full((ROBOTS, 11), 0.9)]
    for step in range(10):
        (first, *_), (second, *_) = (
            env.step(zero if step == 0 else actions) for env, actions in zip(envs, other, strict=True)
        )
        assert envs[0].taken.all() == (step > 0)
        np.testing.assert_array_equal(first, second)


def test_small_pushes_are_left_to_the_policy_that_learns_and_hard_ones_are_not() -> None:
    """`ppo` drives both times, as the one that learns and as the one that takes over."""
    policy, border = load_policy("ppo"), TakeoverConfig("ppo", {"root": (200.0,)}, (0.11,))
    taken = {}
    for impulse in (12.0, 300.0):
        env = TakeoverVectorEnv(ROBOTS, robots(1.0, impulse), border)
        env.reset(seed=0)
        policy.prepare(ROBOTS)
        begun = []
        for _ in range(40):
            target = policy(env.loop.observe(slice(None)), np.arange(ROBOTS)).joint_target
            env.step((target - env.loop.nominal) / 0.6)
            begun.append(env.taken.copy())
        taken[impulse] = np.array(begun)
    assert not taken[12.0].any()
    # The push begins at policy step 25. 300 Ns give 137 kg 2.2 m/s, and after 40 ms 0.7 m/s: a capture point at 0.22 m.
    assert not taken[300.0][:26].any()
    assert taken[300.0][28:].all()


def test_an_episode_ends_two_seconds_after_the_takeover() -> None:
    env = TakeoverVectorEnv(ROBOTS, robots(10.0, 6.0), TakeoverConfig("ppo", capture_point=(1e-4,)))
    env.reset(seed=0)
    # 2 s are 50 policy steps; the first step is the learning policy's own, the 51st of the other one ends the episode.
    ends = [env.step(np.zeros((ROBOTS, 11)))[2:4] for _ in range(52)]
    assert not np.array(ends[:51]).any()
    terminated, truncated = ends[51]
    assert truncated.all()
    assert not terminated.any()


def test_steps_of_a_robot_that_was_taken_over_have_no_advantage() -> None:
    """Three steps of two robots; the second robot is taken over in the second step."""
    env = TakeoverVectorEnv(2, robots(10.0, 6.0), TakeoverConfig("ppo", capture_point=(0.5,)))
    space, action = Box(-1.0, 1.0, (3,)), Box(-1.0, 1.0, (1,))
    buffer = OwnActionsBuffer(3, space, action, "cpu", gae_lambda=0.0, gamma=0.5, n_envs=2, env=env)
    rewards = np.array([[1.0, 2.0], [3.0, 50.0], [5.0, 6.0]])
    for step, reward in enumerate(rewards):
        env.taken = np.array([False, step == 1])
        zero = torch.zeros(2)
        buffer.add(np.zeros((2, 3)), np.zeros((2, 1)), reward, np.zeros(2), zero, zero)
    buffer.compute_returns_and_advantage(torch.zeros(2), np.zeros(2))
    # With values of 0 and lambda = 0 an advantage is its reward. The mean of the others is (1 + 2 + 3 + 5 + 6) / 5.
    np.testing.assert_allclose(buffer.advantages, [[1.0, 2.0], [3.0, 3.4], [5.0, 6.0]])


def test_the_first_stage_of_best_begins_as_ppo_and_holds_it_while_its_critic_learns(tmp_path: Path) -> None:
    stage, few = preset("best/no-step", "ddpg"), tiny("trpo")
    config = dataclasses.replace(stage, num_envs=8, hyper=few.hyper, steps=64)
    train(config, tmp_path / "run")
    found, ppo = load_policy(tmp_path / "run"), load_policy("ppo")
    record = found.contract.training
    assert record["after"]["preset"] == ppo.contract.training["preset"]
    assert record["policy_steps"] - record["after"]["policy_steps"] < CRITIC_FIRST_STEPS
    seen = np.random.default_rng(0).normal(size=(5, 47))
    np.testing.assert_allclose(found.actions(seen), ppo.actions(seen), atol=1e-4)


@pytest.mark.parametrize("algorithm", ["ddpg", "dagger"])
def test_only_trpo_and_ppo_can_be_relieved(algorithm: str) -> None:
    values = {"algorithm": algorithm, "env": {"robot": "valkyrie"}, "hyper": {"learning_rate": 1e-3}}
    with pytest.raises(
        UserError, match=rf"^takeover: another policy takes over for trpo and ppo only, not for {algorithm}$"
    ):
        TrainConfig.from_values(values | {"takeover": {"policy": "ppo"}})
