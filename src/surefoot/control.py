"""Control loop: what stands between a policy at 25 Hz and the joints at 500 Hz, for a batch of robots.

Actions become joint targets along a cubic, pushes become wrenches, ticks become a filtered observation. The
environment and the evaluation differ only in what they make of the ticks.
"""

from __future__ import annotations

import numpy as np

from surefoot import observation
from surefoot.disturbance import Pushes
from surefoot.errors import UserError
from surefoot.robot import Robot
from surefoot.signals import LowPass, cubic_path
from surefoot.simulation import CONTROL_HZ, TICKS_PER_STEP, Simulation, Ticks


class ControlLoop:
    """Policy steps of `num_robots` robots.

    Args:
        nominal: joint angles that an action of zero means, (num_joints,) [rad].
        action_scale: joint angle [rad] per unit of action.

    Attributes:
        pushes: the robots' current pushes, to be scheduled by the caller.
        tick: ticks since each robot's reset, (num_robots,).
        nominal_com_height: height of the CoM above the soles in the nominal pose [m].
    """

    def __init__(self, robot: Robot, num_robots: int, nominal: np.ndarray, action_scale: float, num_threads: int = 0):
        self.robot = robot
        self.nominal = nominal
        self.action_scale = action_scale
        self.simulation = Simulation(robot, num_robots, num_threads)
        self.pushes = Pushes(robot, num_robots)
        self.tick = np.zeros(num_robots, np.int64)
        self._target = np.tile(nominal, (num_robots, 1))
        self._units = observation.units(robot)
        self._filter = LowPass(num_robots, len(self._units), TICKS_PER_STEP, CONTROL_HZ)
        start = self.reset(np.arange(num_robots), self._target)
        self.nominal_com_height = float(start.com_height[0, 0])

    @property
    def observation(self) -> np.ndarray:
        """The filtered observation at the end of each robot's last policy step: (num_robots, 47) float64."""
        return self._filter.output / self._units

    def reset(
        self,
        ids: np.ndarray,
        joint_position: np.ndarray,
        yaw: np.ndarray | float = 0.0,
        height: np.ndarray | float = 0.0,
    ) -> Ticks:
        """Put robots `ids` (n,) upright, at rest and without a push; see `Simulation.reset`."""
        start = self.simulation.reset(ids, joint_position, yaw, height)
        self._filter.reset(ids, np.concatenate(observation.quantities(start), axis=-1)[:, 0])
        self._target[ids] = self.nominal
        self.tick[ids] = 0
        self.pushes.cancel(ids)
        return start

    def step(self, actions: np.ndarray, ids: np.ndarray | None = None) -> Ticks:
        """One policy step of robots `ids` (all without it).

        Args:
            actions: (n, num_joints); clipped to [-1, 1], scaled, added to the nominal pose, clipped to the joint
                ranges, and reached along a cubic within the step.

        Returns:
            The step's ticks of these robots, in a buffer that the next step overwrites.

        Raises:
            UserError: the actions have the wrong shape.
        """
        everyone = ids is None  # then nothing is copied
        rows = slice(None) if ids is None else ids
        num_actions = (len(self.tick[rows]), self.robot.num_joints)
        if np.shape(actions) != num_actions:
            raise UserError(f"actions must have shape {num_actions}, not {np.shape(actions)}")
        goal = self.nominal + self.action_scale * np.clip(np.asarray(actions, np.float64), -1.0, 1.0)
        goal = np.clip(goal, self.robot.joint_lower, self.robot.joint_upper)
        path = cubic_path(self._target[rows], goal, TICKS_PER_STEP, self.simulation.joint_targets if everyone else None)
        self._target[rows] = goal
        self.pushes.write(self.simulation.wrench, self.tick)
        ticks = self.simulation.step(None if everyone else path, ids)
        self._filter(observation.quantities(ticks), rows)
        self.tick[rows] += TICKS_PER_STEP
        return ticks
