"""A controller of your own: capture-point feedback by the ankles, over the pose that the joints hold.

surefoot evaluate examples/capture_point.py:CapturePoint
"""

import numpy as np

from surefoot.agents.controllers import Command, State

GAIN = 2.0  # pressure centre ahead of the capture point


class CapturePoint:
    rate_hz = 250

    def __init__(self, robot, num_robots):
        self.weight = robot.weight
        self.half = robot.sole_half_size
        self.pose = robot.pose()
        self.pitch = [robot.joint_names.index(f"{side}_ankle_pitch") for side in ("left", "right")]

    def reset(self, ids: np.ndarray) -> None:
        """Nothing to forget: everything follows from the present state."""

    def __call__(self, state: State, ids: np.ndarray) -> Command:
        center = state.sole_position[:, :, 0].mean(axis=1)
        ahead = np.clip(GAIN * (state.capture_point[:, 0] - center), -self.half[0], self.half[0])
        torque = np.zeros((len(ids), len(self.pose)))
        # Each foot bears half of the weight; toes down moves its pressure centre forward.
        torque[:, self.pitch] = 0.5 * self.weight * ahead[:, None]
        return Command(np.tile(self.pose, (len(ids), 1)), torque)
