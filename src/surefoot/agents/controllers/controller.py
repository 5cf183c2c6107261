"""Protocol: what a controller is given of its robots, what it answers, and how it enters the trials beside policies."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from surefoot.agents.contract import Contract
from surefoot.agents.controllers.step_times import StepTimes
from surefoot.errors import UserError
from surefoot.rates import CONTROL_HZ, POLICY_HZ
from surefoot.robots import Robot, load_robot

RATES_HZ = tuple(rate for rate in range(POLICY_HZ, CONTROL_HZ + 1) if CONTROL_HZ % rate == 0)
"""At which a controller may run: 25, 50, 100, 125, 250 and 500 Hz."""
PATHS = ("hold", "line")


@dataclass(frozen=True)
class State:
    """What the state estimators of n robots know: in SI units, 2 ms old, and nothing of who pushes.

    Vectors are in the heading frame: x forward, y left, z up, turned with the root's yaw. Positions are counted from
    the root. Feet: left, right.

    Attributes:
        time: since the trial's start [s] (n,).
        joint_position, joint_velocity: (n, num_joints) [rad, rad/s].
        root_attitude: roll and pitch (n, 2) [rad].
        root_velocity, root_angular_velocity: (n, 3) [m/s, rad/s].
        com_position, com_velocity: (n, 3) [m, m/s].
        capture_point: x + v sqrt(z / g), (n, 2) [m].
        com_height: of the CoM above the lower sole (n,) [m].
        sole_position: centres of the soles (n, 2, 3) [m].
        foot_attitude: roll and pitch of the feet against the vertical (n, 2, 2) [rad].
        foot_force: normal force on each foot (n, 2) [N].
        pressure_point: pressure centre of each foot, from the root (n, 2, 2) [m]; meaningless without force.
    """

    time: np.ndarray
    joint_position: np.ndarray
    joint_velocity: np.ndarray
    root_attitude: np.ndarray
    root_velocity: np.ndarray
    root_angular_velocity: np.ndarray
    com_position: np.ndarray
    com_velocity: np.ndarray
    capture_point: np.ndarray
    com_height: np.ndarray
    sole_position: np.ndarray
    foot_attitude: np.ndarray
    foot_force: np.ndarray
    pressure_point: np.ndarray

    def __len__(self) -> int:
        return len(self.time)

    def rows(self, rows: np.ndarray) -> State:
        """Some of the robots, by their place in the arrays or as a mask."""
        return State(**{f.name: getattr(self, f.name)[rows] for f in dataclasses.fields(self)})


class Command(NamedTuple):
    """A controller's answer for n robots.

    The joints follow u = stiffness (joint_target - q) + joint_torque - damping dq/dt within the motors' limits.

    Attributes:
        joint_target: (n, num_joints) [rad]; clipped to the joint ranges.
        joint_torque: feed-forward (n, num_joints) [Nm]; none without it.
    """

    joint_target: np.ndarray
    joint_torque: np.ndarray | None = None


class Controller(Protocol):
    """What moves robots by a law of its own; made as `Controller(robot, num_robots)`.

    Two more attributes may say: `pose`, the name of the pose in which trials begin ("bent"), and `path`, how the
    targets get to the next ones: "hold" (at once, then held) or "line" (linearly, over the control step).
    """

    rate_hz: int
    """Control steps per second, one of `RATES_HZ`."""

    def reset(self, ids: np.ndarray) -> None:
        """Robots `ids` (n,), numbers below `num_robots`, begin a trial: forget them."""

    def __call__(self, state: State, ids: np.ndarray) -> Command:
        """One control step of robots `ids` (n,). May be asked again for some of them if it raises."""
        ...


@dataclass(eq=False)
class ControllerAgent:
    """A controller as the trials take it: named, described and digested like a policy.

    Attributes:
        name: by which tables show it, and by which `surefoot evaluate` finds it.
        make: its class, or what else makes one from a robot and a number of robots.
        digest: of its code and of all of surefoot's controllers, on which it may build.
        times: of all control steps so far.
        failures: how often it failed a trial, by reason and, for what it raised, the error.
    """

    name: str
    make: Callable[[Robot, int], Controller]
    digest: str
    times: StepTimes = field(init=False)
    failures: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        rate_hz = getattr(self.make, "rate_hz", None)
        if rate_hz not in RATES_HZ:
            raise UserError(f"{self.name} must have a rate_hz of {', '.join(map(str, RATES_HZ))}, not {rate_hz}")
        if self.path not in PATHS:
            raise UserError(f"{self.name}'s path must be {' or '.join(PATHS)}, not {self.path}")
        self.times = StepTimes(rate_hz)

    @property
    def rate_hz(self) -> int:
        return self.times.rate_hz

    @property
    def path(self) -> str:
        return getattr(self.make, "path", "hold")

    @property
    def contract(self) -> Contract:
        plain = Contract.of(load_robot(), getattr(self.make, "pose", "bent"), 1.0, {"controller": self.name})
        return dataclasses.replace(plain, policy_hz=self.rate_hz, target_path=self.path)
