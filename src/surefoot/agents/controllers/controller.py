"""Controllers: what moves robots by a law of its own, and how it enters the trials beside the networks."""

from __future__ import annotations

import dataclasses
import hashlib
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from surefoot.agents.controllers.step_times import StepTimes
from surefoot.errors import UserError
from surefoot.robots import Robot
from surefoot.task.agent import RATES_HZ, Agent, Command, Gains, Inputs, check_agent
from surefoot.task.contract import Contract
from surefoot.task.guard import in_words
from surefoot.task.state import State

__all__ = ["RATES_HZ", "Command", "Controller", "ControllerAgent", "State"]


class Controller(Protocol):
    """What moves robots by a law of its own; made as `Controller(robot, num_robots)`.

    More attributes may say what it wants; one is made for a single robot to read them:

    - `pose`: the name of the pose in which trials begin, or its joint angles (num_joints,) [rad]; the robot's default
      pose without it.
    - `path`: how the targets get to the next ones: "hold" (at once, then held; so without it), "line" (linearly, over
      the control step) or "cubic" (at rest at both ends).
    - `stiffness`, `damping`: the joint impedance (num_joints,) [Nm/rad, Nms/rad]; the robot's own without them.
    - `clips_targets`: False if targets may lie beyond the joint ranges.
    - `command`: forward, left and turning speed that each robot is asked for (num_robots, 3) [m/s, m/s, rad/s], zero
      at first, for a controller that walks; `surefoot agent check` sets it.
    - `observed`: name -> numbers (n, size) that it was given last, which `surefoot agent check` shows.
    - `files`: paths of the files that it stands on, such as a network; results of other contents are told apart.
    """

    rate_hz: int
    """Control steps per second, one of `RATES_HZ`."""

    def reset(self, ids: np.ndarray) -> None:
        """Forget robots `ids` (n,), numbers below `num_robots`, which begin a trial."""

    def __call__(self, state: State, ids: np.ndarray) -> Command:
        """Decide one control step of robots `ids` (n,). May be asked again for some of them if it raises."""
        ...


class ControllerAgent:
    """A controller as an agent: named, described and digested like a policy.

    Args:
        name: by which tables show it, and by which `surefoot evaluate` finds it.
        make: its class, or what else makes one from a robot and a number of robots.
        digest: of its code, by which results name it, together with the files that it stands on.
        robot: the robot that it is to drive.

    Attributes:
        gains: the joint impedance that it counts on.
        clips_targets: whether its joint targets are clipped to the joint ranges.
        times: of all control steps so far.
        failures: how often it failed a trial, by reason and, for what it raised, the error.

    Raises:
        UserError: it cannot be made for this robot, or wants a rate, a path, a pose or gains that there are not.
    """

    inputs: Inputs = "state"

    def __init__(self, name: str, make: Callable[[Robot, int], Controller], digest: str, robot: Robot):
        self.name, self.make, self.robot = name, make, robot
        self._code_digest = digest
        self.failures: Counter[str] = Counter()
        try:
            self._read(self._made_for_one())
            check_agent(self)
        except UserError:
            raise
        except Exception as error:  # of its own code
            raise UserError(f"{name} does not say what it wants: {in_words(error)}") from error
        self.times = StepTimes(self.rate_hz)
        self._controller: Controller | None = None

    def _read(self, wishes: Controller) -> None:
        """Keep what the controller for a single robot says that it wants."""
        self.rate_hz: int = getattr(wishes, "rate_hz", None)  # type: ignore[assignment]  # None is refused afterwards
        self.path: str = getattr(wishes, "path", "hold")
        self.clips_targets: bool = getattr(wishes, "clips_targets", True)
        self.gains = Gains(
            np.asarray(getattr(wishes, "stiffness", self.robot.stiffness), float),
            np.asarray(getattr(wishes, "damping", self.robot.damping), float),
        )
        self.digest = _with_files(self._code_digest, getattr(wishes, "files", ()))
        self._pose = self._angles_of(getattr(wishes, "pose", self.robot.default_pose))

    def anew(self) -> ControllerAgent:
        """The same controller without the times and failures of this one."""
        return ControllerAgent(self.name, self.make, self._code_digest, self.robot)

    @property
    def contract(self) -> Contract:
        """What it assumes about the robot: pose and gains."""
        plain = Contract.of(self.robot, self.robot.default_pose, 1.0, {"controller": self.name})
        return dataclasses.replace(
            plain,
            policy_hz=self.rate_hz,
            target_path=self.path,
            nominal_pose=tuple(self._pose.tolist()),
            stiffness=tuple(self.gains.stiffness.tolist()),
            damping=tuple(self.gains.damping.tolist()),
        )

    def prepare(self, num_robots: int) -> None:
        """Make the controller for so many robots."""
        self._controller = self.make(self.robot, num_robots)

    def ask_for(self, command: np.ndarray) -> bool:
        """Ask each robot for forward, left and turning speed (num_robots, 3) [m/s, m/s, rad/s].

        Returns:
            Whether the controller takes commands.
        """
        asked = getattr(self._prepared(), "command", None)
        if asked is None:
            return False
        asked[:] = command
        return True

    @property
    def observed(self) -> dict[str, np.ndarray]:
        """What the controller says that it was given in its last control step: name -> numbers (n, size)."""
        return getattr(self._controller, "observed", {})

    def reset(self, ids: np.ndarray) -> None:
        """Let the controller forget robots `ids` (n,)."""
        self._prepared().reset(ids)

    def __call__(self, inputs: State, ids: np.ndarray) -> Command:
        """Let the controller decide one control step of robots `ids` (n,), and keep its time."""
        controller, began = self._prepared(), time.perf_counter()
        try:
            return controller(inputs, ids)
        finally:
            self.times.add(time.perf_counter() - began, len(ids))

    @staticmethod
    def among(agent: Agent) -> ControllerAgent | None:
        """The agent, if it is a controller, whose control steps have been timed."""
        return agent if isinstance(agent, ControllerAgent) else None

    def _prepared(self) -> Controller:
        assert self._controller, "an agent is prepared before it is asked"
        return self._controller

    def _made_for_one(self) -> Controller:
        """The controller for a single robot, which is asked what it wants."""
        try:
            return self.make(self.robot, 1)
        except UserError:
            raise
        except Exception as error:
            raise UserError(f"{self.name} cannot be made for {self.robot.name}: {in_words(error)}") from error

    def _angles_of(self, pose: Any) -> np.ndarray:
        """The pose in which trials begin (num_joints,) [rad], by its name or as angles."""
        if isinstance(pose, str):
            return self.robot.pose(pose)
        angles = np.asarray(pose, float)
        if angles.shape != (self.robot.num_joints,) or not np.isfinite(angles).all():
            raise UserError(
                f"{self.name}'s pose must be {self.robot.num_joints} finite angles, one for each joint of "
                f"{self.robot.name}, or the name of a pose: {', '.join(self.robot.poses)}"
            )
        return angles


def _with_files(digest: str, files: Any) -> str:
    """The digest of some code and of the contents of the files that it stands on."""
    parts = [hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in files]
    return hashlib.sha256("\n".join([digest, *parts]).encode()).hexdigest() if parts else digest
