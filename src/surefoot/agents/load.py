"""Load: agents by name, which may be our or foreign policies, run folders, the nominal pose, or controllers."""

from __future__ import annotations

import copyreg
import functools
import importlib.resources
from pathlib import Path

from surefoot.agents.controllers import PREFIX, ControllerAgent, load_controller
from surefoot.agents.foreign.load import is_foreign, load_foreign
from surefoot.agents.network import NetworkAgent
from surefoot.agents.nominal import NominalAgent
from surefoot.agents.onnx_check import MAX_BYTES
from surefoot.agents.policy_file import SUFFIX
from surefoot.checks import check_path, read_bytes
from surefoot.errors import UserError
from surefoot.robots import Robot
from surefoot.task.agent import Agent

NOMINAL = "nominal"
"""The name of the agent that holds the robot's default pose."""


def load_agent(name: str, robot: Robot | None = None) -> Agent:
    """Load an agent by its name: `controllers/NAME`, `FILE.py:CLASS`, "nominal", or our own or a foreign policy.

    Args:
        name: name of the agent, as a user gives it.
        robot: the robot to drive. The default is the robot for which a policy was trained; for other agents it is that
            of the shipped policy "best".

    Raises:
        UserError: there is no agent of this name, it cannot be run, or it is a policy for another robot.
    """
    if is_foreign(name):
        return load_foreign(name, robot or usual_robot())
    if is_controller(name):
        return load_controller(name, robot or usual_robot())
    if name == NOMINAL:
        return NominalAgent(robot or usual_robot())
    if name.endswith(".toml"):
        raise UserError(f"{name} is no policy; a robot's description goes with --robot, scenarios go with --suite")
    policy = load_policy(name)
    if robot and policy.robot.fingerprint != robot.fingerprint:
        raise UserError(f"{name} is a policy for {policy.robot.name}, not for {robot.name}")
    return policy


def _load_again(name: str, robot: Robot) -> ControllerAgent:
    return load_foreign(name, robot) if is_foreign(name) else load_controller(name, robot)


# A controller travels by its name: whoever unpickles it loads its code or its network anew.
copyreg.pickle(ControllerAgent, lambda agent: (_load_again, (agent.name, agent.robot)))


def is_controller(name: str) -> bool:
    """Tell whether a name is that of a controller: `controllers/NAME`, `FILE.py:CLASS` or a foreign policy's file."""
    return name.startswith(PREFIX) or ".py:" in name or is_foreign(name)


@functools.cache
def usual_robot() -> Robot:
    """The robot of the shipped policy "best"."""
    return load_policy("best").robot


def shipped_policies() -> tuple[str, ...]:
    """Names of the policies that come with the package."""
    folder = importlib.resources.files("surefoot.agents") / "shipped"
    if not folder.is_dir():
        return ()
    return tuple(sorted(file.name.removesuffix(SUFFIX) for file in folder.iterdir() if file.name.endswith(SUFFIX)))


def load_policy(name: str | Path) -> NetworkAgent:
    """Read a policy that comes with the package, a policy file, or the best policy of a run folder.

    Args:
        name: name of a shipped policy ("best", "ddpg", "ppo" or "trpo"), or path of a policy file (.onnx) or of a run
            folder.

    Returns:
        The policy. Its `contract` describes its inputs and outputs, `robot` is the robot that it moves, and
        `actions(observations)` runs its network.

    Raises:
        UserError: there is no such policy, or it is not one that this version can run.
    """
    if str(name) in shipped_policies():
        file = importlib.resources.files("surefoot.agents") / "shipped" / f"{name}{SUFFIX}"
        return NetworkAgent(file.read_bytes(), str(name))
    check_path("policy", name)
    path = Path(name)
    path_of_file = path / f"best{SUFFIX}" if path.is_dir() else path
    try:
        data = read_bytes(path_of_file, "policy", MAX_BYTES)
    except UserError as error:
        shipped = f"; shipped policies: {', '.join(shipped_policies())}" if shipped_policies() else ""
        raise UserError(f"{error}{shipped}") from error
    return NetworkAgent(data, name=path.stem, source=str(path_of_file))
