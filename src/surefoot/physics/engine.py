"""Engine: the protocol by which the rest of the package uses a physics engine."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from surefoot.physics.step_record import StepRecord
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot

WHOLE_STEP = slice(0, TICKS_PER_STEP)
"""All ticks of a policy step."""


class Engine(Protocol):
    """N copies of a robot, advanced by ticks of 2 ms under joint targets and wrenches.

    Attributes:
        name: of the engine and its version, as results name it: "mujoco 4.0.0".
        robot: what is simulated.
        num_robots: how many of it.
        joint_targets: (num_robots, TICKS_PER_STEP, num_joints) [rad], of the next policy step; the caller writes them.
        wrench: (num_robots, TICKS_PER_STEP, num_bodies, 6) [N, Nm], forces and torques of the next policy step on every
            body of `Robot.body_names`, world frame, at the body's CoM; the caller writes and clears them.
        diverged: bool (num_robots,), who became non-finite since the last policy step began, and was put back to its
            default state.
        num_diverged: how often that has happened.
    """

    name: str
    robot: Robot
    num_robots: int
    joint_targets: np.ndarray
    wrench: np.ndarray
    diverged: np.ndarray
    num_diverged: int

    def reset(
        self,
        ids: np.ndarray,
        joint_position: np.ndarray,
        yaw: np.ndarray | float = 0.0,
        height: np.ndarray | float = 0.0,
        roll: np.ndarray | float = 0.0,
        pitch: np.ndarray | float = 0.0,
    ) -> StepRecord:
        """Put robots `ids` (n,) at rest, their motors holding `joint_position`.

        A robot on the floor stands: its weight is on its feet and has moved its joints as far as their stiffness lets
        it. A robot above the floor is as it was placed, and its motors exert no torque.

        Args:
            ids: (n,).
            joint_position: (n, num_joints) [rad].
            yaw: heading [rad], scalar or (n,).
            height: of the lowest corner of the soles above the floor [m], scalar or (n,); 0 for on the floor.
            roll: of the root [rad], scalar or (n,).
            pitch: of the root [rad], scalar or (n,).

        Returns:
            One tick of each: the state from which they start.
        """
        ...

    def rest_states(self, ids: np.ndarray) -> np.ndarray:
        """Return what `restart` needs (n, size) to put robots where `ids` (n,) have just been put by `reset`."""
        ...

    def restart(self, ids: np.ndarray, states: np.ndarray) -> StepRecord:
        """Put robots `ids` (n,) into states (n, size) of `rest_states`, without the time that standing up takes.

        Returns:
            One tick of each: the state from which they start.
        """
        ...

    def read(self, ids: np.ndarray) -> StepRecord:
        """One tick (n, 1, ...) of robots `ids` (n,): their state at the last reset or the last tick."""
        ...

    def step(self, ids: np.ndarray | None = None, ticks: slice = WHOLE_STEP) -> StepRecord:
        """Advance robots `ids` (n,), all without it, by some ticks of a policy step.

        Returns:
            The record of these ticks, each at its start; a whole step's lies in a buffer that the next one overwrites.
        """
        ...

    def set_friction(self, friction: float) -> None:
        """Set the sliding friction coefficient of all robots' feet and floor."""
        ...

    def set_gains(self, stiffness: np.ndarray, damping: np.ndarray) -> None:
        """Drive all robots' joints by this impedance (num_joints,) [Nm/rad, Nms/rad]; the motors' limits stay."""
        ...
