"""Cores: the number of cores that this process uses by default."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

_limit = 0


def num_cores() -> int:
    """Return how many cores this process may use."""
    if _limit:
        return _limit
    usable = getattr(os, "sched_getaffinity", None)  # not on macOS
    return len(usable(0)) if usable else os.cpu_count() or 1


def num_threads() -> int:
    """Return what stands for "all cores" of this process: 0, or what `at_most` allows."""
    return _limit


@contextlib.contextmanager
def at_most(cores: int) -> Iterator[None]:
    """In this block the process leaves all but so many cores to others; 0 for no limit."""
    global _limit
    before, _limit = _limit, cores
    try:
        yield
    finally:
        _limit = before
