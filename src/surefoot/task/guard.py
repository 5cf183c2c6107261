"""Guard: the calls of an agent, which keep a batch of trials running when the agent fails some robots."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, TypeVar

import numpy as np

from surefoot.checks import shortened
from surefoot.errors import UserError
from surefoot.task.agent import Agent, Command, as_numbers, check_agent

PATIENCE_S = 0.1
"""A control step that takes longer than this per robot (and `PATIENCE_S * 20` in all) fails its trials."""
RAISED, NOT_FINITE, WRONG_SHAPE, TOO_LATE = "raised", "not finite", "wrong shape", "too late"
REASONS = (RAISED, NOT_FINITE, WRONG_SHAPE, TOO_LATE)
"""Why an agent fails its trial."""

Answer = TypeVar("Answer")


class Guard:
    """Stands between the control loop and an agent.

    Attributes:
        failed: robot -> reason, of the robots that the agent has failed since their reset.
        error: the last exception that the agent raised, in words.
    """

    def __init__(self, agent: Agent, num_robots: int, num_joints: int):
        self.agent = agent
        self.failed: dict[int, str] = {}
        self.error = ""
        self._num_joints = num_joints
        self._is_known = np.zeros(num_robots, bool)

    def meet(self, ids: np.ndarray) -> None:
        """Let an agent that takes over in the middle of a trial begin with robots `ids` (n,) as with new ones."""
        new = ids[~self._is_known[ids]]
        if len(new):
            self.reset(new)

    def reset(self, ids: np.ndarray) -> None:
        """Let the agent forget robots `ids` (n,), which begin a trial."""
        self._is_known[ids] = True
        for robot in ids.tolist():
            self.failed.pop(robot, None)
        self._call(lambda rows: self.agent.reset(ids[rows]), ids)

    def ask(self, inputs: Any, ids: np.ndarray) -> Iterator[tuple[np.ndarray, Command]]:
        """Ask the agent about robots `ids` (n,).

        Args:
            inputs: what it is given, with a row for each of the robots.
            ids: the robots' numbers.

        Yields:
            Rows of `ids`, and the answer for them: float64 arrays of the right shape, of whatever numbers.
        """
        for rows, answer in self._call(lambda rows: self.agent(inputs[rows], ids[rows]), ids):
            command = self._checked(answer, len(rows))
            if command is None:
                self.fail(ids[rows], WRONG_SHAPE)
            else:
                yield rows, command

    def fail(self, ids: np.ndarray, reason: str, error: str = "") -> None:
        """Note that the agent has failed robots `ids` (n,)."""
        self.error = error or self.error
        for robot in ids.tolist():
            self.failed[robot] = reason
            self.agent.failures[f"{reason} ({error})" if error else reason] += 1

    def _checked(self, answer: Any, num_robots: int) -> Command | None:
        try:
            parts = [as_numbers(part) for part in answer if part is not None]
        except Exception:  # it is the agent's own object, which may raise anything
            return None
        shape = (num_robots, self._num_joints)
        fits = 1 <= len(parts) <= 2 and all(part.shape == shape for part in parts)
        return Command(*parts) if fits else None

    def _call(self, call: Callable[[Any], Answer], ids: np.ndarray) -> list[tuple[np.ndarray, Answer]]:
        """Answers with the rows of `ids` that each is for; if the agent raises, it is asked for each robot alone."""
        rows = np.arange(len(ids))
        try:
            with _time_limit(PATIENCE_S * max(20, len(ids))):
                return [(rows, call(slice(None)))]
        except _TooLate:
            self.fail(ids, TOO_LATE)
            return []
        except Exception as error:
            if len(ids) == 1:
                self.fail(ids, RAISED, in_words(error))
                return []
        return [answer for row in rows for answer in self._call_alone(call, ids, int(row))]

    def _call_alone(self, call: Callable[[Any], Answer], ids: np.ndarray, row: int) -> list[tuple[np.ndarray, Answer]]:
        one = np.array([row])
        return [(one, answer) for _, answer in self._call(lambda _: call(one), ids[one])]


def prepare(agent: Agent, num_robots: int) -> None:
    """Check what an agent wants, and let it get ready to drive robots 0 to `num_robots` - 1.

    Raises:
        UserError: it raises anything, or wants what there is not.
    """
    try:
        check_agent(agent)
        agent.prepare(num_robots)
    except UserError:
        raise
    except Exception as error:
        raise UserError(f"{agent.name} cannot drive {num_robots} robots: {in_words(error)}") from error


def in_words(error: Exception) -> str:
    """An exception of somebody else's code in one line that is not too long."""
    try:
        said = " ".join(str(error).split())
    except Exception:
        said = ""
    return f"{type(error).__name__}: {shortened(said, 200)}"


class _TooLate(BaseException):
    """Raised when the time is over; it is not an Exception, so that an agent which catches those does not catch it."""


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """Break off what takes longer; outside the main thread Python cannot do so, and only finds out afterwards.

    Raises:
        _TooLate: it has taken longer.
    """

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
