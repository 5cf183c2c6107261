"""Envelope: the packing of tasks, so that a worker without this package or with another version says so in one line."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

from surefoot.version import __version__

Answer = tuple[str, bytes]
"""A word of `DONE`, `WRONG` and `FAILED`, and the pickled result or the message."""
DONE, WRONG, FAILED = "done", "wrong", "failed"
"""The task has a result; something a user can mend is wrong, in one line; the code has an error, with its traceback."""


def seal(function: Callable[..., Any], arguments: tuple[Any, ...]) -> bytes:
    """Return a task as bytes.

    Args:
        function: of a module of ours.
        arguments: that can be pickled.
    """
    return pickle.dumps((__version__, str(Path.cwd()), pickle.dumps((function, arguments))))


def make_opener() -> Callable[[bytes], Answer]:
    """Return the function that does a sealed task on a worker.

    It is a nested one, which cloudpickle sends by its code instead of its name, and it needs the standard library
    alone: so it runs where this package is missing.
    """

    def open_sealed(sealed: bytes) -> Answer:
        import importlib
        import pickle
        import socket
        import sys

        where = f"worker {socket.gethostname()}"
        wanted, folder, task = pickle.loads(sealed)
        try:
            found = importlib.import_module("surefoot.version").__version__
        except ImportError:
            return "wrong", f"{where} has no surefoot; install version {wanted} for {sys.executable} there".encode()
        if found != wanted:
            return "wrong", f"{where} has surefoot {found}, not {wanted}; install the same version there".encode()
        answer: Answer = importlib.import_module("surefoot.executors.worker").answer(task, folder, where)
        return answer

    return open_sealed
