"""Agents: the interface by which the control loop asks for the joint targets of a batch of robots."""

from __future__ import annotations

from collections import Counter
from typing import Any, Literal, NamedTuple, Protocol, get_args

import numpy as np

from surefoot.checks import shortened
from surefoot.errors import UserError
from surefoot.rates import CONTROL_HZ, POLICY_HZ
from surefoot.robots import Robot
from surefoot.task.contract import Contract

RATES_HZ = tuple(rate for rate in range(POLICY_HZ, CONTROL_HZ + 1) if CONTROL_HZ % rate == 0 and rate % POLICY_HZ == 0)
"""Rates at which an agent may decide [Hz]: a policy step holds a whole number of its control steps."""
PATHS = ("cubic", "line", "hold")
"""How the joint targets get from one control step's to the next one's."""

Inputs = Literal["observation", "state"]
"""The input of an agent: the filtered observation vector, or their `State`."""


class Gains(NamedTuple):
    """The joint impedance that an agent counts on: u = stiffness (joint_target - q) - damping dq/dt.

    Attributes:
        stiffness: (num_joints,) [Nm/rad], positive.
        damping: (num_joints,) [Nms/rad], not negative.
    """

    stiffness: np.ndarray
    damping: np.ndarray


class Command(NamedTuple):
    """An agent's answer for n robots.

    The joints follow u = stiffness (joint_target - q) + joint_torque - damping dq/dt within the motors' limits.

    Attributes:
        joint_target: (n, num_joints) [rad]; the loop clips it to the joint ranges if the agent lets it.
        joint_torque: feed-forward torque (n, num_joints) [Nm]; there is none without it.
    """

    joint_target: np.ndarray
    joint_torque: np.ndarray | None = None


class Agent(Protocol):
    """A network, a controller, or anything else that answers what it is given of the robots by joint targets."""

    failures: Counter[str]
    """How often it has failed a robot, by reason and, for an exception, by the error; the loop counts."""

    @property
    def name(self) -> str:
        """The name by which tables show it."""
        ...

    @property
    def digest(self) -> str:
        """The key of its results: equal only for agents that act alike."""
        ...

    @property
    def robot(self) -> Robot:
        """The robot that it is made for."""
        ...

    @property
    def contract(self) -> Contract:
        """The assumptions about the robot, in a form that can be stored."""
        ...

    @property
    def rate_hz(self) -> int:
        """Control steps per second, one of `RATES_HZ`."""
        ...

    @property
    def path(self) -> str:
        """How the joints get from one control step's targets to the next one's, one of `PATHS`."""
        ...

    @property
    def inputs(self) -> Inputs:
        """The kind of input: "observation" or "state"."""
        ...

    @property
    def gains(self) -> Gains:
        """The joint impedance that it counts on; the robot's own for most agents."""
        ...

    @property
    def clips_targets(self) -> bool:
        """Whether its joint targets are clipped to the joint ranges; the motors' limits hold for every agent."""
        ...

    def prepare(self, num_robots: int) -> None:
        """Get ready to drive robots 0 to `num_robots` - 1, and forget all robots of before."""
        ...

    def reset(self, ids: np.ndarray) -> None:
        """Forget robots `ids` (n,), which begin a trial."""
        ...

    def __call__(self, inputs: Any, ids: np.ndarray) -> Command:
        """Decide one control step of robots `ids` (n,).

        Args:
            inputs: the filtered observations (n, num_observations), or a `State` of n robots.
            ids: the robots' numbers.
        """
        ...


def as_numbers(value: Any) -> np.ndarray:
    """Return what somebody else's code answers as float64 numbers, of whatever shape.

    Raises:
        UserError: it is a text, a ragged list, or anything else than numbers. An object of somebody else's may raise
            anything in addition.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, OverflowError) as error:  # such as lists of different lengths
        raise UserError(f"an array of numbers is needed, not {shortened(value)}") from error
    if array.dtype.kind not in "fiub":
        raise UserError(f"an array of numbers is needed, not one of {array.dtype.name[:60]}: {shortened(value)}")
    return array.astype(np.float64, copy=False)


def check_agent(agent: Agent) -> None:
    """Check what an agent wants of the control loop.

    Raises:
        UserError: it wants a rate, a path or inputs that there are not, or gains that are no impedance.
    """
    if agent.rate_hz not in RATES_HZ:
        valid = ", ".join(map(str, RATES_HZ))
        raise UserError(f"{agent.name} must have a rate_hz of {valid}, not {shortened(agent.rate_hz)}")
    for what, value, valid_ones in (("path", agent.path, PATHS), ("inputs", agent.inputs, get_args(Inputs))):
        if value not in valid_ones:
            raise UserError(f"{agent.name}'s {what} must be {' or '.join(valid_ones)}, not {shortened(value)}")
    stiffness, damping = agent.gains
    for what, gains, is_valid in (("stiffness", stiffness, np.greater), ("damping", damping, np.greater_equal)):
        if np.shape(gains) != (agent.robot.num_joints,):
            raise UserError(
                f"{agent.name}'s {what} must be {agent.robot.num_joints} numbers, one for each joint of "
                f"{agent.robot.name}, not {np.shape(gains)}"
            )
        wrong = np.flatnonzero(~(np.isfinite(gains) & is_valid(gains, 0.0)))
        if len(wrong):
            joint, sign = agent.robot.joint_names[wrong[0]], "positive" if what == "stiffness" else "zero or more"
            raise UserError(f"{agent.name}'s {what} of {joint} must be {sign}, not {gains[wrong[0]]:g}")
