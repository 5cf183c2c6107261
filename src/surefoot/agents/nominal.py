"""The nominal pose held by the joint impedance alone."""

from __future__ import annotations

import hashlib

import numpy as np

from surefoot.agents.contract import Contract
from surefoot.robots import Robot, load_robot


class NominalAgent:
    """Holds the nominal pose by the joint impedance alone: the least that any policy has to beat."""

    def __init__(self, robot: Robot | None = None, pose: str = "bent", action_scale: float = 1.0):
        robot = robot or load_robot()
        self.name = f"nominal-{pose}"
        self.contract = Contract.of(robot, pose, action_scale)
        self.digest = hashlib.sha256(self.contract.to_json().encode()).hexdigest()

    def reset(self, ids: np.ndarray) -> None:
        """Nothing to forget."""

    def __call__(self, observations: np.ndarray, ids: np.ndarray) -> np.ndarray:
        return np.zeros((len(observations), len(self.contract.joints)))
