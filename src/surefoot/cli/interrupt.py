"""Interrupt: the handling of Ctrl-C while modules load, and where a process may end at once."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

EXIT_CODE = 130
"""Of a command that Ctrl-C ended: 128 + SIGINT."""
_IMPORT_SYSTEM = "<frozen importlib._bootstrap>"
_SHOW_CURSOR = "\x1b[?25h"


def listen() -> None:
    """From now on Ctrl-C ends the process at once while a module loads, and raises KeyboardInterrupt elsewhere.

    Compiled modules turn a KeyboardInterrupt that is raised while they load into other errors, or swallow it.
    """
    if _is_default():
        signal.signal(signal.SIGINT, _raise_or_end)


@contextlib.contextmanager
def ends_at_once() -> Iterator[None]:
    """Ctrl-C ends the process at once in this block, which has nothing to lose."""
    if not _is_default():
        yield
        return
    before = signal.signal(signal.SIGINT, _end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def end_within(seconds: float) -> None:
    """End the process after that time at the latest, whatever still runs: a thread that hangs, for example."""
    timer = threading.Timer(seconds, os._exit, (EXIT_CODE,))
    timer.daemon = True
    timer.start()


def _is_default() -> bool:
    """Does Ctrl-C do here what it usually does? It does not in a thread, nor in what `nohup` started."""
    is_main = threading.current_thread() is threading.main_thread()
    return is_main and signal.getsignal(signal.SIGINT) in (signal.default_int_handler, _raise_or_end)


def _raise_or_end(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename == _IMPORT_SYSTEM:
            _end(number, frame)
        frame = frame.f_back
    raise KeyboardInterrupt


def _end(number: int, frame: Any) -> None:
    with contextlib.suppress(OSError, ValueError):
        if sys.stderr.isatty():
            sys.stderr.write(_SHOW_CURSOR)  # which a progress bar hides
            sys.stderr.flush()
    os._exit(EXIT_CODE)
