"""Warm start: the start of a run from the networks of another run, or from a policy whose critic is learned first."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from surefoot.agents.load import load_policy
from surefoot.agents.network import NetworkAgent
from surefoot.errors import UserError
from surefoot.learning.config import DAGGER, TrainConfig
from surefoot.learning.learner import Learner
from surefoot.learning.run_folder import RunFolder
from surefoot.robots import load_robot

CRITIC_FIRST_STEPS = 250_000
"""Policy steps in which only the critic learns, when a run begins with a policy and no critic."""

_RECORDED = ("preset", "seed", "policy_steps", "minutes")


@dataclass(frozen=True)
class Origin:
    """The start of a run.

    Attributes:
        record: preset, seed, policy steps and minutes of it, and under "after" the same of what it began with itself;
            empty for a run with new networks.
        held_until: the actor is held until this policy step, counted with those of the record.
    """

    record: dict[str, Any] = field(default_factory=dict)
    held_until: int = 0

    @property
    def num_steps(self) -> int:
        """Policy steps before this run."""
        return self.record.get("policy_steps", 0)

    @property
    def minutes(self) -> float:
        """Minutes before this run."""
        return self.record.get("minutes", 0.0)


def warm_start(config: TrainConfig, source: str | Path) -> RunFolder | NetworkAgent | None:
    """Return what a run is to begin with, if it fits; None for a student after a run of another algorithm.

    Args:
        config: of the new run.
        source: a run folder, the name of a shipped policy, or a policy file.

    Raises:
        UserError: there is no such thing, or the run cannot begin with it; the message names what differs.
    """
    if Path(source).is_dir():
        folder = RunFolder(source)
        algorithms = folder.config().algorithm, config.algorithm
        if DAGGER in algorithms:
            return _policy(config, source) if algorithms[0] == DAGGER else None
        _check_run(config, folder.config(), folder.path)
        return folder
    return _policy(config, source)


def begin_with(learner: Learner, source: RunFolder | NetworkAgent) -> Origin:
    """Give a learner the networks that it begins with."""
    return _begin_with_run(learner, source) if isinstance(source, RunFolder) else _begin_with_policy(learner, source)


def _begin_with_run(learner: Learner, folder: RunFolder) -> Origin:
    parameters, state = folder.load_checkpoint()
    config, before = folder.config(), state.get("inherited", {})
    learner.take_networks(parameters, state)
    record = {
        "preset": config.preset,
        "seed": config.seed,
        "policy_steps": state["steps"],
        "minutes": round(state["seconds"] / 60.0 + before.get("minutes", 0.0), 2),
    }
    return Origin(record | ({"after": before} if before else {}))


def _begin_with_policy(learner: Learner, policy: NetworkAgent) -> Origin:
    origin = origin_of(policy)
    learner.take_policy(policy, origin.num_steps)
    return dataclasses.replace(origin, held_until=origin.num_steps + CRITIC_FIRST_STEPS)


def origin_of(policy: NetworkAgent) -> Origin:
    """Return what a run that begins with a policy says of it."""
    known = policy.contract.training
    return Origin({key: known[key] for key in (*_RECORDED, "after") if key in known})


def _policy(config: TrainConfig, source: str | Path) -> NetworkAgent:
    policy = load_policy(source)
    _check_policy(config, policy, source)
    return policy


def _check_run(config: TrainConfig, before: TrainConfig, path: Path) -> None:
    if config.privileged_critic:  # a critic can be given the privileged observation later
        before = dataclasses.replace(before, privileged_critic=True)
    for name in ("algorithm", "actor", "critic", "mirror", "privileged_critic", "past_observations", "past_actions"):
        _check_same(path, name, getattr(before, name), getattr(config, name))
    for name in ("robot", "pose", "action_scale"):
        _check_same(path, name, getattr(before.env, name), getattr(config.env, name))


def _check_policy(config: TrainConfig, policy: NetworkAgent, source: str | Path) -> None:
    contract, env = policy.contract, config.env
    sides = 2 if config.mirror and config.algorithm != "ddpg" else 1  # a symmetric network is two side by side
    hidden = tuple(sides * width for width in config.actor)
    algorithm = contract.training.get("algorithm")
    if "ddpg" in (algorithm, config.algorithm):  # the networks of all others are alike
        _check_same(source, "algorithm", algorithm, config.algorithm)
    for name in ("past_observations", "past_actions"):
        _check_same(source, name, getattr(contract, name), getattr(config, name))
    if not config.hyper.get("mixture"):  # a mixture takes another one's trunk, and checks that itself
        _check_same(source, "hidden layers", policy.hidden, hidden)
    _check_same(source, "robot", contract.robot, env.robot)
    _check_same(source, "nominal pose", contract.nominal_pose, tuple(load_robot(env.robot).pose(env.pose).tolist()))
    _check_same(source, "action_scale", contract.action_scale, env.action_scale)


def _check_same(source: str | Path, name: str, theirs: object, ours: object) -> None:
    if theirs != ours:
        raise UserError(f"{source} was learned with {name} {theirs}, this run has {ours}")
