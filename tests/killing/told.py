"""Told: memory that a killed process shares with whoever killed it, and the writes at which it is killed."""

from __future__ import annotations

import mmap
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from surefoot.evaluation.trial_store import Committer

MAX_PUTS = 8000
PHASES = ("written", "before", "after")
"""Of a write: its data are in a temporary file, it is about to be in place, it is in place."""


class WritePoint(NamedTuple):
    """Where a process kills itself: in a phase of its `number`-th write, counted from 1."""

    number: int
    phase: str


class Told:
    """What a work has told. Its memory outlives the process that writes into it.

    Attributes:
        puts: when outcomes of trials were handed to the results table, by the monotonic clock [s].
        killed_at: when the process was ended, by the same clock [s].
    """

    def __init__(self) -> None:
        shared = np.frombuffer(mmap.mmap(-1, 8 * (8 + MAX_PUTS)), np.float64)
        self._numbers, self.puts = shared[:8], shared[8:]

    def clear(self) -> None:
        """Forget what the last process has told."""
        self._numbers[:] = 0.0

    num_writes = property(lambda self: int(self._numbers[0]))
    steps = property(lambda self: int(self._numbers[1]))
    committed_steps = property(lambda self: int(self._numbers[2]))
    committed_rows = property(lambda self: int(self._numbers[3]))
    committed_best = property(lambda self: float(self._numbers[4]))
    committed_at = property(lambda self: float(self._numbers[5]))
    num_puts = property(lambda self: int(self._numbers[6]))

    killed_at = property(lambda self: float(self._numbers[7]))

    def kill(self, process: int) -> None:
        """End a process, and tell when."""
        self._numbers[7] = time.monotonic()
        os.kill(process, signal.SIGKILL)

    def step(self, steps: int) -> None:
        """So many policy steps have been made."""
        self._numbers[1] = steps

    def commit(self, steps: int, rows: int, best: float) -> None:
        """A checkpoint is in place."""
        self._numbers[2:6] = steps, rows, best, time.monotonic()

    def put(self, at: float) -> None:
        """The outcome of a trial was handed over, from a time on [s]."""
        self.puts[self.num_puts] = at
        self._numbers[6] += 1

    def watch_writes(self, point: WritePoint | None) -> None:
        """Count the writes of this process from now on, and kill it at one of them."""

        def pass_by(phase: str) -> None:
            self._numbers[0] += phase == PHASES[0]
            if point and self.num_writes == point.number and phase == point.phase:
                self.kill(os.getpid())

        def around(write: Callable[..., Any]) -> Callable[..., Any]:
            def watched(*arguments: Any) -> Any:
                pass_by("before")
                done = write(*arguments)
                pass_by("after")
                return done

            return watched

        synced, committed = os.fsync, Committer._commit

        def fsync(descriptor: int) -> None:
            synced(descriptor)
            pass_by("written")

        def commit(self: Committer) -> None:
            pass_by("written")
            around(committed)(self)

        os.fsync = fsync
        Path.replace = around(Path.replace)  # type: ignore[method-assign]
        Committer._commit = commit  # type: ignore[method-assign]
