"""Source: the origin of the played policy, and the check for a newer version of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from surefoot.agents.load import NOMINAL, is_controller, load_agent, load_policy, shipped_policies, usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.agents.policy_file import SUFFIX
from surefoot.errors import UserError
from surefoot.robots import Robot
from surefoot.task.agent import Agent

_CHECKPOINTS = (f"last{SUFFIX}", f"best{SUFFIX}")
"""Policies of a run folder, the newest first."""


class PolicySource:
    """A shipped policy, "nominal", a controller, a policy file, or a run folder whose newest checkpoint is followed.

    Args:
        name: as a user gives it.
        robot: whose nominal pose is meant, and whose policies are accepted; the shipped policies' robot, and any,
            without it.
        policy: the policy of this name, if it is at hand; it is not read again then.

    Attributes:
        policy: the newest; the nominal pose while a run has none yet.
        is_waiting: a run that has no checkpoint yet.

    Raises:
        UserError: there is no such policy, or it cannot be run.
    """

    def __init__(self, name: str, robot: Robot | None = None, policy: Agent | None = None):
        self._robot = robot
        self.name = name
        self.is_waiting = False
        is_known = name == NOMINAL or name in shipped_policies() or is_controller(name)
        self._path = None if is_known or policy else Path(name)
        self._seen = self._stamp()
        self.policy = policy or self._load()

    def refresh(self) -> bool:
        """Read the policy again if its file has changed; was there news?

        Raises:
            UserError: the new file cannot be run; the old policy stays.
        """
        stamp = self._stamp()
        if stamp == self._seen:
            return False
        self._seen = stamp
        self.policy = self._load()
        return True

    @property
    def description(self) -> str:
        """How the policy was learned, in a line."""
        if self.is_waiting:
            return "waiting for the first checkpoint"
        training = self.policy.contract.training
        if not training:
            return "no learning: the joints hold their nominal pose" if self.name == NOMINAL else ""
        steps = training.get("policy_steps")
        parts = [
            f"learned by {_algorithm_words(training['algorithm'])}" if "algorithm" in training else "",
            f"preset {training['preset']}" if "preset" in training else "",
            _steps_words(steps) if isinstance(steps, int | float) else "",
            _minutes_words(training["minutes"]) if isinstance(training.get("minutes"), int | float) else "",
        ]
        return ", ".join(part for part in parts if part)

    def _file(self) -> Path | None:
        if self._path is None or not self._path.is_dir():
            return self._path
        return next((self._path / name for name in _CHECKPOINTS if (self._path / name).exists()), None)

    def _stamp(self) -> tuple[Path, int] | None:
        try:
            file = self._file()
            return (file, file.stat().st_mtime_ns) if file else None
        except OSError:
            return None

    def _load(self) -> Agent:
        if self.name == NOMINAL or is_controller(self.name):
            return load_agent(self.name, self._robot)
        file = self._file()
        self.is_waiting = file is None and self._path is not None and (self._path / "config.json").exists()
        if self.is_waiting:
            return NominalAgent(self._robot or usual_robot())
        policy = load_policy(file or self.name)
        if self._robot and policy.robot.fingerprint != self._robot.fingerprint:
            raise UserError(f"{self.name} is a policy for {policy.robot.name}, not for {self._robot.name}")
        if file and self._path and self._path.is_dir():
            policy.name = self._path.name
        return policy


def offered_policies(robot: Robot, folders: Sequence[Path], *more: str) -> tuple[str, ...]:
    """Names to choose from: shipped ones for the robot, the nominal pose, what is in `folders`, and `more`.

    Of the folders, run folders and policy files are offered.
    """
    shipped = shipped_policies() if robot.fingerprint == usual_robot().fingerprint else ()
    found = sorted(str(path) for folder in folders if folder.is_dir() for path in folder.iterdir() if _is_policy(path))
    return tuple(dict.fromkeys([*shipped, NOMINAL, *found, *more]))


def _is_policy(path: Path) -> bool:
    return (path / "config.json").is_file() or (path.suffix == SUFFIX and path.is_file())


def _algorithm_words(name: object) -> str:
    return "DAgger" if name == "dagger" else str(name).upper()


def _steps_words(steps: float) -> str:
    return f"{steps / 1e6:.2g} million steps" if steps >= 1e5 else f"{steps:,.0f} steps"


def _minutes_words(minutes: float) -> str:
    return f"{minutes:.0f} min" if minutes >= 10.0 else f"{minutes:.2g} min"
