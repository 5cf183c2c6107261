"""History: the last seconds of the watched robot, for the curves of the live page."""

from __future__ import annotations

from collections import deque

import numpy as np

from surefoot.rates import POLICY_HZ
from surefoot.viewer.playback import Shown

SECONDS = 6.0
"""How far the curves look back."""
_FADING = 0.985
"""Share of a peak that is left after a policy step."""


class History:
    """One row per policy step of the watched robot.

    Rows are the CoM, the capture point and the support's edges, forward and to the left of the middle between the
    soles [cm], and roll and pitch of the root [deg].

    Attributes:
        peak_torque: largest share of each joint's torque limit, fading with time (num_joints,); empty before the first
            step.
    """

    COLUMNS = ("com_x", "cp_x", "front", "back", "com_y", "cp_y", "left", "right", "roll", "pitch")

    def __init__(self) -> None:
        self._rows: deque[list[float]] = deque(maxlen=round(SECONDS * POLICY_HZ))
        self.peak_torque = np.zeros(0)

    def clear(self) -> None:
        """Forget everything."""
        self._rows.clear()
        self.peak_torque = np.zeros(0)

    def add(self, shown: Shown, robot: int) -> None:
        """Remember the last tick of the last step that is shown, and the torques of all of it."""
        ticks = shown.ticks
        last = ticks[robot : robot + 1].ticks(slice(-1, None))
        center, forward = last.sole_position[0, 0, :, :2].mean(axis=0), last.heading[0, 0]

        def ahead(points: np.ndarray) -> np.ndarray:
            """Forward and to the left of the middle between the soles [cm]."""
            away = points - center
            turned = (away[..., 0] + 1j * away[..., 1]) * forward.conjugate()
            return 100.0 * np.stack([turned.real, turned.imag], axis=-1)

        polygon = last.support_polygon(0, 0)
        edge = ahead(polygon) if len(polygon) else np.full((1, 2), np.nan)
        (high_x, high_y), (low_x, low_y) = edge.max(axis=0), edge.min(axis=0)
        (com_x, com_y), (cp_x, cp_y) = ahead(last.com_position[0, 0, :2]), ahead(last.capture_point[0, 0])
        roll, pitch = np.degrees(last.root_attitude[:, 0, 0])
        self._rows.append([com_x, cp_x, high_x, low_x, com_y, cp_y, high_y, low_y, roll, pitch])
        torque = np.abs(ticks.joint_torque[robot]).max(axis=0) / ticks.robot.torque_limit
        fading = self.peak_torque * _FADING if len(self.peak_torque) else torque
        self.peak_torque = np.maximum(torque, fading)

    def columns(self, *names: str) -> tuple[np.ndarray, ...]:
        """Time before now [s], and the columns of these names."""
        rows = np.array(self._rows or [[np.nan] * len(self.COLUMNS)])
        time = np.arange(1 - len(rows), 1) / POLICY_HZ
        return (time, *(rows[:, self.COLUMNS.index(name)] for name in names))
