"""Stepping: stand while the capture point is over the feet, else swing a foot to where a planner puts it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from surefoot.agents.controllers.ankle import EDGE, GAIN, Ankle
from surefoot.agents.controllers.body import Legs
from surefoot.agents.controllers.controller import State
from surefoot.agents.controllers.inverse_dynamics import Motion, clip_to_support
from surefoot.robots import Robot

INSET = 0.02
"""Distance of the pressure centre from the sole's border while the robot stands on one foot, at least [m]."""
RESTORE = 0.6
"""Distance by which the pressure centre goes inward under a foot that has tipped, per angle [m/rad]."""
COMMITTED_S = 0.10
"""The time of landing is fixed from so many seconds before it on [s]."""
OUTSIDE = 0.01
"""A step begins when the capture point is farther than this outside the soles [m]."""
CLEARANCE = 0.06
"""Height to which a foot swings [m]."""
SWING_SPEED = 3.0
"""A foot is moved no faster than this, on average [m/s]."""
BEYOND = 0.04
"""Distance of a foothold beyond the capture point [m], because landing takes time."""
BESIDE = 0.26
"""Distance beside the other foot at which a step in place lands [m]."""
FORWARD, APART = (-0.65, 0.70), (0.21, 0.75)
"""Where a foot may land from the other one: forward, and outward to its own side [m]."""
LANDING_FORCE = 40.0
"""A swinging foot that carries more than this has landed [N]."""
LOWER = 0.03
"""Distance by which the CoM is lowered for steps [m]."""
SHORTEST_S = 0.06
"""The swing law aims at the landing in no less than this: its gains are bounded by it [s]."""
BEARING_FORCE, HANGING = 5.0, 0.005
"""While the robot stands, a foot with less force than this that is higher than this above the other hangs [N, m]."""
NEAR_FORWARD, NEAR_APART = (-0.40, 0.40), (0.22, 0.45)
"""Where a hanging foot is put down from the other one: forward, and outward to its own side [m]."""
AHEAD_S, SMOOTHING = 0.06, 0.3
"""Time over which the capture point is extrapolated sideways [s], and share of its newest speed in the filtered one."""
QUIET_S = 0.5
"""It is not extrapolated within this time after a landing, when its speed is that of the landing itself [s]."""
NONE = -1
_OUTWARD = np.array([1.0, -1.0])


@dataclass
class Situation:
    """What a planner has to decide about, for n robots that step; horizontal positions in the heading frame [m].

    Attributes:
        ids: of the robots (n,).
        frequency: of the linear inverted pendulum, sqrt(g / z) (n,) [1/s].
        capture_point, com, com_velocity: (n, 2).
        stance, swing: centres of the sole that bears and of the one that swings (n, 2).
        side: +1 where the left foot swings, -1 where the right one does (n,).
        clock: since the foot left the ground (n,) [s].
        committed: time until it lands, if that is not to be changed any more, else NaN (n,) [s].
    """

    ids: np.ndarray
    frequency: np.ndarray
    capture_point: np.ndarray
    com: np.ndarray
    com_velocity: np.ndarray
    stance: np.ndarray
    swing: np.ndarray
    side: np.ndarray
    clock: np.ndarray
    committed: np.ndarray


@dataclass
class Plan:
    """A planner's decision.

    Attributes:
        landing: where the swinging foot's centre lands (n, 2) [m].
        remaining: time until then (n,) [s].
        pressure: pressure centre until then (n, 2) [m].
        cost: by which the better foot is chosen (n,).
    """

    landing: np.ndarray
    remaining: np.ndarray
    pressure: np.ndarray
    cost: np.ndarray


