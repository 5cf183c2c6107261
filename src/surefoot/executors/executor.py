"""Executor: runs tasks and passes on results as they arrive; the tasks of dead workers are run again."""

from __future__ import annotations

import pickle
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from types import TracebackType
from typing import Any, Protocol

from surefoot.errors import UserError, notice
from surefoot.executors.envelope import DONE, WRONG, Answer, seal

MAX_LOSSES = 3
"""Workers that may die of the same task before it is given up."""


class WorkerLostError(Exception):
    """The worker of a task has died, or its machine has."""


class Backend(Protocol):
    """Where sealed tasks are done; submitit's shape."""

    at_once: int
    """Tasks that it is given at the same time."""

    def submit(self, sealed: bytes) -> Future[Any]:
        """Begin a sealed task."""
        ...

    def collect(self, future: Future[Any]) -> Answer:
        """Return the answer of a task that has ended.

        Raises:
            WorkerLostError: its worker has died.
            UserError: the cluster cannot do it.
        """
        ...

    def close(self) -> None:
        """Stop what still runs, and leave no process behind."""
        ...


class Executor:
    """Does tasks; a context manager.

    Args:
        backend: where they are done; without one, they are done one after the other by the process that asks.
    """

    def __init__(self, backend: Backend | None = None):
        self._backend = backend

    def __enter__(self) -> Executor:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._backend:
            self._backend.close()

    @property
    def is_local(self) -> bool:
        """Does the process that asks do the tasks itself, with all of its cores?"""
        return self._backend is None

    @property
    def at_once(self) -> int:
        """Tasks that are done at the same time at most."""
        return self._backend.at_once if self._backend else 1

    def run(self, function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        """Do a task for each tuple of arguments; results come as they are done, with their tuple's place.

        Args:
            function: of a module of ours.
            tasks: its arguments, which can be pickled.

        Raises:
            UserError: a worker lacks something, or three of them died of the same task. Results that have come are
                not affected.
        """
        if self._backend is None:
            yield from ((number, function(*arguments)) for number, arguments in enumerate(tasks))
            return
        waiting, lost = deque(range(len(tasks))), Counter[int]()
        running: dict[Future[Any], int] = {}
        while waiting or running:
            while waiting and len(running) < self._backend.at_once:
                number = waiting.popleft()
                running[self._backend.submit(seal(function, tasks[number]))] = number
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                number = running.pop(future)
                try:
                    yield number, _opened(self._backend.collect(future))
                except WorkerLostError as error:
                    lost[number] += 1
                    _tell(number, len(tasks), lost[number], error)
                    waiting.append(number)


def _opened(answer: Answer) -> Any:
    """Return the result of an answer, or raise what it tells."""
    word, content = answer
    if word == DONE:
        return pickle.loads(content)
    if word == WRONG:
        raise UserError(content.decode())
    raise RuntimeError(content.decode())


def _tell(number: int, num_tasks: int, losses: int, error: WorkerLostError) -> None:
    """Say in a line that a worker has died.

    Raises:
        UserError: it has happened too often to the same task.
    """
    words = f"task {number + 1} of {num_tasks} lost its worker ({error})"
    if losses == MAX_LOSSES:
        raise UserError(f"{words} for the {MAX_LOSSES}rd time; is there enough memory for it?") from error
    notice(f"{words} and is begun again")
