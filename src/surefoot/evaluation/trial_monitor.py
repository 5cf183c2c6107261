"""TrialMonitor: the observation of every robot in a trial, and the one definition of success."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from surefoot.evaluation.outcome import Outcome, group_columns
from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.quiet import QuietRule, com_speed, is_upright
from surefoot.evaluation.strategies import StrategyWatch
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, CONTROL_HZ, TICKS_PER_STEP
from surefoot.robots import Robot

_JUDGED_TICKS = round(PROTOCOL.judged_time * CONTROL_HZ)
_SPEED_TICKS = round(PROTOCOL.speed_time * CONTROL_HZ)


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
        self._quiet_start = np.zeros(num_robots, np.int64)
        self._full_length = np.zeros(num_robots, bool)
        self._strategies = StrategyWatch(robot, num_robots)
        self._speed_sum = np.zeros(num_robots)
        self._tilted = np.zeros(num_robots, bool)
        self._least_upright = np.ones(num_robots)
        self._quiet_rule = QuietRule(num_robots)
        self._foot_place = np.zeros((num_robots, 2, 2))
        self._foot_shift = np.zeros(num_robots)
        self._quiet_place = np.zeros((num_robots, 2))
        self._quiet_drift = np.zeros(num_robots)
        self._quiet_work = np.zeros(num_robots)
        self._torque_peak = np.zeros((num_robots, robot.num_joints))
        self._speed_peak = np.zeros((num_robots, robot.num_joints))
        self._last_speeds = np.zeros((num_robots, _SPEED_TICKS - 1, robot.num_joints))
        self._sustained_speed = np.zeros((num_robots, robot.num_joints))
        self._saturated = np.zeros((num_robots, robot.num_joints), np.int64)
        self._groups = group_columns(robot)

    def reset(
        self,
        ids: np.ndarray,
        ticks: StepRecord,
        start: np.ndarray,
        push_end: np.ndarray,
        horizon: np.ndarray,
        quiet_from: np.ndarray,
        full_length: np.ndarray,
    ) -> None:
        """Robots `ids` (n,) begin a trial.

        Args:
            ids: the robots (n,).
            ticks: one of each, their state at the reset.
            start: tick at which the disturbance begins (n,).
            push_end: tick at which its last push ends (n,).
            horizon: from the beginning of the disturbance to the verdict [s] (n,).
            quiet_from: from the beginning of the disturbance until quiet standing is measured [s] (n,).
            full_length: bool (n,), whether the trial runs to its horizon even if the robot stands quietly before.
        """
        self._strategies.reset(ids, ticks)
        self._quiet_rule.reset(ids)
        self.start[ids], self._push_end[ids], self._full_length[ids] = start, push_end, full_length
        self.end[ids] = start + np.rint(np.asarray(horizon) * CONTROL_HZ).astype(np.int64)
        self._quiet_start[ids] = start + np.rint(np.asarray(quiet_from) * CONTROL_HZ).astype(np.int64)
        self._foot_place[ids] = ticks.sole_position[:, 0, :, :2]
        self._quiet_place[ids] = ticks.com_position[:, 0, :2]
        self._least_upright[ids] = 1.0
        for seen in (
            self._speed_sum, self._tilted, self._foot_shift, self._quiet_drift, self._quiet_work, self._torque_peak,
            self._speed_peak, self._last_speeds, self._sustained_speed, self._saturated,
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
            ids: the robots (n,).
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
        self._watch_quiet_standing(ids, ticks, tick)
        self._watch_joints(ids, ticks)
        fell = np.asarray((ticks.non_foot_contact & (tick < self.end[ids, None])).any(axis=1))
        quiet: np.ndarray = ~self._full_length[ids] & self._quiet_rule.holds(ids)
        over = np.asarray(now >= self.end[ids])
        failed = failed or {}
        helpless = np.isin(ids, list(failed))
        ended = np.flatnonzero(fell | diverged | quiet | over | helpless)
        return {
            robot: self._verdict(robot, failed.get(robot, ""), fell[i], diverged[i], over[i], int(now[i]))
            for i, robot in zip(ended, ids[ended].tolist(), strict=True)
        }

    def _watch_balance(self, ids: np.ndarray, ticks: StepRecord, tick: np.ndarray) -> None:
        speed, upright = com_speed(ticks), is_upright(ticks)
        root, end = ticks.root_uprightness, self.end[ids, None]
        judged = (tick >= end - _JUDGED_TICKS) & (tick < end)
        self._speed_sum[ids] += (speed * judged).sum(axis=1)
        self._tilted[ids] |= (~upright & judged).any(axis=1)
        least = np.where(tick >= self.start[ids, None], root, 1.0).min(axis=1)
        self._least_upright[ids] = np.minimum(self._least_upright[ids], least)
        self._quiet_rule.update(ids, upright, speed, tick[:, 0], counts=tick[:, 0] >= self._push_end[ids])

    def _watch_feet(self, ids: np.ndarray, ticks: StepRecord, tick: np.ndarray) -> None:
        before = tick[:, -1] < self.start[ids]
        soles = ticks.sole_position[..., :2]
        self._foot_place[ids] = np.where(before[:, None, None], soles[:, -1], self._foot_place[ids])
        shift = np.linalg.norm(soles - self._foot_place[ids, None], axis=-1).max(axis=(1, 2))
        self._foot_shift[ids] = np.where(before, 0.0, np.maximum(self._foot_shift[ids], shift))

    def _watch_quiet_standing(self, ids: np.ndarray, ticks: StepRecord, tick: np.ndarray) -> None:
        place = ticks.com_position[:, -1, :2]
        begun = tick[:, 0] >= self._quiet_start[ids]
        self._quiet_place[ids] = np.where(begun[:, None], self._quiet_place[ids], place)
        drift = np.where(begun, np.linalg.norm(place - self._quiet_place[ids], axis=-1), 0.0)
        self._quiet_drift[ids] = np.maximum(self._quiet_drift[ids], drift)
        self._quiet_work[ids] += np.where(begun, ticks.joint_power.sum(axis=(1, 2)), 0.0)

    def _watch_joints(self, ids: np.ndarray, ticks: StepRecord) -> None:
        torque = np.abs(ticks.joint_torque)
        self._torque_peak[ids] = np.maximum(self._torque_peak[ids], torque.max(axis=1))
        self._speed_peak[ids] = np.maximum(self._speed_peak[ids], np.abs(ticks.joint_velocity).max(axis=1))
        velocity = np.concatenate([self._last_speeds[ids], ticks.joint_velocity], axis=1)
        self._last_speeds[ids] = velocity[:, -_SPEED_TICKS + 1 :]
        mean = np.abs(sliding_window_view(velocity, _SPEED_TICKS, axis=1).mean(axis=-1)).max(axis=1)
        self._sustained_speed[ids] = np.maximum(self._sustained_speed[ids], mean)
        self._saturated[ids] += (torque >= PROTOCOL.saturation * self._torque_limit).sum(axis=1)

    def _verdict(self, robot: int, failed: str, fell: bool, diverged: bool, over: bool, now: int) -> Outcome:
        speed = float(self._speed_sum[robot] / (PROTOCOL.judged_time * CONTROL_HZ)) if over else np.nan
        tilted, restless = over and bool(self._tilted[robot]), over and speed >= PROTOCOL.max_com_speed
        reason = failed or _reason(diverged=diverged, fell=fell, tilted=tilted, restless=restless)
        did = self._strategies.strategies(robot)
        quiet_s = (self.end[robot] - self._quiet_start[robot]) * CONTROL_DT
        quiet_from = (self._quiet_start[robot] - self.start[robot]) * CONTROL_DT
        stood = over and not fell and not diverged and not failed and quiet_s > 0
        torque, joint_speed = self._torque_peak[robot], self._speed_peak[robot]
        return Outcome(
            recovered=reason == "recovered",
            reason=reason,
            seconds=float(min(now, self.end[robot]) - self.start[robot]) / CONTROL_HZ,
            foot_shift=float(self._foot_shift[robot]),
            com_speed=speed,
            root_tilt=float(np.arccos(np.clip(self._least_upright[robot], -1.0, 1.0))),
            ankle=did.ankle,
            hip=did.hip,
            foot_tilt=did.foot_tilt,
            steps=did.num_steps,
            quiet_drift=float(self._quiet_drift[robot]) if stood else np.nan,
            quiet_power=float(self._quiet_work[robot]) * CONTROL_DT / quiet_s if stood else np.nan,
            quiet_steps=float(sum(step.time >= quiet_from for step in did.steps)) if stood else np.nan,
            torque_ratio=float((torque / self._torque_limit).max()),
            speed_ratio=float((joint_speed / self.robot.velocity_limit).max()),
            sustained_speed_ratio=float((self._sustained_speed[robot] / self.robot.velocity_limit).max()),
            torque_peaks=tuple(float(torque[columns].max()) for columns in self._groups),
            speed_peaks=tuple(float(joint_speed[columns].max()) for columns in self._groups),
            saturated_s=tuple(float(self._saturated[robot, columns].max()) * CONTROL_DT for columns in self._groups),
        )


def _reason(**holds: bool) -> str:
    """The first way to fail that holds; "recovered" if none does."""
    return next((reason for reason, is_so in holds.items() if is_so), "recovered")
