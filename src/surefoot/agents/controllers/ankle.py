"""Ankle: the capture point steers the pressure centre under feet that stay where they are."""

from __future__ import annotations

import numpy as np

from surefoot.agents.controllers.controller import Command, State
from surefoot.agents.controllers.inverse_dynamics import InverseDynamics, Motion, clip_to_support
from surefoot.robots import Robot

GAIN = 3.0
"""Rate at which the capture point comes back while the pressure centre is inside the soles [1/s]."""
EDGE = 0.008
"""Distance of the pressure centre from the soles' borders, at least [m]: on the border itself a foot would tip."""

FLIGHT_S = 0.02
"""A robot that has touched nothing for longer than this is in the air [s]."""


class Ankle:
    """p = c + (1 + k / w)(x + v / w - c): pressure centre p ahead of the capture point, c between the feet.

    Linear inverted pendulum with the capture point as its feedback: A. L. Hof 2008, The "extrapolated center of mass"
    concept suggests a simple control of balance in walking (Human Movement Science); J. Englsberger et al. 2011,
    Bipedal walking control based on capture point dynamics (IROS). This is the experiment behind equation (6) of Yang
    et al. 2018. Root and torso are kept upright and no angular momentum is made on purpose; feed-forward torques.
    """

    rate_hz = 250

    def __init__(self, robot: Robot, num_robots: int):
        self.robot = robot
        self.dynamics = InverseDynamics(robot, num_robots)
        self.pose = robot.pose()
        self.height = np.full(num_robots, np.nan)
        self.touched = np.zeros(num_robots)
        """When a foot last touched the ground [s]."""

    def reset(self, ids: np.ndarray) -> None:
        """Forget robots `ids` (n,): the height to keep is that of the start."""
        self.height[ids] = np.nan
        self.touched[ids] = -np.inf

    def __call__(self, state: State, ids: np.ndarray) -> Command:
        """Turn the motion that the law asks for into joint torques."""
        self.dynamics.body.update(state)
        self.height[ids] = np.where(np.isnan(self.height[ids]), state.com_height, self.height[ids])
        target, torque = self.dynamics(state, self.motion(state, ids))
        touching = (state.foot_force > 1.0).any(axis=1)
        self.touched[ids] = np.where(touching, state.time, self.touched[ids])
        flying = (state.time - self.touched[ids] > FLIGHT_S)[:, None]
        # Nothing to push against: the joint impedance holds the pose for the landing.
        target = np.where(flying, self.pose, target)
        return Command(target, np.where(flying, 0.0, torque))

    def motion(self, state: State, ids: np.ndarray) -> Motion:
        """The motion that n robots are to make."""
        motion = Motion.standing(self.pressure(state, ids), 0.0)
        motion.height = self.height[ids]
        return motion

    def pressure(self, state: State, ids: np.ndarray) -> np.ndarray:
        """Pressure centre (n, 2) [m], inside the support."""
        swing = np.sqrt(self.robot.gravity / np.maximum(state.com_height, 0.1))[:, None]
        soles = state.sole_position[..., :2]
        center = soles.mean(axis=1)
        wanted = center + (1.0 + GAIN / swing) * (state.capture_point - center)
        return clip_to_support(wanted, soles, np.ones((len(state), 2), bool), self.robot.sole_half_size - EDGE)
