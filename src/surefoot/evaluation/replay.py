"""Replay: a bit-exact repetition of a trial of a results table, and the differences in its outcome."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.resources
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from surefoot.agents.load import NOMINAL, is_controller, load_agent, load_policy, shipped_policies, usual_robot
from surefoot.agents.network import NetworkAgent
from surefoot.agents.nominal import NominalAgent
from surefoot.agents.policy_file import SUFFIX
from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.results import Row
from surefoot.evaluation.setup import Setup
from surefoot.evaluation.trials import run_list
from surefoot.robots import Robot, load_robot
from surefoot.task.agent import Agent

RUNS = Path("runs")
"""Where a policy is looked for beside the package: `surefoot train` and `reproduce` write here."""


def find_policy(name: str, digest: str, given: str | Path | None = None, robot_name: str = "") -> Agent:
    """Find the policy or controller of a digest.

    Without a given one, it is looked for among the shipped ones, the robot's poses and `runs/`, and where a
    controller's name says.

    Args:
        name: what results call it, for errors.
        digest: by which results know it.
        given: a shipped policy's name, a policy file, a run folder, or a controller's name.
        robot_name: of the robot that a controller drove; that of the shipped policies without it.

    Raises:
        UserError: the given policy has another digest, or there is none of this digest.
    """
    robot = load_robot(robot_name) if robot_name else usual_robot()
    if given is not None:
        return _given_policy(name, digest, given, robot)
    if is_controller(name):
        controller = load_agent(name, robot)
        if controller.digest == digest:
            return controller
        raise UserError(f"{name} was another one: its digest was {digest[:12]}, now it is {controller.digest[:12]}")
    for pose in robot.poses:
        nominal = NominalAgent(robot, pose)
        if nominal.digest == digest:
            return nominal
    for data, place in _policy_files():
        if hashlib.sha256(data).hexdigest() == digest:
            return NetworkAgent(data, name, place)
    raise UserError(
        f"no policy '{name}' of digest {digest[:12]} among the shipped ones ({', '.join(shipped_policies())}) and in "
        f"{RUNS}/; give it with --policy"
    )


def _given_policy(name: str, digest: str, given: str | Path, robot: Robot) -> Agent:
    """The policy of a digest in a run folder, or the one that is named, if it has this digest."""
    folder = Path(given)
    files = sorted(map(str, folder.glob(f"*{SUFFIX}"))) if folder.is_dir() else [str(given)]
    loaded = [_load(file, robot) for file in files] or [load_policy(given)]
    for policy in loaded:
        if policy.digest == digest:
            return policy
    found = ", ".join(policy.digest[:12] for policy in loaded)
    raise UserError(f"{given} is another policy: its digest is {found}, that of '{name}' is {digest[:12]}")


def _load(name: str, robot: Robot) -> Agent:
    """Load the agent of a name; an agent that is not one of our networks drives the robot."""
    return load_agent(name, robot if is_controller(name) or name == NOMINAL else None)


def _policy_files() -> Iterator[tuple[bytes, str]]:
    shipped = importlib.resources.files("surefoot.agents") / "shipped"
    for name in shipped_policies():
        yield (shipped / f"{name}{SUFFIX}").read_bytes(), name
    for file in sorted(RUNS.rglob(f"*{SUFFIX}")):
        yield file.read_bytes(), str(file)


def check_setup(setup: Setup, what: str) -> None:
    """Check that a result was made in the setup that this installation has.

    Args:
        setup: of the result.
        what: it is, for the message.

    Raises:
        UserError: it was made in another one; the message says what differs.
    """
    found = setup.differences(Setup.now(setup.robot, setup.engine_word))
    if found:
        raise UserError(f"{what} cannot be run again as it was: {', '.join(found)}")


def policy_of(row: Row, what: str, given: str | Path | None = None) -> Agent:
    """The policy or controller of a row that can be run again as it was.

    Args:
        row: of a results table.
        what: it is, for errors.
        given: as of `find_policy`.

    Raises:
        UserError: the row was made in another setup, or its policy is not found.
    """
    check_setup(row.key.setup, what)
    return find_policy(row.policy_name, row.key.agent, given, row.key.setup.robot)


def replay(row: Row, policy: Agent) -> Outcome:
    """Run the row's trial again, alone; it had up to 191 neighbours."""
    trial = row.trial
    engine = row.key.setup.engine_word
    return run_list(policy, [trial], num_slots=1, num_threads=1, domain=trial.domain, engine=engine)[trial]


def differences(before: Outcome, after: Outcome) -> list[tuple[str, Any, Any]]:
    """Name, old and new value of every field that is not the same to the last bit."""
    pairs = [(f.name, getattr(before, f.name), getattr(after, f.name)) for f in dataclasses.fields(Outcome)]
    return [(name, old, new) for name, old, new in pairs if not _same(old, new)]


def _same(old: Any, new: Any) -> bool:
    return old == new or (isinstance(old, float) and isinstance(new, float) and math.isnan(old) and math.isnan(new))