class Stepping(Ankle, ABC):
    """Stands by capture-point feedback, and steps as `plan` says; every control step plans anew."""

    def __init__(self, robot: Robot, num_robots: int):
        super().__init__(robot, num_robots)
        self.legs = Legs.of(robot)
        self.swinging = np.full(num_robots, NONE)
        """The foot in the air: 0 left, 1 right, or `NONE`."""
        self.since = np.zeros(num_robots)
        """When it was lifted, and when it shall land [s]."""
        self.until = np.zeros(num_robots)
        self.before = np.zeros((num_robots, 2))
        """The capture point from the left sole, and its filtered speed [m, m/s]."""
        self.speed = np.zeros((num_robots, 2))

    def reset(self, ids: np.ndarray) -> None:
        """Stand on both feet; the height to keep is that of the start."""
        super().reset(ids)
        self.swinging[ids] = NONE
        self.before[ids], self.speed[ids] = np.nan, 0.0
        self.until[ids] = -np.inf

    @abstractmethod
    def plan(self, situation: Situation) -> Plan:
        """Where and when the swinging foot lands."""

    def motion(self, state: State, ids: np.ndarray) -> Motion:
        """The motion of robots that stand, and of those that step as `plan` says."""
        self._land(state, ids)
        motion = self._stand(state, ids)
        self._start(state, ids)
        stepping = np.flatnonzero(self.swinging[ids] != NONE)
        if len(stepping):
            foot = self.swinging[ids[stepping]]
            plan = self.plan(self._situation(state, ids, stepping, foot))
            self.until[ids[stepping]] = state.time[stepping] + plan.remaining
            self._swing(motion, state, stepping, foot, plan, state.time[stepping] - self.since[ids[stepping]])
        self._limit_height(motion, state)
        return motion

    def _stand(self, state: State, ids: np.ndarray) -> Motion:
        frequency = self._frequency(state)[:, None]
        center = state.sole_position[..., :2].mean(axis=1)
        motion = Motion.standing(center + (1.0 + GAIN / frequency) * (state.capture_point - center), 0.0)
        motion.height = self.height[ids].copy()
        self._lower(motion, state)
        half = self.robot.sole_half_size - np.where(motion.bears.all(axis=1, keepdims=True), EDGE, INSET)
        motion.pressure = clip_to_support(motion.pressure, state.sole_position[..., :2], motion.bears, half)
        return motion

    def _lower(self, motion: Motion, state: State) -> None:
        """A foot that hangs in the air while the robot stands is put down where it is, or where the leg reaches."""
        body = self.dynamics.body
        above = state.sole_position[..., 2] - state.sole_position[..., 2].min(axis=1, keepdims=True)
        hanging = (state.foot_force < BEARING_FORCE) & (above > HANGING)
        motion.bears &= ~hanging
        speed = np.matmul(body.sole_jacobian, body.velocity[:, None, :, None])[..., 0]
        goal = state.sole_position[:, ::-1].copy()
        apart = state.sole_position - goal
        goal[..., 0] += np.clip(apart[..., 0], *NEAR_FORWARD)
        goal[..., 1] += _OUTWARD * np.clip(_OUTWARD * apart[..., 1], *NEAR_APART)
        goal[..., 2] = state.sole_position[..., 2] - above - 0.01
        motion.swing[..., :3] = 100.0 * (goal - state.sole_position) - 20.0 * speed[..., :3]
        motion.swing[..., 3:5] = -400.0 * state.foot_attitude - 40.0 * speed[..., 3:5]

    def _land(self, state: State, ids: np.ndarray) -> None:
        foot = self.swinging[ids]
        clock = state.time - self.since[ids]
        rows = np.arange(len(ids))
        touching = (state.foot_force[rows, np.maximum(foot, 0)] > LANDING_FORCE) & (clock > 0.12)
        self.swinging[ids[(foot != NONE) & touching]] = NONE

    def _start(self, state: State, ids: np.ndarray) -> None:
        """Begin a step where the capture point has left the soles, with the foot that promises more."""
        point = self._expected(state, ids)
        outside = np.linalg.norm(point - self._supported(point, state), axis=1) > OUTSIDE
        rows = np.flatnonzero(outside & (self.swinging[ids] == NONE))
        if not len(rows):
            return
        self.since[ids[rows]] = state.time[rows]
        self.until[ids[rows]] = np.inf
        plans = [self.plan(self._situation(state, ids, rows, np.full(len(rows), foot))) for foot in (0, 1)]
        self.swinging[ids[rows]] = np.where(plans[0].cost <= plans[1].cost, 0, 1)

    def _expected(self, state: State, ids: np.ndarray) -> np.ndarray:
        """Capture point (n, 2) [m] in `AHEAD_S`, if it goes on as in the last control steps."""
        place = state.capture_point - state.sole_position[:, 0, :2]
        speed = (place - self.before[ids]) * self.rate_hz
        speed = np.where(np.isnan(speed), 0.0, speed)
        self.speed[ids] += SMOOTHING * (speed - self.speed[ids])
        self.before[ids] = place
        quiet = state.time - self.until[ids] > QUIET_S
        ahead = np.column_stack([np.zeros(len(ids)), np.where(quiet, AHEAD_S, 0.0)])
        return state.capture_point + ahead * self.speed[ids]

    def _situation(self, state: State, ids: np.ndarray, rows: np.ndarray, foot: np.ndarray) -> Situation:
        soles = state.sole_position[rows, :, :2]
        each = np.arange(len(rows))
        left = self.until[ids[rows]] - state.time[rows]
        return Situation(
            ids=ids[rows],
            frequency=self._frequency(state)[rows],
            capture_point=state.capture_point[rows],
            com=state.com_position[rows, :2],
            com_velocity=state.com_velocity[rows, :2],
            stance=soles[each, 1 - foot],
            swing=soles[each, foot],
            side=1.0 - 2.0 * foot,
            clock=state.time[rows] - self.since[ids[rows]],
            committed=np.where(left < COMMITTED_S, left, np.nan),
        )

    def _swing(
        self, motion: Motion, state: State, rows: np.ndarray, foot: np.ndarray, plan: Plan, clock: np.ndarray
    ) -> None:
        """Write the swinging foot's acceleration, and the pressure centre under the other foot."""
        body = self.dynamics.body
        motion.bears[rows, foot] = False
        half = self.robot.sole_half_size - INSET
        stance = state.sole_position[rows, 1 - foot]
        tipped = state.foot_attitude[rows, 1 - foot]
        inward = RESTORE * np.column_stack([-tipped[:, 1], tipped[:, 0]])
        motion.pressure[rows] = stance[:, :2] + np.clip(plan.pressure - stance[:, :2] + inward, -half, half)
        motion.height[rows] -= LOWER
        place = body.soles[rows, foot]
        speed = np.matmul(body.sole_jacobian[rows, foot], body.velocity[rows, :, None])[..., 0]
        ground = stance[:, 2] - (np.abs(tipped[:, ::-1]) * self.robot.sole_half_size).sum(axis=1)
        # Up for the first half of the swing, down in the second; what is late goes on down.
        rising = clock < plan.remaining
        goal = np.column_stack(
            [plan.landing, ground + np.where(rising, CLEARANCE, np.where(plan.remaining > 0, 0.0, -0.03))]
        )
        up = np.where(rising, 0.5 * (plan.remaining - clock), plan.remaining)
        left = np.maximum(np.column_stack([plan.remaining, plan.remaining, up]), SHORTEST_S)
        # The acceleration with which a cubic to the goal, at rest there, begins.
        motion.swing[rows, foot, :3] = 6.0 * (goal - place) / left**2 - 4.0 * speed[:, :3] / left
        motion.swing[rows, foot, 3:5] = -400.0 * state.foot_attitude[rows, foot] - 40.0 * speed[:, 3:5]

    def _limit_height(self, motion: Motion, state: State) -> None:
        """The CoM comes no higher than the legs that bear reach."""
        hips = np.matmul(self.dynamics.body.rotation[:, None], self.legs.hips[..., None])[..., 0]
        ankles = state.sole_position + self.legs.ankles
        apart = ((hips - ankles)[..., :2] ** 2).sum(axis=-1)
        reach = np.sqrt(np.maximum(self.legs.reach**2 - apart, 0.3**2))
        above_hip = state.com_position[:, 2:] - hips[..., 2]
        highest = np.where(motion.bears, self.legs.ankles[:, 2] + reach + above_hip, np.inf).min(axis=1)
        motion.height = np.minimum(motion.height, highest)

    def _frequency(self, state: State) -> np.ndarray:
        return np.sqrt(self.robot.gravity / np.maximum(state.com_height, 0.1))

    def _supported(self, pressure: np.ndarray, state: State) -> np.ndarray:
        both = np.ones((len(state), 2), bool)
        return clip_to_support(pressure, state.sole_position[..., :2], both, self.robot.sole_half_size - EDGE)
