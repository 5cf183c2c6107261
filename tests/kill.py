"""Kill: end trainings, evaluations and studies by SIGKILL at random moments and at chosen writes, and print a table.

Run by `make kill`. After every kill the files are checked, and the same call goes on with them, until the work is done
and another one begins. Each work runs in a process that is forked from this one, which has loaded all modules before.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import pickle
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from killing.told import PHASES, Told, WritePoint
from killing.works import WORKS, Loss, Work

SHARES = {"training": 0.5, "evaluation": 0.3, "reproduce": 0.2}
"""Of the kills."""


class Killed(NamedTuple):
    """A kill and what it has cost."""

    work: str
    kind: str
    loss: Loss


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--random", type=int, default=100, help="kills at random moments")
    parser.add_argument("--chosen", type=int, default=30, help="kills at chosen writes")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60.0, help="for all; each kind of work has its share")
    parser.add_argument("--only", choices=list(WORKS), default=None)
    told = parser.parse_args()
    began, kills = time.monotonic(), list[Killed]()
    until = began
    for name, share in SHARES.items():
        if told.only in (None, name):
            until += 60.0 * told.minutes * (1.0 if told.only else share)
            with tempfile.TemporaryDirectory(prefix="surefoot-kill-") as folder:
                kills += kill_work(
                    name, round(share * told.random), round(share * told.chosen), told.seed, folder, until
                )
    print(table(kills))
    print(f"\n{len(kills)} kills in {(time.monotonic() - began) / 60.0:.0f} minutes, seed {told.seed}")
    faults = [f"{kill.work}, {kill.kind}: {fault}" for kill in kills for fault in kill.loss.faults]
    print("\n".join(faults))
    sys.exit(bool(faults))


def kill_work(name: str, num_random: int, num_chosen: int, seed: int, folder: str, until: float) -> list[Killed]:
    """Kill one kind of work so many times.

    Args:
        name: of the work.
        num_random: kills at random moments.
        num_chosen: kills at chosen writes.
        seed: of the moments and writes.
        folder: for what it writes.
        until: no kill begins after this time, by the monotonic clock [s].
    """
    work, rng, told, kills = WORKS[name], random.Random(f"{name} {seed}"), Told(), list[Killed]()
    whole_s, num_writes = _without_a_kill(work, Path(folder) / "reference", told)
    kinds = ["random"] * num_random + ["chosen"] * num_chosen
    rng.shuffle(kinds)
    number = 0
    while len(kills) < len(kinds) and time.monotonic() < until:
        kind, place = kinds[len(kills)], Path(folder) / str(number)
        # Of the first half of the writes: fewer are left where the work goes on after a kill.
        point = WritePoint(rng.randint(1, num_writes // 2 + 1), rng.choice(PHASES)) if kind == "chosen" else None
        told.clear()
        is_killed, error = _run(partial(work.run, place, told, number), told, point, rng.uniform(0.0, whole_s))
        if is_killed:
            loss = _checked(work, place, told)
        else:  # it was done before its kill, or failed, which counts as one
            loss = Loss(0, 0.0, [error] if error else _asked(partial(work.finish, place)))
            shutil.rmtree(place, ignore_errors=True)
            number += 1
        if is_killed or loss.faults:
            kills.append(Killed(name, kind, loss))
            print(f"{name} {len(kills)}, {point or kind}: {loss}", file=sys.stderr, flush=True)
    return kills


def _without_a_kill(work: Work, folder: Path, told: Told) -> tuple[float, int]:
    """How long the whole work takes [s], and how many writes it makes."""
    began = time.monotonic()
    _, error = _run(lambda: work.run(folder, told, 0), told, None, None)
    faults = [error] if error else _asked(lambda: work.finish(folder))
    if faults:
        sys.exit(f"the work fails without a kill: {faults}")
    return time.monotonic() - began, told.num_writes


def _run(work: Callable[[], None], told: Told, point: WritePoint | None, seconds: float | None) -> tuple[bool, str]:
    """Do some work in a process of its own, which is killed after a time, or at one of its writes.

    Returns:
        Whether it was killed, and the error by which it ended otherwise.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.setpgid(0, 0)
        with contextlib.suppress(BaseException):
            error = ""
            try:
                told.watch_writes(point)
                work()
            except BaseException:
                error = traceback.format_exc()
            os.write(writing, error.encode()[:60_000])
        os._exit(0)
    os.close(writing)
    if seconds is not None and point is None:
        time.sleep(seconds)
        told.kill(child)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    with open(reading, "rb") as stream:
        error = stream.read().decode() if status != -signal.SIGKILL else ""
    return status == -signal.SIGKILL, error


def _checked(work: Work, folder: Path, told: Told) -> Loss:
    found = _asked(lambda: work.check(folder, told))
    return found if isinstance(found, Loss) else Loss(0, 0.0, found)


def _asked(question: Callable[[], Any]) -> Any:
    """The answer of another process, so that this one starts no threads; an error in a list, as words."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            answer = question()
        except BaseException:
            answer = [traceback.format_exc()]
        os.write(writing, pickle.dumps(answer)[:60_000])
        os._exit(0)
    os.close(writing)
    with open(reading, "rb") as stream:
        answer = pickle.loads(stream.read())
    os.waitpid(child, 0)
    return answer


def table(kills: list[Killed]) -> str:
    """What was lost, as Markdown."""
    lines = [
        "| work | kills | at random moments | at chosen writes | greatest loss | "
        "oldest lost item before the kill [s] | "
        "corrupt files, better policies replaced, or losses beyond the promise |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for name, work in WORKS.items():
        those = [kill for kill in kills if kill.work == name]
        if those:
            kinds = [kill.kind for kill in those]
            lines.append(
                f"| {name} | {len(those)} | {kinds.count('random')} | {kinds.count('chosen')} | "
                f"{max(kill.loss.amount for kill in those)} {work.unit} | "
                f"{max(kill.loss.seconds for kill in those):.2f} | {sum(bool(kill.loss.faults) for kill in those)} |"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
