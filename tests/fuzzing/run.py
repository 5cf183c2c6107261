"""Run cases and say what became of each: a clean error, accepted, a traceback, a hang, code executed, or too large."""

from __future__ import annotations

import collections
import contextlib
import io
import json
import logging
import multiprocessing
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path

from surefoot.whole_file import write_whole

CLEAN, ACCEPTED, TRACEBACK, HANG, CRASH, CODE, LARGE = (
    "clean errors", "accepted", "tracebacks", "hangs", "crashes", "code executed", "above 1 GB",
)  # fmt: skip
OUTCOMES = (CLEAN, ACCEPTED, TRACEBACK, HANG, CRASH, CODE, LARGE)
HANG_CPU_S, HANG_WALL_S = 10.0, 180.0
"""A case that needs more processor time than this, or more time altogether, hangs."""
LARGE_BYTES = 10**9
_RUNS_CODE = ("pickle.find_class", "subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "socket.connect")
"""Audit events of Python's that no damaged file may cause."""

Case = tuple[str, int]
_executed: list[str] = []


def _audit(event: str, arguments: tuple[object, ...]) -> None:
    if event in _RUNS_CODE:
        _executed.append(event)


def run_case(case: Case) -> tuple[str, str]:
    """What becomes of a case, and in words why."""
    from fuzzing.formats import FORMATS
    from surefoot.errors import UserError

    name, number = case
    _executed.clear()
    before = _peak_bytes()
    try:
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stderr(io.StringIO()):
            FORMATS[name].attempt(random.Random(f"{name} {number}"), Path(folder))
        outcome, words = ACCEPTED, ""
    except UserError as error:
        one_line = len(str(error).splitlines()) <= 1
        outcome, words = (CLEAN, "") if one_line else (TRACEBACK, f"an error of several lines: {error}")
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        words = f"{type(error).__name__}: {str(error)[:200]} at {Path(where.filename).name}:{where.lineno}"
        outcome = TRACEBACK
    if _executed:
        outcome, words = CODE, ", ".join(_executed)
    if _peak_bytes() - before > LARGE_BYTES:
        outcome, words = LARGE, f"{(_peak_bytes() - before) / 1e9:.1f} GB"
    return outcome, words


def _peak_bytes() -> int:
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def cases(number: int, first: int = 0) -> Iterator[Case]:
    """So many cases of all formats, each as often as its share says, evenly mixed."""
    from fuzzing.formats import FORMATS

    wheel = [name for name, form in FORMATS.items() for _ in range(form.share)]
    random.Random(0).shuffle(wheel)
    for i in range(first, first + number):
        yield wheel[i % len(wheel)], i


class Tally:
    """What became of cases, kept in a file from minute to minute, so that the next call goes on after them.

    Attributes:
        found: by format, how many cases ended how.
        next: number of the case that comes next.
        seconds: time that all have taken.
    """

    def __init__(self, path: Path):
        self._path = path
        self.found: dict[str, collections.Counter[str]] = collections.defaultdict(collections.Counter)
        self.next, self.seconds = 0, 0.0
        if path.exists():
            kept = json.loads(path.read_text())
            self.next, self.seconds = kept["next"], kept["seconds"]
            self.found.update({name: collections.Counter(counts) for name, counts in kept["found"].items()})

    def keep(self) -> None:
        """Write the file."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        kept = {"next": self.next, "seconds": self.seconds, "found": self.found}
        write_whole(self._path, json.dumps(kept).encode())


def run_guarded(last: int, minutes: float, tally: Tally) -> None:
    """Run the cases up to a number in a process of their own, which is replaced when a case hangs or kills it.

    Prints what goes wrong, and ends early after so many minutes.
    """
    worker, told, before = _Worker(), time.monotonic(), tally.seconds
    began = told
    for case in cases(last - tally.next, tally.next):
        outcome, words = worker.run(case)
        if outcome in (HANG, CRASH):
            worker.kill()
            worker = _Worker()
        tally.found[case[0]][outcome] += 1
        if outcome not in (CLEAN, ACCEPTED):
            print(f"{case}: {outcome}: {words}", file=sys.stderr, flush=True)
        now = time.monotonic()
        tally.next, tally.seconds = case[1] + 1, before + now - began
        if now > told + 60.0:
            told = now
            tally.keep()
            print(f"{tally.next} cases in {tally.seconds:.0f} s", file=sys.stderr, flush=True)
        if now > began + 60.0 * minutes:
            break
    worker.kill()
    tally.keep()


class _Worker:
    """A process that runs one case after the other."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._here, there = context.Pipe()
        self._process = context.Process(target=_work, args=(there,), daemon=True)
        self._process.start()
        there.close()
        self._here.recv()  # it has loaded all modules

    def run(self, case: Case) -> tuple[str, str]:
        self._here.send(case)
        began, cpu = time.monotonic(), self._cpu_s()
        while not self._here.poll(1.0):
            if self._cpu_s() - cpu > HANG_CPU_S or time.monotonic() - began > HANG_WALL_S:
                return HANG, f"more than {HANG_CPU_S:g} s"
            if not self._process.is_alive():
                return CRASH, f"exit code {self._process.exitcode}"
        try:
            return self._here.recv()
        except EOFError:
            self._process.join()
            return CRASH, f"exit code {self._process.exitcode}"

    def kill(self) -> None:
        self._process.kill()
        self._process.join()

    def _cpu_s(self) -> float:
        try:
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _work(there: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.disable()
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, 2)  # MuJoCo and onnxruntime write there
    folder = tempfile.mkdtemp()
    os.chdir(folder)
    import fuzzing.formats  # noqa: F401

    sys.addaudithook(_audit)
    there.send("ready")
    with contextlib.suppress(EOFError):
        while True:
            there.send(run_case(there.recv()))


def table(found: dict[str, collections.Counter[str]]) -> str:
    """The counts as Markdown."""
    lines = ["| format | tries | " + " | ".join(OUTCOMES) + " |", "|---|" + "---:|" * (len(OUTCOMES) + 1)]
    total: collections.Counter[str] = collections.Counter()
    for name, counts in found.items():
        total += counts
        lines.append(f"| {name} | {counts.total():,} | " + " | ".join(f"{counts[each]:,}" for each in OUTCOMES) + " |")
    lines.append(f"| all | {total.total():,} | " + " | ".join(f"{total[each]:,}" for each in OUTCOMES) + " |")
    return "\n".join(lines)
