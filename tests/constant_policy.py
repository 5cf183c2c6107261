"""A policy file that is made in a moment: its network answers the same whatever it is given."""

from __future__ import annotations

import numpy as np

from surefoot.agents.policy_file import network_bytes
from surefoot.robots import Robot
from surefoot.task.contract import Contract


def constant(robot: Robot, action: float, scale: float = 0.8, past: int = 0, pose: str = "bent") -> bytes:
    """A policy that always does the same with every joint."""
    contract = Contract.of(robot, pose, scale, {"algorithm": "trpo"}, past)
    size = contract.num_inputs
    layers = [(np.zeros((robot.num_joints, size)), np.full(robot.num_joints, action))]
    return network_bytes(layers, np.zeros(size), np.ones(size), False, contract)
