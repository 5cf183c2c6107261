from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from conftest import NO_PUSH, make_env
from gymnasium.vector import AutoresetMode

from surefoot.errors import UserError
from surefoot.task.environment import PushRecoveryVectorEnv
from surefoot.task.random_pushes import PUSH, DisturbanceConfig

KICK = DisturbanceConfig(impulse=(400.0, 400.0), first=(0.1, 0.1))

PITCH, JOINTS = 29, slice(0, 11)  # root_attitude.pitch and joint_position of the observation


def rollout(env: PushRecoveryVectorEnv, seed: int, num_steps: int) -> list[np.ndarray]:
    """Everything that the env returns under random actions, as one list of arrays."""
    rng = np.random.default_rng(0)
    seen = [env.reset(seed=seed)[0]]
    for _ in range(num_steps):
        observations, rewards, terminated, truncated, info = env.step(rng.uniform(-0.3, 0.3, (env.num_envs, 11)))
        seen += [observations, rewards, terminated, truncated, info.get("final_obs", np.zeros(0))]
    return seen


def until_done(env: PushRecoveryVectorEnv, limit: int = 500) -> tuple:
    """Zero actions until the first episode ends: the step's result and how many steps it took."""
    for step in range(1, limit):
        result = env.step(np.zeros((env.num_envs, 11), np.float32))
        if (result[2] | result[3]).any():
            return (*result, step)
    raise AssertionError("no episode ends")


def test_spaces_are_those_of_the_paper() -> None:
    env = make_env(3)
    assert env.single_observation_space.shape == (47,)
    assert env.observation_space.shape == (3, 47)
    assert env.single_action_space == gym.spaces.Box(-1.0, 1.0, (11,), np.float32)
    assert env.action_space.shape == (3, 11)
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert env.metadata["render_fps"] == 25


def test_what_reset_and_step_return_is_in_the_spaces_and_typed_as_gymnasium_has_it() -> None:
    env = make_env(4, disturbance=KICK)
    observations, info = env.reset(seed=0)
    assert info == {}
    assert env.observation_space.contains(observations)
    env.action_space.seed(0)
    for _ in range(40):
        observations, rewards, terminated, truncated, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observations)
        assert (rewards.shape, terminated.dtype, truncated.dtype) == ((4,), bool, bool)
        assert np.isfinite(rewards).all()
        if "final_obs" in info:
            assert env.observation_space.contains(info["final_obs"])
            np.testing.assert_array_equal(info["_final_obs"], terminated | truncated)
        else:
            assert not (terminated | truncated).any()


def test_the_same_seed_gives_the_same_bits_whatever_the_number_of_threads() -> None:
    config = {"disturbance": DisturbanceConfig(impulse=(50.0, 300.0), first=(0.1, 0.5)), "pose": "bent"}
    runs = [rollout(make_env(6, threads, **config), 5, 60) for threads in (1, 1, 2)]
    assert any(done.any() for done in runs[0][3::5])
    for other in runs[1:]:
        for here, there in zip(runs[0], other, strict=True):
            np.testing.assert_array_equal(here, there)


def test_the_same_seed_gives_the_same_bits_in_a_used_environment() -> None:
    env = make_env(3, disturbance=KICK)
    fresh = rollout(env, 5, 30)
    for here, there in zip(fresh, rollout(env, 5, 30), strict=True):
        np.testing.assert_array_equal(here, there)


def test_another_seed_and_a_reset_without_one_start_elsewhere() -> None:
    env = make_env(2)
    first, _ = env.reset(seed=1)
    again, _ = env.reset()
    other, _ = env.reset(seed=2)
    assert (first != again).any(axis=1).all()
    assert (first != other).any(axis=1).all()


def test_robots_start_within_the_noise_around_the_pose_and_each_elsewhere() -> None:
    env = make_env(16, pose="bent", joint_noise=0.01)
    observations, _ = env.reset(seed=3)
    _, held = env.loop.starts()
    offset = held - env.robot.pose("bent")
    assert np.abs(offset).max() <= 0.01 + 1e-6
    # 16 * 11 uniform draws: deviation 0.01 / sqrt(3)
    assert offset.std() == pytest.approx(0.01 / np.sqrt(3), rel=0.1)
    assert len(np.unique(offset, axis=0)) == 16
    # The motors hold these angles, and the weight bends the joints by up to 0.04 rad.
    assert np.abs(observations[:, JOINTS] - held).max() < 0.04
    two = make_env(2, pose="bent", joint_noise=0.0)
    still, _ = two.reset(seed=3)
    np.testing.assert_array_equal(two.loop.starts()[1], np.tile(env.robot.pose("bent"), (2, 1)))
    np.testing.assert_array_equal(still[0], still[1])


