"""The memory of the page's process: one pool for all threads, and large pieces are given back."""

from __future__ import annotations

import subprocess
import sys

import pytest

MEASURE = """
import ctypes, re, sys, tempfile, threading
from surefoot.viewer.allocator import keep_little_memory

if sys.argv[1] == "keep little":
    print(keep_little_memory(), end=" ")
c = ctypes.CDLL(None)
c.malloc.restype, c.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
c.free.argtypes = [ctypes.c_void_p]
inside = threading.Barrier(9)

def take():
    c.malloc(1000)
    inside.wait()

threads = [threading.Thread(target=take) for _ in range(8)]
for thread in threads:
    thread.start()
inside.wait()
c.free(c.malloc(8_000_000))
large = c.malloc(4_000_000)
c.fopen.restype = ctypes.c_void_p
with tempfile.NamedTemporaryFile() as file:
    stream = ctypes.c_void_p(c.fopen(file.name.encode(), b"w"))
    c.malloc_info(0, stream)
    c.fclose(stream)
    told = file.read().decode()
sizes = re.findall('type="mmap" count="[0-9]+" size="([0-9]+)"', told)
print(told.count("<heap nr="), int(sizes[-1]) >= 4_000_000)
"""


def answer(what: str, **environment: str) -> str:
    command = [sys.executable, "-c", MEASURE, what]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.skipif(sys.platform != "linux", reason="only the GNU C library has pools of this kind")
def test_threads_share_one_pool_and_large_pieces_come_from_the_system() -> None:
    pools, large_is_the_systems = answer("leave it").split()
    assert int(pools) > 1
    assert large_is_the_systems == "False"  # 8 MB were freed before: 4 MB are cut from a pool now
    assert answer("keep little") == "True 1 True"


@pytest.mark.skipif(sys.platform != "linux", reason="only the GNU C library has pools of this kind")
def test_who_chose_a_number_of_pools_has_that_number() -> None:
    assert answer("keep little", MALLOC_ARENA_MAX="2").startswith("False 2")
