"""Loop: a controller over a batch of robots, called every few ticks, and what becomes of those it fails."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import numpy as np

from surefoot.agents.controllers.controller import Command, ControllerAgent, State
from surefoot.physics.rotations import roll_pitch
from surefoot.physics.signals import Delay, LowPass
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, CONTROL_HZ, TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.task import observation
from surefoot.task.control_loop import ControlLoop

PATIENCE_S = 0.1
"""A control step that takes longer than this per robot (and `PATIENCE_S * 20` in all) fails its trial."""
RAISED, NOT_FINITE, WRONG_SHAPE, TOO_LATE = "raised", "not finite", "wrong shape", "too late"
REASONS = (RAISED, NOT_FINITE, WRONG_SHAPE, TOO_LATE)
"""Why a controller fails its trial."""


class ControllerLoop(ControlLoop):
    """Policy steps of `num_robots` robots under a controller that is called several times in each.

    Attributes:
        failed: robot -> reason, of the robots whose controller has failed since their reset.
    """

    def __init__(
        self,
        contestant: ControllerAgent,
        robot: Robot,
        num_robots: int,
        num_threads: int = 0,
        domain: DomainParameters = NOMINAL_DOMAIN,
    ):
        self.contestant = contestant
        self.controller = contestant.make(robot, num_robots)
        self.failed: dict[int, str] = {}
        self._block = CONTROL_HZ // contestant.rate_hz
        super().__init__(robot, num_robots, np.array(contestant.contract.nominal_pose), 1.0, num_threads, domain)
        self._errors = LowPass(num_robots, len(self._scales), self._block, CONTROL_HZ)
        self._delay = Delay(num_robots, TICKS_PER_STEP, robot.num_joints)
        self._seen = self.engine.read(np.arange(num_robots))

    def begin(self, ids: np.ndarray) -> None:
        """Robots `ids` (n,) begin a trial, right after their reset."""
        self._seen.record[ids] = self.engine.read(ids).record
        for robot in ids.tolist():
            self.failed.pop(robot, None)
        self._guard(lambda robots: self.controller.reset(robots), ids)

    def drive(self, ids: np.ndarray) -> StepRecord:
        """One policy step of robots `ids` (n,), in several control steps.

        Returns:
            The step's ticks, as `ControlLoop.step`.
        """
        self._write_pushes()
        shake = self._action_noise.add(ids, np.zeros((len(ids), self.robot.num_joints)))
        parts = []
        for first in range(0, TICKS_PER_STEP, self._block):
            ticks = slice(first, first + self._block)
            driven = np.array(
                [(first == 0 or not self.engine.diverged[i]) and i not in self.failed for i in ids.tolist()], bool
            )
            goal = self._target[ids]
            if driven.any():
                goal[driven] = self._goals(self._state(ids[driven]), ids[driven])
            path = self._path(self._target[ids], goal)
            self._target[ids] = goal
            path = self._delay(ids, path + shake[:, None])
            self.engine.joint_targets[ids, ticks] = path
            parts.append(self.engine.step(ids, ticks))
            self._seen.record[ids] = parts[-1].record[:, -1:]
            self._see_errors(ids)
            self.tick[ids] += self._block
        return StepRecord.join(parts)

    def _path(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Motor targets over a control step: (n, block, num_joints)."""
        if self.contestant.path == "hold":
            return np.repeat(goal[:, None], self._block, axis=1)
        share = (np.arange(1, self._block + 1) / self._block)[:, None]
        return start[:, None] + share * (goal - start)[:, None]

    def _goals(self, state: State, ids: np.ndarray) -> np.ndarray:
        """Motor targets (n, num_joints) [rad] of the controller's answer.

        A feed-forward torque is a target moved by torque / stiffness: the impedance then adds just that torque, and
        the motor's limits hold for the sum. Only the joint target proper is clipped to the joint's range.
        """
        goal = self._target[ids]
        began = time.perf_counter()
        answers = self._guard(lambda robots: self.controller(state.rows(np.isin(ids, robots)), robots), ids)
        self.contestant.times.add(time.perf_counter() - began, len(ids))
        for robots, command in answers:
            rows = np.flatnonzero(np.isin(ids, robots))
            targets = self._checked(command, robots)
            if targets is not None:
                good = np.isfinite(targets).all(axis=1)
                for robot in robots[~good].tolist():
                    self._fail(robot, NOT_FINITE)
                goal[rows[good]] = targets[good]
        return goal

    def _checked(self, command: Command, robots: np.ndarray) -> np.ndarray | None:
        shape = (len(robots), self.robot.num_joints)
        try:
            parts = [np.asarray(part, np.float64) for part in command if part is not None]
        except (TypeError, ValueError):
            parts = []
        if not 1 <= len(parts) <= 2 or any(part.shape != shape for part in parts):
            for robot in robots.tolist():
                self._fail(robot, WRONG_SHAPE)
            return None
        targets = np.clip(parts[0], self.robot.joint_lower, self.robot.joint_upper)
        return targets + parts[1] / self.robot.stiffness if len(parts) == 2 else targets

    def _guard(self, call, ids: np.ndarray) -> list[tuple[np.ndarray, Command]]:
        """Answers of the controller with the robots that each is for; if it raises, each robot is asked alone."""
        try:
            with _time_limit(PATIENCE_S * max(20, len(ids))):
                return [(ids, call(ids))]
        except _TooLate:
            for robot in ids.tolist():
                self._fail(robot, TOO_LATE)
            return []
        except Exception as error:
            if len(ids) == 1:
                self._fail(int(ids[0]), RAISED, f"{type(error).__name__}: {error}")
                return []
        return [answer for i in range(len(ids)) for answer in self._guard(call, ids[i : i + 1])]

    def _fail(self, robot: int, reason: str, words: str = "") -> None:
        self.failed[robot] = reason
        self.contestant.failures[f"{reason} ({words})" if words else reason] += 1

    def _see_errors(self, ids: np.ndarray) -> None:
        """Noise and bias at the ticks of a control step, through the filter that a policy's pass."""
        imperfect = ids[self.imperfect[ids]]
        if len(imperfect):
            bias = np.repeat(self._bias[imperfect, None], self._block, axis=1)
            self._errors([self._observation_noise.add(imperfect, bias)], imperfect)

    def _state(self, ids: np.ndarray) -> State:
        ticks = self._seen[ids]
        vector = observation.observe(ticks)[:, 0]
        if self.imperfect[ids].any():
            vector = vector + self._errors.output[ids]
        columns = np.cumsum([len(part.components or self.robot.joint_names) for part in observation.TABLE.values()])
        parts = np.split(vector * observation.units(self.robot), columns[:-1], axis=1)
        named = dict(zip(observation.TABLE, parts, strict=True))
        soles = np.stack([named["left_foot_position"], named["right_foot_position"]], axis=1)
        height = named["com_position"][:, 2] - soles[..., 2].min(axis=1)
        swing = np.sqrt(np.maximum(height, 0.0) / self.robot.gravity)[:, None]
        heading, place = ticks.heading[:, 0].conj(), ticks["root_position"][:, 0, :2]
        pressed = (ticks.foot_pressure_point[:, 0] - place[:, None]) @ np.array([1.0, 1.0j])
        return State(
            time=self.tick[ids] * CONTROL_DT,
            joint_position=named["joint_position"],
            joint_velocity=named["joint_velocity"],
            root_attitude=named["root_attitude"],
            root_velocity=named["root_velocity"],
            root_angular_velocity=named["root_angular_velocity"],
            com_position=named["com_position"],
            com_velocity=named["com_velocity"],
            capture_point=named["com_position"][:, :2] + named["com_velocity"][:, :2] * swing,
            com_height=height,
            sole_position=soles,
            foot_attitude=np.moveaxis(roll_pitch(ticks.foot_orientation[:, 0]), 0, -1),
            foot_force=named["foot_force"],
            pressure_point=np.stack([(pressed * heading[:, None]).real, (pressed * heading[:, None]).imag], axis=-1),
        )


class _TooLate(BaseException):
    """Not an Exception, so that no controller catches it by the way."""


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """Break off what takes longer. Outside the main thread Python has no means to, and it is seen afterwards."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise _TooLate

    began, in_main = time.perf_counter(), threading.current_thread() is threading.main_thread()
    if in_main:
        before = signal.signal(signal.SIGALRM, ring)
        signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        if in_main:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)
    if time.perf_counter() - began > seconds:
        raise _TooLate