def test_a_large_batch_draws_its_starts_from_poses_that_stand_already() -> None:
    env = make_env(64, pose="bent")
    env.reset(seed=3)
    drawn, held = env.loop.starts()
    states, targets = env._starts
    assert len(states) == len(np.unique(states, axis=0)) == 512
    assert all((states == row).all(axis=1).any() for row in drawn)
    assert len(np.unique(drawn, axis=0)) > 50
    rows = [int(np.flatnonzero((states == row).all(axis=1))[0]) for row in drawn]
    np.testing.assert_array_equal(held, targets[rows])
    # They stand as robots do that stand up at their reset: at rest, with their weight on their feet.
    start = env.loop.engine.read(np.arange(64))
    np.testing.assert_array_equal(start.joint_velocity, 0.0)
    np.testing.assert_allclose(start.foot_force[:, 0].sum(axis=-1), env.robot.weight, rtol=0.01)


def test_a_share_of_the_episodes_starts_by_a_drop() -> None:
    env = make_env(200, drop_height=(0.2, 0.5), drop_share=0.3, joint_noise=0.0)
    env.reset(seed=0)
    soles = env.loop.engine.read(np.arange(200)).sole_position[:, 0, :, 2].min(axis=1)
    dropped = soles > 0.1
    assert np.mean(dropped) == pytest.approx(0.3, abs=4 * np.sqrt(0.3 * 0.7 / 200))
    assert (soles[dropped].min(), soles[dropped].max()) == (pytest.approx(0.2, abs=0.02), pytest.approx(0.5, abs=0.02))
    # The others stand: the contact gives way by less than 1 mm under their weight.
    assert -1e-3 < soles[~dropped].min() <= soles[~dropped].max() < 0.0


def test_dropped_robots_lean_by_up_to_the_angle_and_the_others_stand_upright() -> None:
    env = make_env(200, drop_height=(0.2, 0.5), drop_share=0.5, drop_lean=0.3, joint_noise=0.0)
    env.reset(seed=0)
    start = env.loop.engine.read(np.arange(200))
    dropped = start.sole_position[:, 0, :, 2].min(axis=1) > 0.1
    lean = np.arccos(start["root_up"][:, 0, 2])
    np.testing.assert_allclose(lean[~dropped], 0.0, atol=0.01)
    # Uniform from 0 to 0.3: mean 0.15, deviation 0.3 / sqrt(12) = 0.087 each.
    assert lean[dropped].mean() == pytest.approx(0.15, abs=4 * 0.087 / np.sqrt(dropped.sum()))
    assert 0.25 < lean.max() <= 0.3 + 1e-6


@pytest.mark.parametrize("pose", ["straight", "bent"])
def test_a_robot_that_stands_is_truncated_after_16_s_and_not_terminated(pose: str) -> None:
    env = make_env(2, pose=pose, disturbance=NO_PUSH)
    env.reset(seed=1)
    *_, terminated, truncated, _info, steps = until_done(env)
    assert steps == 16 * 25
    assert truncated.all()
    assert not terminated.any()


def test_standing_still_is_rewarded_with_nearly_1_and_the_means_say_why() -> None:
    env = make_env(2, pose="bent", disturbance=NO_PUSH, joint_noise=0.0)
    env.reset(seed=1)
    for _ in range(50):
        _, rewards, *_ = env.step(np.zeros((2, 11)))
    assert (rewards > 0.95).all()
    assert (rewards < 1.0).all()
    weights = {"com_position_xy": 2, "com_height": 3, "com_velocity_xy": 2}
    terms = {name: env.reward_means[name] for name in list(env.reward_means)[:10]}
    total = sum(weights.get(name, 1) * value for name, value in terms.items()) / 14
    penalties = sum(list(env.reward_means.values())[10:])
    assert rewards.mean() == pytest.approx(total + 0.1 * penalties, rel=1e-9)


def test_a_fall_terminates_and_is_not_a_truncation() -> None:
    env = make_env(2, disturbance=KICK)
    env.reset(seed=1)
    *_, rewards, terminated, truncated, _info, steps = until_done(env)
    assert terminated.any()
    assert not truncated.any()
    # Kicked at 0.1 s with 400 Ns: down after some 0.6 s, not at once.
    assert 10 < steps < 40
    # Its last step: not over 0.1 * 10 for the terms, minus up to 0.1 * 10 for the ticks on the ground.
    assert rewards[terminated].max() < 0.6


