"""Motors: the joint impedance with torque limit and torque-speed curve, for engines that have no such actuator."""

from __future__ import annotations

import numpy as np

from surefoot.robots import Robot
from surefoot.robots.model import STALL


class Motors:
    """The motors of a robot: u = stiffness (target - q) - damping dq/dt, as far as voltage and current allow.

    At rest a motor's voltage allows `STALL` times the torque limit, at the speed limit nothing, and linearly in between
    and beyond; its current allows the torque limit.

    Args:
        robot: robot with the motors.
        strength: of every joint's torque limit, as a share of the robot's own.

    Attributes:
        stiffness, damping: of the joint impedance (num_joints,) [Nm/rad, Nms/rad]; the caller may set them.
    """

    def __init__(self, robot: Robot, strength: float = 1.0):
        self.stiffness, self.damping = robot.stiffness, robot.damping
        self._limit = strength * robot.torque_limit
        self._stall = STALL * robot.torque_limit
        self._back = self._stall / robot.velocity_limit

    def __call__(self, target: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Torques (num_joints,) [Nm] at joint angles and velocities (num_joints,) [rad, rad/s]."""
        wanted = self.stiffness * (target - position) - self.damping * velocity
        back = self._back * velocity
        within_voltage = np.minimum(np.maximum(wanted, -self._stall - back), self._stall - back)
        return np.minimum(np.maximum(within_voltage, -self._limit), self._limit)
