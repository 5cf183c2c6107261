"""Bounds: the no-step bound, equation (6) of the paper, for a point mass over fixed feet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.evaluation.scenarios import DIRECTIONS
from surefoot.physics import balance
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.robots import Robot


def capture_point_bound(robot: Robot, pose: str | np.ndarray, angles: Sequence[float]) -> list[float]:
    """Return the no-step bound of this robot [Ns]: what its soles and its CoM allow without a step, per direction.

    Args:
        robot: robot whose mass, sole and CoM are used.
        angles: of the directions, counter-clockwise from forward [rad].
        pose: a named pose or joint angles (num_joints,) [rad].
    """
    joints = robot.pose(pose) if isinstance(pose, str) else pose
    # Above the floor no weight moves the joints: the pose is exact, and both soles are flat, so that all their corners
    # support.
    start = MujocoEngine(robot, 1).reset(np.array([0]), joints[None], height=1.0)
    polygon = start.flat_support_polygon()
    com = start.com_position[0, 0, :2]
    height = float(start.com_height[0, 0])
    return [
        balance.rejectable_impulse(
            robot.mass, height, balance.margin(polygon, com, np.array([np.cos(a), np.sin(a)])), robot.gravity
        )
        for a in angles
    ]


def main_bounds(robot: Robot) -> list[float]:
    """Return the no-step bound in the robot's default pose, forward, left, backward and right [Ns]."""
    return capture_point_bound(robot, robot.default_pose, list(DIRECTIONS.values()))


def worse_bounds(robot: Robot) -> tuple[float, float]:
    """Return the same of the worse sagittal and the worse lateral direction [Ns]."""
    forward, left, backward, right = main_bounds(robot)
    return min(forward, backward), min(left, right)
