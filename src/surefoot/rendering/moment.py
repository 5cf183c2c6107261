"""Moment: the state of a robot at one instant, as far as a picture or the live page shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.physics.step_record import StepRecord


@dataclass(frozen=True, eq=False)
class Moment:
    """One instant of a robot, as much as a picture shows of it; world frame.

    Attributes:
        time: since the beginning of the push [s].
        qpos: in MuJoCo's order (nq,).
        com_position: (3,) [m].
        capture_point: (2,) [m].
        support_polygon: its corners, counter-clockwise (num_corners, 2) [m]; empty in the air.
        foot_force: normal force of the ground on the left and right foot (2,) [N].
        foot_pressure_point: where these forces act (2, 3) [m].
    """

    time: float
    qpos: np.ndarray
    com_position: np.ndarray
    capture_point: np.ndarray
    support_polygon: np.ndarray
    foot_force: np.ndarray
    foot_pressure_point: np.ndarray

    @classmethod
    def of(cls, ticks: StepRecord, robot: int = 0, tick: int = -1, time: float = 0.0) -> Moment:
        """One tick of one of the robots."""
        # A contact sensor's last three values are the pressure point.
        points = [ticks[f"{side}_foot_contact"][robot, tick, -3:] for side in ("left", "right")]
        root = [ticks[f"root_{part}"][robot, tick] for part in ("position", "orientation")]
        return cls(
            time=time,
            qpos=np.concatenate([*root, ticks.joint_position[robot, tick]]),
            com_position=ticks.com_position[robot, tick].copy(),
            capture_point=ticks.capture_point[robot, tick].copy(),
            support_polygon=ticks.support_polygon(robot, tick),
            foot_force=ticks.foot_force[robot, tick].copy(),
            foot_pressure_point=np.array(points),
        )

    @property
    def is_captured(self) -> bool:
        """Does the capture point lie inside the support polygon?"""
        corners = self.support_polygon
        if len(corners) < 3:
            return False
        edge, point = np.roll(corners, -1, axis=0) - corners, self.capture_point - corners
        return bool((edge[:, 0] * point[:, 1] >= edge[:, 1] * point[:, 0]).all())
