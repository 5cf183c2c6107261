"""Processes: tasks in loky processes of this machine, each in its own pool, so that a crash affects one task only."""

from __future__ import annotations

import signal
from concurrent.futures import Future
from typing import Any

from joblib.externals.loky.process_executor import BrokenProcessPool, ProcessPoolExecutor

from surefoot.cores import num_cores
from surefoot.executors.envelope import Answer, make_opener
from surefoot.executors.executor import WorkerLostError


class Processes:
    """So many processes; see `Backend`.

    Args:
        workers: their number; 0 for one per core.
    """

    def __init__(self, workers: int = 0):
        self.at_once = workers or num_cores()
        self._free = [_new() for _ in range(self.at_once)]
        self._busy: dict[Future[Any], ProcessPoolExecutor] = {}
        self._open = make_opener()

    def submit(self, sealed: bytes) -> Future[Any]:
        """Begin a sealed task in a process that is free."""
        pool = self._free.pop()
        future: Future[Any] = pool.submit(self._open, sealed)
        self._busy[future] = pool
        return future

    def collect(self, future: Future[Any]) -> Answer:
        """Return a task's answer; a process that has died is replaced."""
        pool = self._busy.pop(future)
        try:
            answer: Answer = future.result()
        except BrokenProcessPool as error:
            pool.shutdown(wait=False, kill_workers=True)
            self._free.append(_new())
            raise WorkerLostError("its process has ended") from error
        self._free.append(pool)
        return answer

    def close(self) -> None:
        """End all processes."""
        for pool in (*self._free, *self._busy.values()):
            pool.shutdown(wait=True, kill_workers=True)


def _new() -> ProcessPoolExecutor:
    # Ctrl-C reaches all processes of a terminal; the one that asked ends the others.
    return ProcessPoolExecutor(1, initializer=signal.signal, initargs=(signal.SIGINT, signal.SIG_IGN))
