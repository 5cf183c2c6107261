"""Bounds: what equation (6) of the paper, a point mass over fixed feet, lets a robot reject without a step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.evaluation.scenarios import DIRECTIONS
from surefoot.physics import balance
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.robots import Robot


def capture_point_bound(robot: Robot, pose: str | np.ndarray, angles: Sequence[float]) -> list[float]:
    """Equation (6) on this robot [Ns]: what its sole and CoM allow without a step, per direction [rad].

    Args:
        robot: whose mass, sole and CoM count.
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


def worse_bounds(robot: Robot) -> tuple[float, float]:
    """Equation (6) in the paper's straight pose: the worse sagittal and the worse lateral direction [Ns]."""
    forward, left, backward, right = capture_point_bound(robot, "straight", list(DIRECTIONS.values()))
    return min(forward, backward), min(left, right)
