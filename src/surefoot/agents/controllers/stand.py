"""Stand: the nominal pose held by the joint impedance alone; what every other controller has to beat."""

from __future__ import annotations

import numpy as np

from surefoot.agents.controllers.controller import Command, State
from surefoot.robots import Robot


class Stand:
    """Joint targets that never change; no feed-forward torque, nothing measured."""

    rate_hz = 25

    def __init__(self, robot: Robot, num_robots: int):
        self._pose = robot.pose()

    def reset(self, ids: np.ndarray) -> None:
        """Forget robots `ids` (n,): nothing is remembered."""

    def __call__(self, state: State, ids: np.ndarray) -> Command:
        """Answer the robot's default pose for each of the robots `ids` (n,)."""
        return Command(np.tile(self._pose, (len(ids), 1)))
