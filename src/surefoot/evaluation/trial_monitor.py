"""TrialMonitor: what is seen of every robot in a trial, and the one definition of success."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from surefoot.evaluation.outcome import Outcome, _group_columns
from surefoot.evaluation.strategies import StrategyWatch
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, CONTROL_HZ, POLICY_HZ, TICKS_PER_STEP
from surefoot.robots import Robot

HORIZON_S = 10.0


"""Time after the beginning of the disturbance at which a trial is judged."""


JUDGED_S = 1.0


"""The last part of it, in which the robot must stand."""


MAX_COM_SPEED = 0.15


"""Largest mean CoM speed in that part [m/s]."""


MAX_TILT_DEG = 20.0


"""Largest angle of root and torso from upright in that part."""


QUIET_S = 2.0


"""A trial that is not `whole` has recovered once it has been upright and slow, as at the end of one, for so long."""


CALM_FROM_S = 5.0


"""From so long after the beginning of the disturbance on, it is seen how calmly the robot stands."""


SATURATED = 0.999


"""A joint is in saturation above this share of its torque limit."""


_COS_TILT = np.cos(np.radians(MAX_TILT_DEG))


_QUIET_STEPS = round(QUIET_S * POLICY_HZ)


class TrialMonitor:
    """Watches `num_robots` robots and says what became of their trials. Times are ticks since a robot's reset.

    Args:
        motor_strength: of the robots' world, which makes their torque limits.
    """

    def __init__(self, robot: Robot, num_robots: int, motor_strength: float = 1.0):
        self.robot = robot
        self._torque_limit = motor_strength * robot.torque_limit
        self.start = np.zeros(num_robots, np.int64)
        self.end = np.zeros(num_robots, np.int64)
        self._push_end = np.zeros(num_robots, np.int64)
        self._calm = np.zeros(num_robots, np.int64)
        self._whole = np.zeros(num_robots, bool)
        self._strategies = StrategyWatch(robot, num_robots)
        self._speed_sum = np.zeros(num_robots)
        self._tilted = np.zeros(num_robots, bool)
        self._least_upright = np.ones(num_robots)
        self._recent_speed = np.zeros((num_robots, _QUIET_STEPS))
        self._upright_steps = np.zeros(num_robots, np.int64)
        self._foot_place = np.zeros((num_robots, 2, 2))
        self._foot_shift = np.zeros(num_robots)
        self._calm_place = np.zeros((num_robots, 2))
        self._calm_drift = np.zeros(num_robots)
        self._calm_work = np.zeros(num_robots)
        self._torque_peak = np.zeros((num_robots, robot.num_joints))
        self._speed_peak = np.zeros((num_robots, robot.num_joints))
        self._saturated = np.zeros((num_robots, robot.num_joints), np.int64)
        self._groups = _group_columns(robot)

    def reset(
        self,
        ids: np.ndarray,
        ticks: StepRecord,
        start: np.ndarray,
        push_end: np.ndarray,
        horizon: np.ndarray,
        calm_from: np.ndarray,
        whole: np.ndarray,
    ) -> None:
        """Robots `ids` (n,) begin a trial.

        Args:
            ticks: one of each, their state at the reset.
            start, push_end: ticks at which the disturbance begins and its last push ends (n,).
            horizon, calm_from: from the beginning of the disturbance [s] (n,).
            whole: bool (n,), may the trial not end before its horizon?
        """
        self._strategies.reset(ids, ticks)
        self.start[ids], self._push_end[ids], self._whole[ids] = start, push_end, whole
        self.end[ids] = start + np.rint(np.asarray(horizon) * CONTROL_HZ).astype(np.int64)
        self._calm[ids] = start + np.rint(np.asarray(calm_from) * CONTROL_HZ).astype(np.int64)
        self._foot_place[ids] = ticks.sole_position[:, 0, :, :2]
        self._calm_place[ids] = ticks.com_position[:, 0, :2]
        self._least_upright[ids] = 1.0
        for seen in (
            self._speed_sum, self._tilted, self._upright_steps, self._foot_shift, self._calm_drift, self._calm_work,
            self._torque_peak, self._speed_peak, self._saturated,
        ):  # fmt: skip
            seen[ids] = 0

    def update(
        self,
        ids: np.ndarray,
        ticks: StepRecord,
        now: np.ndarray,
        diverged: np.ndarray,
        failed: Mapping[int, str] | None = None,
    ) -> dict[int, Outcome]:
        """Take in a policy step of robots `ids` (n,).

        Args:
            ticks: (n, TICKS_PER_STEP, ...).
            now: ticks since each robot's reset at the end of the step (n,).
            diverged: bool (n,).
            failed: robots whose controller has failed, and why.

        Returns:
            The outcomes of the trials that have just ended, by robot.
        """
        tick = now[:, None] - TICKS_PER_STEP + np.arange(TICKS_PER_STEP)
        self._strategies.update(ids, ticks, tick >= self.start[ids, None])
        self._watch_balance(ids, ticks, tick)
        self._watch_feet(ids, ticks, tick)
        self._watch_calm(ids, ticks, tick)
        self._watch_joints(ids, ticks)
        fell = np.asarray((ticks.non_foot_contact & (tick < self.end[ids, None])).any(axis=1))
        quiet: np.ndarray = ~self._whole[ids] & self._is_quiet(ids)
        over = np.asarray(now >= self.end[ids])
        failed = failed or {}
        helpless = np.isin(ids, list(failed))
        ended = np.flatnonzero(fell | diverged | quiet | over | helpless)
        return {
            robot: self._verdict(robot, failed.get(robot, ""), fell[i], diverged[i], over[i], int(now[i]))
            for i, robot in zip(ended, ids[ended].tolist(), strict=True)
        }

    def _watch_balance(self, ids: np.ndarray, ticks: StepRecord, tick: np.ndarray) -> None:
        speed = np.linalg.norm(ticks.com_velocity, axis=-1)
        root, end = ticks.root_uprightness, self.end[ids, None]
        upright = (root > _COS_TILT) & (ticks.torso_uprightness > _COS_TILT)
        judged = (tick >= end - round(JUDGED_S * CONTROL_HZ)) & (tick < end)
        self._speed_sum[ids] += (speed * judged).sum(axis=1)
        self._tilted[ids] |= (~upright & judged).any(axis=1)
        least = np.where(tick >= self.start[ids, None], root, 1.0).min(axis=1)
        self._least_upright[ids] = np.minimum(self._least_upright[ids], least)
        over = tick[:, 0] >= self._push_end[ids]
        self._upright_steps[ids] = np.where(over & upright.all(axis=1), self._upright_steps[ids] + 1, 0)
        self._recent_speed[ids, tick[:, 0] // TICKS_PER_STEP % _QUIET_STEPS] = speed.mean(axis=1)

    def _watch_feet(self, ids: np.ndarray, ticks: StepRecord, tick: np.ndarray) -> None:
        before = tick[:, -1] < self.start[ids]
        soles = ticks.sole_position[..., :2]
        self._foot_place[ids] = np.where(before[:, None, None], soles[:, -1], self._foot_place[ids])
        shift = np.linalg.norm(soles - self._foot_place[ids, None], axis=-1).max(axis=(1, 2))
        self._foot_shift[ids] = np.where(before, 0.0, np.maximum(self._foot_shift[ids], shift))

    def _watch_calm(self, ids: np.ndarray, ticks: StepRecord, tick: np.ndarray) -> None:
        place = ticks.com_position[:, -1, :2]
        begun = tick[:, 0] >= self._calm[ids]
        self._calm_place[ids] = np.where(begun[:, None], self._calm_place[ids], place)
        drift = np.where(begun, np.linalg.norm(place - self._calm_place[ids], axis=-1), 0.0)
        self._calm_drift[ids] = np.maximum(self._calm_drift[ids], drift)
        self._calm_work[ids] += np.where(begun, ticks.joint_power.sum(axis=(1, 2)), 0.0)

    def _watch_joints(self, ids: np.ndarray, ticks: StepRecord) -> None:
        torque = np.abs(ticks.joint_torque)
        self._torque_peak[ids] = np.maximum(self._torque_peak[ids], torque.max(axis=1))
        self._speed_peak[ids] = np.maximum(self._speed_peak[ids], np.abs(ticks.joint_velocity).max(axis=1))
        self._saturated[ids] += (torque >= SATURATED * self._torque_limit).sum(axis=1)

    def _is_quiet(self, ids: np.ndarray) -> np.ndarray:
        """Since the push's end, upright for `QUIET_S`, and over that time as slow on average as a recovered robot."""
        return (self._upright_steps[ids] >= _QUIET_STEPS) & (self._recent_speed[ids].mean(axis=1) < MAX_COM_SPEED)

    def _verdict(self, robot: int, failed: str, fell: bool, diverged: bool, over: bool, now: int) -> Outcome:
        com_speed = self._speed_sum[robot] / (JUDGED_S * CONTROL_HZ) if over else np.nan
        if failed:
            reason = failed
        elif diverged:
            reason = "diverged"
        elif fell:
            reason = "fell"
        elif over and self._tilted[robot]:
            reason = "tilted"
        elif over and com_speed >= MAX_COM_SPEED:
            reason = "restless"
        else:
            reason = "recovered"
        did = self._strategies.strategies(robot)
        calm_s = (self.end[robot] - self._calm[robot]) * CONTROL_DT
        calm_from = (self._calm[robot] - self.start[robot]) * CONTROL_DT
        stood = over and not fell and not diverged and not failed and calm_s > 0
        torque, speed = self._torque_peak[robot], self._speed_peak[robot]
        return Outcome(
            recovered=reason == "recovered",
            reason=reason,
            seconds=float(min(now, self.end[robot]) - self.start[robot]) / CONTROL_HZ,
            foot_shift=float(self._foot_shift[robot]),
            com_speed=float(com_speed),
            root_tilt=float(np.arccos(np.clip(self._least_upright[robot], -1.0, 1.0))),
            ankle=did.ankle,
            hip=did.hip,
            foot_tilt=did.foot_tilt,
            steps=did.num_steps,
            calm_drift=float(self._calm_drift[robot]) if stood else np.nan,
            calm_power=float(self._calm_work[robot]) * CONTROL_DT / calm_s if stood else np.nan,
            calm_steps=float(sum(step.time >= calm_from for step in did.steps)) if stood else np.nan,
            torque_ratio=float((torque / self._torque_limit).max()),
            speed_ratio=float((speed / self.robot.velocity_limit).max()),
            torque_peaks=tuple(float(torque[columns].max()) for columns in self._groups),
            speed_peaks=tuple(float(speed[columns].max()) for columns in self._groups),
            saturated_s=tuple(float(self._saturated[robot, columns].max()) * CONTROL_DT for columns in self._groups),
        )