def test_a_fall_in_the_last_step_of_an_episode_is_a_termination_only() -> None:
    env = make_env(2, disturbance=KICK)
    env.reset(seed=1)
    *_, steps = until_done(env)
    # The same again, in an episode that ends at exactly that step.
    short = make_env(2, disturbance=KICK, episode_s=steps * 0.04)
    short.reset(seed=1)
    *_, terminated, truncated, _info, short_steps = until_done(short)
    assert short_steps == steps
    assert terminated.any()
    np.testing.assert_array_equal(truncated, ~terminated)


def test_an_ended_episode_begins_anew_in_the_same_step_and_keeps_its_last_observation() -> None:
    env = make_env(2, disturbance=KICK, joint_noise=0.01)
    env.reset(seed=1)
    observations, _, terminated, _, info, _ = until_done(env)
    fallen, other = (0, 1) if terminated[0] else (1, 0)
    assert not terminated[other]
    # The last observation lies on the ground; the new one stands upright near the nominal pose, at rest.
    tilt = np.abs(info["final_obs"][fallen, PITCH - 1 : PITCH + 1]).max()
    assert tilt > 0.5
    np.testing.assert_array_equal(info["_final_obs"], terminated)
    np.testing.assert_allclose(observations[fallen, PITCH - 1 : PITCH + 1], 0.0, atol=0.01)
    assert np.abs(observations[fallen, JOINTS]).max() <= 0.01 + 0.04
    np.testing.assert_array_equal(observations[fallen, 11:28], 0.0)
    assert env.loop.tick[fallen] == 0
    # Who goes on has one and the same observation.
    np.testing.assert_array_equal(info["final_obs"][other], observations[other])
    assert env.loop.tick[other] > 0
    # And the robot that began anew is pushed anew: it falls again.
    assert env.loop.pushes.start[fallen, PUSH] == 50
    *_, steps = until_done(env)
    assert steps < 40


def test_episodes_are_counted_from_each_robots_own_start() -> None:
    env = make_env(3, pose="bent", disturbance=NO_PUSH, episode_s=0.4, joint_noise=0.0)
    env.reset(seed=0)
    ends = []
    for step in range(1, 26):
        *_, truncated, _ = env.step(np.zeros((3, 11)))
        if truncated.any():
            ends.append((step, truncated.tolist()))
    assert ends == [(10, [True] * 3), (20, [True] * 3)]


def test_actions_of_a_wrong_shape_are_refused() -> None:
    env = make_env(2)
    env.reset(seed=0)
    with pytest.raises(UserError) as error:
        env.step(np.zeros((2, 10)))
    assert str(error.value) == "actions must have shape (2, 11), not (2, 10)"


def test_actions_beyond_1_are_actions_of_1() -> None:
    runs = []
    for size in (1.0, 7.0):
        env = make_env(2, pose="bent")
        env.reset(seed=0)
        runs.append(env.step(np.tile(np.linspace(-1, 1, 11) > 0, (2, 1)) * 2.0 * size - size)[0])
    np.testing.assert_array_equal(*runs)


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_with_nan_actions_terminates_alone_and_the_others_bits_do_not_change() -> None:
    runs = []
    for broken in (False, True):
        env = make_env(3, pose="bent", disturbance=NO_PUSH)
        env.reset(seed=0)
        actions = np.full((3, 11), 0.05)
        env.step(actions)
        if broken:
            actions[1] = np.nan
        runs.append(env.step(actions))
    (whole, whole_rewards, *_), (observations, rewards, terminated, truncated, info) = runs
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert np.isfinite(observations).all()
    assert np.isfinite(rewards).all()
    assert np.isfinite(info["final_obs"]).all()
    np.testing.assert_array_equal(observations[[0, 2]], whole[[0, 2]])
    np.testing.assert_array_equal(rewards[[0, 2]], whole_rewards[[0, 2]])


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_with_nan_actions_terminates_every_time() -> None:
    env = make_env(2, pose="bent", disturbance=NO_PUSH)
    env.reset(seed=0)
    actions = np.zeros((2, 11))
    actions[0] = np.nan
    for _ in range(3):
        assert env.step(actions)[2].tolist() == [True, False]
