"""PyBullet as an engine: the same robots, pushes and record, in processes of their own, one for each core.

Bullet steps one robot at a time, and its client keeps a world for each. `pybullet_worker` has the robots; this module
deals them out and collects what they did. No robot's numbers depend on which process has it.
"""

from __future__ import annotations

import importlib.util
import pickle
import subprocess
import sys
import weakref
from importlib.metadata import version
from typing import Any

import numpy as np

from surefoot.cores import num_cores
from surefoot.errors import UserError
from surefoot.extras import advice
from surefoot.physics.engine import WHOLE_STEP
from surefoot.physics.step_record import StepRecord, record_layout
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters

_WORKER = "surefoot.physics.pybullet_worker"


def engine_name() -> str:
    """The engine and its version, which every result is kept with.

    Raises:
        UserError: PyBullet is not installed.
    """
    if importlib.util.find_spec("pybullet") is None:
        raise UserError(f"engine pybullet: {advice('pybullet')}")
    return f"pybullet {version('pybullet')}"


class PybulletEngine:
    """`num_robots` copies of a robot in PyBullet: an `Engine`, whose attributes are described there.

    Args:
        robot: what is simulated.
        num_robots: how many of it.
        num_threads: processes; 0 for one a core.
        domain: floor, masses, motors and physics rate.

    Raises:
        UserError: PyBullet is not installed, or the robot has a shape that URDF does not know.
    """

    def __init__(self, robot: Robot, num_robots: int, num_threads: int = 0, domain: DomainParameters = NOMINAL_DOMAIN):
        self.name = engine_name()
        self.robot = robot
        self.num_robots = num_robots
        num_columns = max(columns.stop for columns in record_layout(robot).values())
        self.joint_targets = np.zeros((num_robots, TICKS_PER_STEP, robot.num_joints))
        self.wrench = np.zeros((num_robots, TICKS_PER_STEP, len(robot.body_names), 6))
        self.diverged = np.zeros(num_robots, bool)
        self.num_diverged = 0
        self._now = np.zeros((num_robots, 1, num_columns))
        self._rest: dict[int, np.ndarray] = {}
        num_workers = min(num_threads or num_cores(), num_robots)
        self._owner = np.arange(num_robots) % num_workers
        self._workers = [_Worker(robot, domain, np.flatnonzero(self._owner == i)) for i in range(num_workers)]

    def reset(
        self,
        ids: np.ndarray,
        joint_position: np.ndarray,
        yaw: np.ndarray | float = 0.0,
        height: np.ndarray | float = 0.0,
        roll: np.ndarray | float = 0.0,
        pitch: np.ndarray | float = 0.0,
    ) -> StepRecord:
        """Put robots `ids` (n,) at rest, as `Engine.reset` says."""
        stances = np.broadcast_arrays(yaw, height, roll, pitch, np.zeros(len(ids)))[:-1]
        answers = self._ask("reset", ids, joint_position, *stances)
        for robot, (row, state) in zip(ids.tolist(), answers, strict=True):
            self._now[robot, 0], self._rest[robot] = row, state
        return self.read(ids)

    def rest_states(self, ids: np.ndarray) -> np.ndarray:
        """Where robots `ids` (n,) were put by `reset` and what their motors hold: (n, size)."""
        return np.array([self._rest[robot] for robot in ids.tolist()])

    def restart(self, ids: np.ndarray, states: np.ndarray) -> StepRecord:
        """Put robots `ids` (n,) at rest into states (n, size) of `rest_states`; returns one tick of each."""
        for robot, row, state in zip(ids.tolist(), self._ask("restart", ids, states), states, strict=True):
            self._now[robot, 0], self._rest[robot] = row, state
        return self.read(ids)

    def read(self, ids: np.ndarray) -> StepRecord:
        """One tick (n, 1, ...) of robots `ids`: their state at the last reset or the last tick."""
        return StepRecord(self.robot, self._now[ids])

    def step(self, ids: np.ndarray | None = None, ticks: slice = WHOLE_STEP) -> StepRecord:
        """Advance robots `ids` (n,), all without it, by some ticks of a policy step, as `Engine.step` says."""
        ids = np.arange(self.num_robots) if ids is None else ids
        wrench = self.wrench[ids, ticks]
        pushes = [each if each.any() else None for each in wrench]  # a NaN counts as a push
        answers = self._ask("advance", ids, self.joint_targets[ids, ticks], pushes)
        record = np.array([rows for rows, _ in answers])
        found = np.zeros(self.num_robots, bool)
        found[ids] = [diverged for _, diverged in answers]
        self.diverged = self.diverged | found if ticks.start else found
        self.num_diverged += int(found.sum())
        self._now[ids, 0] = record[:, -1]
        return StepRecord(self.robot, record)

    def set_friction(self, friction: float) -> None:
        """Set the sliding friction coefficient of all robots' feet and floor."""
        self._ask("set_friction", np.arange(self.num_robots), [friction] * self.num_robots)

    def set_gains(self, stiffness: np.ndarray, damping: np.ndarray) -> None:
        """Drive all robots' joints by this impedance (num_joints,) [Nm/rad, Nms/rad]; the motors' limits stay."""
        self._ask("set_gains", np.arange(self.num_robots), *([gain] * self.num_robots for gain in (stiffness, damping)))

    def _ask(self, method: str, ids: np.ndarray, *arguments: Any) -> list[Any]:
        """Call a method of robots' worlds with an argument of each; returns the answers in the order of `ids`."""
        calls = list(zip(ids.tolist(), *arguments, strict=True))
        owners = self._owner[ids].tolist()
        asked = []
        for number, worker in enumerate(self._workers):
            mine = [call for call, owner in zip(calls, owners, strict=True) if owner == number]
            if mine:
                worker.ask(method, mine)
                asked.append(worker)
        answers: dict[int, Any] = {}
        for worker in asked:
            answers |= worker.answers()
        return [answers[robot] for robot in ids.tolist()]


class _Worker:
    """A process with some of the robots.

    It ends when its standard input does: with this object, or with the process that made it.
    """

    def __init__(self, robot: Robot, domain: DomainParameters, ids: np.ndarray):
        self._process = subprocess.Popen(
            [sys.executable, "-m", _WORKER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, process_group=0
        )
        weakref.finalize(self, _end, self._process)
        self._send((robot.name, domain, ids.tolist()))
        self.answers()

    def ask(self, method: str, calls: list[Any]) -> None:
        """Have the process call a method of robots' worlds: (robot, *arguments) each."""
        self._send((method, calls))

    def answers(self) -> dict[int, Any]:
        """Robot -> what its world answered.

        Raises:
            UserError: the robot has no URDF, or the process has died.
        """
        assert self._process.stdout
        try:
            answer = pickle.load(self._process.stdout)  # from a process of ours, and from nowhere else
        except EOFError as error:
            raise UserError("a process of the engine pybullet has died") from error
        if isinstance(answer, Exception):
            raise answer
        return dict(answer)

    def _send(self, message: Any) -> None:
        assert self._process.stdin
        try:
            pickle.dump(message, self._process.stdin)
            self._process.stdin.flush()
        except BrokenPipeError as error:
            raise UserError("a process of the engine pybullet has died") from error


def _end(process: subprocess.Popen[bytes]) -> None:
    for stream in (process.stdin, process.stdout):
        if stream:
            stream.close()
    process.wait()
