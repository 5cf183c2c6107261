"""Inheritance: what a run may begin with, the networks of another run or a policy alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from surefoot.agents.load import load_policy
from surefoot.agents.network import NetworkAgent
from surefoot.errors import UserError
from surefoot.learning.config import TrainConfig
from surefoot.learning.run_folder import RunFolder
from surefoot.robots import load_robot


def forerunner(config: TrainConfig, after: str | Path) -> RunFolder | NetworkAgent:
    """What a run is to begin with.

    Args:
        config: of the new run.
        after: a run folder, the name of a shipped policy, or a policy file.

    Raises:
        UserError: there is no such thing, or the run cannot begin with it; it names what differs.
    """
    if Path(after).is_dir():
        folder = RunFolder(after)
        _check_run(config, folder.config(), folder.path)
        return folder
    policy = load_policy(after)
    _check_policy(config, policy, after)
    return policy


def _check_run(config: TrainConfig, before: TrainConfig, path: Path) -> None:
    ours, theirs = dataclasses.asdict(config), dataclasses.asdict(before)
    if config.foresight:
        theirs["foresight"] = True  # a critic can be told of it later
    for name in ("algorithm", "actor", "critic", "mirror", "foresight"):
        _check_same(path, name, theirs[name], ours[name])
    for name in ("robot", "pose", "action_scale"):
        _check_same(path, name, theirs["env"][name], ours["env"][name])


def _check_policy(config: TrainConfig, policy: NetworkAgent, after: str | Path) -> None:
    contract, env = policy.contract, config.env
    sides = 2 if config.mirror and config.algorithm != "ddpg" else 1  # a symmetric network is two side by side
    hidden = tuple(sides * width for width in config.actor)
    _check_same(after, "algorithm", contract.training.get("algorithm"), config.algorithm)
    _check_same(after, "hidden layers", policy.hidden, hidden)
    _check_same(after, "robot", contract.robot, env.robot)
    _check_same(after, "nominal pose", contract.nominal_pose, tuple(load_robot(env.robot).pose(env.pose).tolist()))
    _check_same(after, "action_scale", contract.action_scale, env.action_scale)


def _check_same(path: str | Path, name: str, theirs: object, ours: object) -> None:
    if theirs != ours:
        raise UserError(f"{path} was learned with {name} {theirs}, this run has {ours}")
