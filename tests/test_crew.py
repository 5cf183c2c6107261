"""A crew: workers move the robots of one learner, whose buffers hold what its own policy met."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from conftest import tiny

from surefoot.cli.train import Train
from surefoot.errors import UserError
from surefoot.learning.config import TrainConfig
from surefoot.learning.crew import check_crew, join
from surefoot.learning.learner import Learner
from surefoot.learning.rollouts import REPLAY_STEPS, Order, Rollout, RolloutWorker
from surefoot.learning.train import train

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore:You have specified a mini-batch size:UserWarning"),
]


class Here:
    """Two workers in this process."""

    num_workers = 2

    def begin(self, config: TrainConfig) -> None:
        self.workers = [RolloutWorker(config, place, 2) for place in range(2)]

    def order(self, order: Order) -> None:
        self.told = order

    def collected(self) -> list[Rollout]:
        return [worker.collect(self.told) for worker in self.workers]


def collected(algorithm: str, num_rollouts: int) -> Learner:
    """A learner whose workers have collected, and which has not learned."""
    learner = Learner(tiny(algorithm), lambda _: 1e-3)
    model: Any = learner.model
    join(learner, Here(), lambda: (1.0, 0.0))
    _, callback = model._setup_learn(10**9, None)
    for _ in range(num_rollouts):
        assert model.collect_rollouts(model.env, callback)
    return learner


def test_a_rollout_of_workers_is_what_the_learners_own_policy_did_with_all_robots() -> None:
    learner = collected("ppo", 1)
    model: Any = learner.model
    buffer = model.rollout_buffer
    assert buffer.actions.shape[:2] == (8, 8)  # steps, robots
    assert learner.num_steps == 64
    assert len(np.unique(buffer.observations[0].round(5), axis=0)) == 8  # no robot twice
    flat = buffer.swap_and_flatten
    observations, actions = torch.from_numpy(flat(buffer.observations)), torch.from_numpy(flat(buffer.actions))
    with torch.no_grad():
        values, log_probs, _ = model.policy.evaluate_actions(observations, actions)
    np.testing.assert_allclose(flat(buffer.log_probs)[:, 0], log_probs, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(flat(buffer.values), values, rtol=1e-4, atol=1e-4)
    assert learner.env.reward_means


def test_transitions_of_two_messages_follow_each_other_in_the_replay_buffer() -> None:
    learner = collected("ddpg", 2)
    model: Any = learner.model
    buffer = model.replay_buffer
    assert buffer.pos == 2 * REPLAY_STEPS
    assert learner.num_steps == 2 * REPLAY_STEPS * 8
    for step in range(buffer.pos - 1):
        goes_on = buffer.dones[step] == 0
        np.testing.assert_array_equal(buffer.next_observations[step][goes_on], buffer.observations[step + 1][goes_on])
    # The robot that explores least strays from the actor's answer by 3 standard deviations at most, nearly always.
    with torch.no_grad():
        answers = model.actor(torch.from_numpy(buffer.observations[: buffer.pos].reshape(-1, *buffer.obs_shape)))
    strays = np.abs(answers.numpy().reshape(buffer.pos, 8, -1) - buffer.actions[: buffer.pos])
    assert np.mean(strays[:, [0, 4]] < 3.0 * learner.config.noise[0] + 1e-6) > 0.95


def test_robots_that_cannot_be_shared_evenly_and_other_executors_are_refused(tmp_path: Path) -> None:
    three = Here()
    three.num_workers = 3
    with pytest.raises(UserError, match="8 robots cannot be shared evenly by 3 workers"):
        check_crew(tiny("ppo"), three)
    with pytest.raises(UserError, match="one training is shared by --executor ray alone, not dask"):
        Train(executor="dask", steps=1, run=tmp_path / "r").main()


def test_a_training_on_ray_survives_the_death_of_a_worker(tmp_path: Path) -> None:
    ray = pytest.importorskip("ray", reason="needs the extra ray")
    from surefoot.learning.ray_crew import RayCrew

    class Killing(RayCrew):
        rounds = 0

        def order(self, order: Order) -> None:
            self.rounds += 1
            if self.rounds == 2:
                pid = ray.get(self._workers[0].pid.remote())
                os.kill(pid, signal.SIGKILL)
            super().order(order)

    with Killing("", 2) as crew:
        trainer = train(tiny("ppo"), tmp_path / "run", crew=crew)
    assert trainer.progress.steps == 512 == crew.rounds * 64
    assert (tmp_path / "run" / "best.onnx").exists()
