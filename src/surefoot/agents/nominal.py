"""Nominal: the agent that holds the nominal pose by the joint impedance alone."""

from __future__ import annotations

import hashlib

import numpy as np

from surefoot.agents.observing import ObservingAgent
from surefoot.robots import Robot
from surefoot.task.agent import Command
from surefoot.task.contract import Contract


class NominalAgent(ObservingAgent):
    """Holds a nominal pose by the joint impedance alone: the least that any policy has to beat.

    Args:
        robot: the robot that it holds up.
        pose: name of the pose; without it, the robot's default one.
    """

    def __init__(self, robot: Robot, pose: str = ""):
        pose = pose or robot.default_pose
        super().__init__(Contract.of(robot, pose, 1.0))
        self.robot = robot
        self.name = f"nominal-{pose}"
        self.digest = hashlib.sha256(self.contract.assumptions().encode()).hexdigest()

    def __call__(self, inputs: np.ndarray, ids: np.ndarray) -> Command:
        """Answer the pose for each of the robots `ids` (n,), whatever is observed."""
        return Command(np.tile(self.contract.nominal_pose, (len(ids), 1)))
