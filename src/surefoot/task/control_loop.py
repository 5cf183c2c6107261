"""Control loop: what stands between a policy at 25 Hz and the joints at 500 Hz, for a batch of robots.

Actions become joint targets along a cubic, pushes become wrenches, ticks become a filtered observation. The
environment and the evaluation differ only in what they make of the ticks.
"""

from __future__ import annotations

import numpy as np

from surefoot.errors import UserError
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.pushes import Pushes
from surefoot.physics.signals import Delay, LowPass, Noise, cubic_path
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_HZ, TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.task import observation
from surefoot.task.imperfections import PERFECT, Imperfections

NUM_PUSHES = 2
"""How many pushes a robot may await or feel at the same time."""


class ControlLoop:
    """Policy steps of `num_robots` robots.

    Args:
        nominal: joint angles that an action of zero means, (num_joints,) [rad].
        action_scale: joint angle [rad] per unit of action.
        domain: what the robots stand on and are made of.

    Attributes:
        pushes: what pushes the robots, `NUM_PUSHES` slots each; the caller schedules them.
        tick: ticks since each robot's reset, (num_robots,).
        imperfect: which robots have imperfections, bool (num_robots,).
        nominal_com_height: height of the CoM above the soles in the nominal pose [m].
    """

    def __init__(
        self,
        robot: Robot,
        num_robots: int,
        nominal: np.ndarray,
        action_scale: float,
        num_threads: int = 0,
        domain: DomainParameters = NOMINAL_DOMAIN,
    ):
        self.robot = robot
        self.nominal = nominal
        self.action_scale = action_scale
        self.engine = MujocoEngine(robot, num_robots, num_threads, domain)
        self.pushes = Pushes(robot, num_robots, NUM_PUSHES)
        self._pushed = np.zeros(0, np.int64)
        self.tick = np.zeros(num_robots, np.int64)
        self._target = np.tile(nominal, (num_robots, 1))
        self._scales = observation.scales(robot)
        self._filter = LowPass(num_robots, len(self._scales), TICKS_PER_STEP, CONTROL_HZ)
        self._errors = LowPass(num_robots, len(self._scales), TICKS_PER_STEP, CONTROL_HZ)
        self._observation_noise = Noise(num_robots)
        self._action_noise = Noise(num_robots)
        self._bias = np.zeros((num_robots, len(self._scales)))
        self._delay = Delay(num_robots, TICKS_PER_STEP, robot.num_joints)
        self.imperfect = np.zeros(num_robots, bool)
        start = self.reset(np.arange(num_robots), self._target)
        self.nominal_com_height = float(start.com_height[0, 0])

    @property
    def observation(self) -> np.ndarray:
        """The filtered observation at the end of each robot's last policy step: (num_robots, 47) float64."""
        return self.observe(slice(None))

    def observe(self, rows: np.ndarray | slice) -> np.ndarray:
        """The same of some robots only."""
        vector = observation.from_blocks(self._filter.output[rows], self.robot)
        return vector + self._errors.output[rows] if self.imperfect.any() else vector

    def reset(self, ids: np.ndarray, joint_position: np.ndarray, **stance: np.ndarray | float) -> StepRecord:
        """Put perfect robots `ids` (n,) at rest and without a push; `stance` as for `MujocoEngine.reset`."""
        start = self.engine.reset(ids, joint_position, **stance)
        self._filter.reset(ids, np.concatenate(observation.blocks(start), axis=-1)[:, 0])
        self._target[ids] = self.nominal
        self.tick[ids] = 0
        self.pushes.cancel(ids)
        if self.imperfect.any():
            self._errors.reset(ids, np.zeros((len(ids), len(self._scales))))
            self.imperfect[ids] = False
        return start

    def spoil(self, robot: int, imperfections: Imperfections, seed: int) -> None:
        """Give one robot imperfections, right after its reset; `seed` draws its noise and its bias."""
        bias, observation_noise, action_noise = np.random.default_rng(seed).spawn(3)
        self._bias[robot] = imperfections.sensor_bias * self._scales * bias.standard_normal(len(self._scales))
        self._observation_noise.reset(robot, imperfections.observation_noise, observation_noise)
        self._action_noise.reset(robot, imperfections.action_noise, action_noise)
        self._delay.reset(robot, round(imperfections.latency * CONTROL_HZ), self._target[robot])
        self.imperfect[robot] = imperfections != PERFECT
        self._errors.reset(np.array([robot]), self._bias[None, robot])

    def step(self, actions: np.ndarray, ids: np.ndarray | None = None) -> StepRecord:
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
        imperfect = self._imperfect_rows(rows)
        if imperfect is not None:
            goal[imperfect] = self._action_noise.add(self._ids(rows, imperfect), goal[imperfect])
        goal = np.clip(goal, self.robot.joint_lower, self.robot.joint_upper)
        targets = self.engine.joint_targets
        path = cubic_path(self._target[rows], goal, TICKS_PER_STEP, targets if everyone else None)
        if imperfect is not None:
            path[imperfect] = self._delay(self._ids(rows, imperfect), path[imperfect])
        if not everyone:
            targets[rows] = path
        self._target[rows] = goal
        self._write_pushes()
        ticks = self.engine.step(ids)
        self._filter(observation.blocks(ticks), rows)
        if imperfect is not None:
            self._filter_errors(self._ids(rows, imperfect))
        self.tick[rows] += TICKS_PER_STEP
        return ticks

    def _write_pushes(self) -> None:
        self.engine.wrench[self._pushed] = 0.0
        self._pushed = self.pushes.write(self.engine.wrench, self.tick)

    def _filter_errors(self, ids: np.ndarray) -> None:
        """What is wrong with the observations passes a filter of its own: the filter is linear, and so no robot's
        numbers depend on whether another one has errors."""
        bias = np.repeat(self._bias[ids, None], TICKS_PER_STEP, axis=1)
        self._errors([self._observation_noise.add(ids, bias)], ids)

    def _imperfect_rows(self, rows: np.ndarray | slice) -> np.ndarray | None:
        found = np.flatnonzero(self.imperfect[rows])
        return found if len(found) else None

    def _ids(self, rows: np.ndarray | slice, some: np.ndarray) -> np.ndarray:
        return some if isinstance(rows, slice) else rows[some]
