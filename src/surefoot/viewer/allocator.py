"""Allocator: the settings that keep the memory of the page small while viewers come and go.

The GNU C library gives threads memory pools of their own, at most eight per core, and each pool keeps its largest size.
The page has a thread for each browser's requests, so its memory would rise for hours. Once a large block was freed, the
library also takes the next ones from a pool instead of the system. A new viewer needs some megabytes for a moment,
which are returned only if they come from the system.
"""

from __future__ import annotations

import ctypes
import os
import sys

_M_ARENA_MAX, _M_MMAP_THRESHOLD = -8, -3
"""Parameters of `mallopt`: how many pools there are at most, and from how many bytes on a piece is the system's."""
_LARGE = 131_072


def keep_little_memory() -> bool:
    """Let all threads of this process share one pool of memory, and give large pieces back once they are free.

    Only threads that begin afterwards share it.

    Returns:
        Whether they do. They do not where the C library is another one, or where the user chose a number of pools by
        MALLOC_ARENA_MAX.
    """
    if sys.platform != "linux" or "MALLOC_ARENA_MAX" in os.environ:
        return False
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    return mallopt is not None and bool(mallopt(_M_ARENA_MAX, 1) and mallopt(_M_MMAP_THRESHOLD, _LARGE))
