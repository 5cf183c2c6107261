"""Controllers: what moves robots by a law of its own, and how it enters the trials beside the networks."""

from __future__ import annotations

import dataclasses
import time
from collections import Counter
from collections.abc import Callable
from typing import Protocol

import numpy as np

from surefoot.agents.controllers.step_times import StepTimes
from surefoot.robots import Robot
from surefoot.task.agent import RATES_HZ, Agent, Command, Inputs, check_agent
from surefoot.task.contract import Contract
from surefoot.task.state import State

__all__ = ["RATES_HZ", "Command", "Controller", "ControllerAgent", "State"]


class Controller(Protocol):
    """What moves robots by a law of its own; made as `Controller(robot, num_robots)`.

    Two more attributes may say: `pose`, the name of the pose in which trials begin (the robot's default pose without
    it), and `path`, how the targets get to the next ones: "hold" (at once, then held), "line" (linearly, over the
    control step) or "cubic" (at rest at both ends).
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
        digest: of its code, by which results name it.
        robot: the robot that it is to drive.

    Attributes:
        times: of all control steps so far.
        failures: how often it failed a trial, by reason and, for what it raised, the error.

    Raises:
        UserError: it wants a rate or a path that there is not.
    """

    inputs: Inputs = "state"

    def __init__(self, name: str, make: Callable[[Robot, int], Controller], digest: str, robot: Robot):
        self.name = name
        self.make = make
        self.digest = digest
        self.robot = robot
        self.rate_hz: int = getattr(make, "rate_hz", None)  # type: ignore[assignment]  # None is refused below
        self.path: str = getattr(make, "path", "hold")
        self.failures: Counter[str] = Counter()
        check_agent(self)
        self.times = StepTimes(self.rate_hz)
        self._controller: Controller | None = None

    def anew(self) -> ControllerAgent:
        """The same controller without the times and failures of this one."""
        return ControllerAgent(self.name, self.make, self.digest, self.robot)

    @property
    def contract(self) -> Contract:
        """What it assumes about the robot: pose and gains."""
        pose = getattr(self.make, "pose", self.robot.default_pose)
        plain = Contract.of(self.robot, pose, 1.0, {"controller": self.name})
        return dataclasses.replace(plain, policy_hz=self.rate_hz, target_path=self.path)

    def prepare(self, num_robots: int) -> None:
        """Make the controller for so many robots."""
        self._controller = self.make(self.robot, num_robots)

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
