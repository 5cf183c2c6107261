"""Crew: a learner that updates from the experience that workers elsewhere collect.

On-policy, all workers collect a rollout with the same policy while the learner waits for them. Off-policy, they collect
with the previous policy while the learner does its pending gradient steps. Robots and gradients thus overlap, and the
result does not depend on the order in which they finish.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.type_aliases import RolloutReturn

from surefoot.errors import UserError
from surefoot.learning.config import DAGGER, TrainConfig
from surefoot.learning.ddpg import BatchDDPG
from surefoot.learning.learner import Learner
from surefoot.learning.rollouts import COLLECTED, REPLAY_STEPS, Order, Rollout, as_infos, collecting


class Crew(Protocol):
    """Workers that collect for one learner."""

    num_workers: int

    def begin(self, config: TrainConfig) -> None:
        """Give every worker its robots; those of before are gone."""
        ...

    def order(self, order: Order) -> None:
        """Let every worker begin to collect."""
        ...

    def collected(self) -> list[Rollout]:
        """Wait for the rollouts of all workers, in the order of the workers."""
        ...


def check_crew(config: TrainConfig, crew: Crew | None) -> None:
    """Check that a run can be shared among workers, if there are any.

    Raises:
        UserError: it is a student's, or its robots cannot be shared evenly.
    """
    if crew is None:
        return
    if config.algorithm == DAGGER:
        raise UserError("a student learns in one process: --executor ray is for trpo, ppo and ddpg")
    if config.num_envs % crew.num_workers:
        raise UserError(f"{config.num_envs} robots cannot be shared evenly by {crew.num_workers} workers")


def join(learner: Learner, crew: Crew, position: Callable[[], tuple[float, float]]) -> None:
    """Let workers move the robots of a learner from now on.

    Args:
        learner: whose algorithm collects by them.
        crew: the workers.
        position: what is left of the exploration, and the share of the schedules that is done.
    """
    check_crew(learner.config, crew)
    crew.begin(learner.config)
    collect = _collect_on_policy if isinstance(learner.model, OnPolicyAlgorithm) else _collect_off_policy

    def collect_rollouts(env: Any, callback: BaseCallback, *_: Any, **__: Any) -> Any:
        callback.on_rollout_start()
        weights = {name: tensor.numpy().copy() for name, tensor in collecting(learner.model).state_dict().items()}
        crew.order(Order(weights, *position()))
        return collect(learner, crew, callback)

    learner.model.collect_rollouts = collect_rollouts  # type: ignore[attr-defined]


def _collect_on_policy(learner: Learner, crew: Crew, callback: BaseCallback) -> bool:
    model: Any = learner.model
    rollouts = crew.collected()
    buffer = model.rollout_buffer
    buffer.reset()
    for name in COLLECTED:
        getattr(buffer, name)[:] = np.concatenate([rollout.arrays[name] for rollout in rollouts], axis=1)
    buffer.pos, buffer.full = buffer.buffer_size, True
    go_on = _take(learner, rollouts, model.n_steps, callback)
    callback.on_rollout_end()
    return go_on


def _collect_off_policy(learner: Learner, crew: Crew, callback: BaseCallback) -> RolloutReturn:
    model = learner.model
    assert isinstance(model, BatchDDPG)
    buffer: Any = model.replay_buffer
    model.pay(REPLAY_STEPS)
    rollouts = crew.collected()
    for parts in zip(*(rollout.transitions for rollout in rollouts), strict=True):
        *arrays, truncated = (np.concatenate(each) for each in zip(*parts, strict=True))
        buffer.add(*arrays, as_infos(truncated))
    go_on = _take(learner, rollouts, REPLAY_STEPS, callback)
    callback.on_rollout_end()
    return RolloutReturn(REPLAY_STEPS * learner.config.num_envs, 0, continue_training=go_on)


def _take(learner: Learner, rollouts: list[Rollout], num_steps: int, callback: BaseCallback) -> bool:
    """Count what came, and tell the callback; returns whether it wants to go on."""
    model = learner.model
    model.num_timesteps += num_steps * learner.config.num_envs
    assert model.ep_info_buffer is not None
    for rollout in rollouts:
        model.ep_info_buffer.extend(rollout.episodes)
    names = rollouts[0].reward_means
    learner.env.reward_means = {name: float(np.mean([r.reward_means[name] for r in rollouts])) for name in names}
    callback.update_locals({})
    return callback.on_step()
