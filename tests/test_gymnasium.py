"""The task as gymnasium knows it: made by name, one robot or a batch, with pictures and every autoreset mode."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import imageio.v3 as imageio
import numpy as np
import pytest
from conftest import NO_PUSH
from gymnasium.vector import AutoresetMode

import surefoot
from surefoot.errors import UserError
from surefoot.learning.preset_file import preset
from surefoot.physics.pushes import Push
from surefoot.robots import load_robot
from surefoot.task.environment import EnvConfig
from surefoot.task.random_pushes import DisturbanceConfig

ID = "surefoot/PushRecovery-v0"
SHORT = EnvConfig("valkyrie", pose="bent", episode_s=0.2, disturbance=NO_PUSH)
"""Episodes of five policy steps."""


def batch(num_envs: int = 2, **options: object) -> gym.vector.VectorEnv:
    return gym.make_vec(ID, num_envs, **{"config": SHORT, "num_threads": 1, **options})


def zeros(env: gym.vector.VectorEnv) -> np.ndarray:
    return np.zeros(env.action_space.shape, np.float32)


@pytest.mark.parametrize("imports", ["import gymnasium, surefoot", "import surefoot, gymnasium"])
def test_importing_surefoot_is_enough_for_gymnasium_to_make_its_environment(imports: str) -> None:
    code = f"{imports}; gymnasium.spec('{ID}')"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_default_task_is_the_one_that_is_learned_in_minutes() -> None:
    assert gym.make(ID).unwrapped.batch.config == preset("fast", "ddpg").env
    assert gym.make_vec(ID).unwrapped.config == preset("fast", "ddpg").env
    other = EnvConfig("valkyrie", pose="straight")
    assert gym.make(ID, config=other).unwrapped.batch.config == other


def test_the_default_task_is_scaled_to_a_robot_that_is_named() -> None:
    robot = load_robot("g1")
    env = gym.make(ID, robot="g1").unwrapped.batch
    ours, theirs = env.config.disturbance, preset("fast", "ddpg").env.disturbance
    assert ours.impulse[1] == pytest.approx(theirs.impulse[1] * robot.mass_scale, rel=1e-3)
    assert env.single_action_space.shape == (robot.num_joints,)
    with pytest.raises(UserError, match="robot 'g1' stands beside a config, which names its robot already: 'valkyrie'"):
        gym.make(ID, config=SHORT, robot="g1")


def test_one_robot_ends_falls_and_starts_again_by_the_callers_reset() -> None:
    push = DisturbanceConfig(impulse=(600.0, 600.0), first=(0.1, 0.1))
    env = gym.make(ID, config=EnvConfig("valkyrie", pose="straight", disturbance=push))
    first, _ = env.reset(seed=3)
    terminated = truncated = False
    while not (terminated or truncated):
        observation, _, terminated, truncated, means = env.step(np.zeros(11, np.float32))
    assert (terminated, truncated) == (True, False)
    assert means["non_foot_contact"] < 0.0
    assert env.observation_space.contains(observation)
    again, _ = env.reset(seed=3)
    np.testing.assert_array_equal(first, again)


def test_next_step_mode_shows_the_last_observation_then_the_new_start_for_a_reward_of_0() -> None:
    """Episodes of 0.2 s are five steps of 0.04 s."""
    env = batch()
    assert env.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    env.reset(seed=0)
    for _ in range(5):
        last, rewards, terminated, truncated, info = env.step(zeros(env))
    assert truncated.all()
    assert not terminated.any()
    assert (rewards > 0.0).all()
    assert not info
    start, rewards, terminated, truncated, _ = env.step(zeros(env))
    assert (rewards == 0.0).all()
    assert not (terminated | truncated).any()
    np.testing.assert_array_equal(env.unwrapped.loop.tick, 0)
    assert not np.array_equal(last, start)
    for _ in range(5):
        *_, truncated, _ = env.step(zeros(env))
    assert truncated.all()


def test_same_step_mode_gives_the_last_observation_in_the_info() -> None:
    env = batch(autoreset_mode="SAME_STEP")
    env.reset(seed=0)
    for _ in range(5):
        start, _, _, truncated, info = env.step(zeros(env))
    assert truncated.all()
    np.testing.assert_array_equal(env.unwrapped.loop.tick, 0)
    assert info["final_obs"].shape == start.shape
    assert not np.array_equal(info["final_obs"], start)


def test_without_autoreset_an_ended_robot_waits_for_the_callers_mask() -> None:
    env = batch(autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=0)
    env.step(zeros(env))
    env.reset(options={"reset_mask": np.array([False, True])})
    assert env.unwrapped.loop.tick.tolist() == [20, 0]
    ends = [env.step(zeros(env))[3].tolist() for _ in range(6)]
    # The first robot ends after four more of its five steps, the second after five; each is told of once.
    assert ends == [[False, False]] * 3 + [[True, False], [False, True], [False, False]]
    assert (env.step(zeros(env))[1] == 0.0).all()
    with pytest.raises(UserError, match=r"reset_mask must be bool of shape \(2,\)"):
        env.reset(options={"reset_mask": np.array([1, 0])})


def test_gymnasiums_vector_wrappers_accept_every_autoreset_mode_that_they_know() -> None:
    wrappers = gym.wrappers.vector
    for mode in ("NEXT_STEP", "SAME_STEP"):
        env = wrappers.RecordEpisodeStatistics(wrappers.NormalizeReward(batch(autoreset_mode=mode)))
        env.reset(seed=0)
        for _ in range(5):
            *_, info = env.step(zeros(env))
        np.testing.assert_array_equal(info["episode"]["l"], [5, 5])
    env = wrappers.NormalizeObservation(batch())
    env.reset(seed=0)
    observation, *_ = env.step(zeros(env))
    assert np.abs(observation).max() < 10.0


def test_a_picture_of_one_robot_shows_the_push_that_acts() -> None:
    """The push begins after 0.1 s and lasts 0.12 s: within the third and the sixth step of 0.04 s, red appears."""
    push = DisturbanceConfig(impulse=(240.0, 240.0), first=(0.1, 0.1), duration=0.12)
    config = EnvConfig("valkyrie", pose="bent", disturbance=push)
    env = gym.make(ID, config=config, render_mode="rgb_array", width=320, height=240)
    env.reset(seed=0)
    pictures = [env.render()]
    for _ in range(4):
        env.step(np.zeros(11, np.float32))
        pictures.append(env.render())
    assert {picture.shape for picture in pictures} == {(240, 320, 3)}
    red = [int(((p[..., 0] > 200) & (p[..., 1] < 110) & (p[..., 2] < 80)).sum()) for p in pictures]
    assert red[-1] > 20 + max(red[:2]), red
    env.close()


def test_a_batch_draws_each_robot_and_none_without_a_render_mode() -> None:
    env = batch(render_mode="rgb_array", width=64, height=48)
    env.reset(seed=0)
    assert [picture.shape for picture in env.render()] == [(48, 64, 3)] * 2
    env.close()
    assert batch().render() is None
    with pytest.raises(UserError, match=r"unknown render_mode 'human'; valid: None, rgb_array"):
        batch(render_mode="human")
    with pytest.raises(UserError, match=r"unknown autoreset_mode 'later'; valid: NEXT_STEP, SAME_STEP, DISABLED"):
        batch(autoreset_mode="later")


@pytest.mark.filterwarnings("ignore")  # moviepy's
def test_gymnasium_records_a_film_of_an_episode(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = gym.make(ID, config=SHORT, render_mode="rgb_array", width=64, height=48)
    env = gym.wrappers.RecordVideo(env, str(tmp_path), episode_trigger=lambda episode: episode == 0)
    env.reset(seed=0)
    truncated = False
    while not truncated:
        *_, truncated, _ = env.step(np.zeros(11, np.float32))
    env.close()
    (film,) = tmp_path.glob("*.mp4")
    assert imageio.imread(film, plugin="FFMPEG").shape == (6, 48, 64, 3)  # the start, and five steps


def test_a_push_in_a_picture_is_the_one_that_is_scheduled() -> None:
    env = batch(num_envs=1).unwrapped
    env.reset(seed=0)
    assert env._latest_push(0) == (None, 0.0)
    torso = env.robot.body_id("torso")
    env.loop.pushes.schedule(np.array([0]), 1, torso, np.array([[0.0, -60.0, 0.0]]), 10, 0.12)
    env.step(np.zeros((1, 11)))
    push, since = env._latest_push(0)
    assert push == Push("torso", (0.0, -1.0, 0.0), pytest.approx(60.0), 0.0, pytest.approx(0.12))
    assert since == pytest.approx(0.02)  # ten of twenty ticks


def test_the_environment_is_documented_where_it_is_made() -> None:
    assert surefoot.__doc__
    assert ID in surefoot.__doc__
