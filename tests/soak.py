"""Soak: 50 viewers of the live page for two hours, who come, watch, push and go, and the memory of the page meanwhile.

Run by `make soak`. The page runs in a process of its own, as `surefoot play` serves it. The viewers are connections as
browsers make them, and messages as browsers send them; each of them stays for some minutes and is then followed by
another one. Most of them take messages as over a slow line, so that the page has to wait for them.
"""

from __future__ import annotations

import argparse
import logging
import multiprocessing
import os
import random
import sys
import tempfile
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TextIO

from page_client import CAMERA, PageClient, free_port

BUTTONS = ("Push", "Reset", "Lift and push")
GROWTH_LIMIT = 0.1
"""Share by which the page's memory may grow."""
SLOW_LINE = 16_384
"""Bytes on the way to a viewer who takes few messages; what he does not take waits at the page."""
HEAD = """\
| minutes | memory [MB] | cores of the page | viewers | visits | policy steps | messages heard | errors |
|---:|---:|---:|---:|---:|---:|---:|---:|
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--viewers", type=int, default=50)
    parser.add_argument("--stay", type=float, default=180.0, help="mean time that a viewer stays [s]")
    parser.add_argument("--rate", type=float, default=5.0, help="messages a second that nine of ten viewers take")
    parser.add_argument("--rows", type=int, default=24, help="rows of the table")
    parser.add_argument("--log", type=Path, default=Path("build/soak.log"), help="where the table is written")
    told = parser.parse_args()
    logging.disable()  # of what websockets says of a connection that ends
    here, there = multiprocessing.Pipe()
    page = multiprocessing.get_context("spawn").Process(target=serve, args=(there,), daemon=True)
    page.start()
    address, end = here.recv(), time.monotonic() + 60.0 * told.minutes
    counts = Counts()
    viewers = [
        threading.Thread(target=watch, args=(address, i, end, told.stay, told.rate, counts), daemon=True)
        for i in range(told.viewers)
    ]
    for viewer in viewers:
        viewer.start()
    told.log.parent.mkdir(parents=True, exist_ok=True)
    with told.log.open("w", buffering=1) as log:
        tell(log, f"{told.viewers} viewers who stay for {told.stay:g} s on average and of whom nine in ten take ")
        tell(log, f"{told.rate:g} messages a second, {told.minutes:g} minutes, ")
        tell(log, f"begun on {time.strftime('%d %B %Y at %H:%M')}\n\n{HEAD}")
        memory = measure(here, page.pid or 0, end, told.rows, counts, log)
        growth = grown(memory)
        tell(log, f"\nThe memory of the last quarter is {growth:.3f} of that of the first.\n")
    for viewer in viewers:
        viewer.join(20.0)
    here.send("end")
    page.join(30.0)
    sys.exit(growth > 1.0 + GROWTH_LIMIT or counts.errors > 0)


class Counts:
    """What the viewers have done and met."""

    visits = messages = errors = 0


def serve(there: Connection) -> None:
    """Show the page until somebody says that it is over; tell its policy steps when asked."""
    from surefoot.cli.play import Play

    page = Play("nominal", port=free_port(), runs=(Path(tempfile.mkdtemp()),)).page()
    there.send(page.address)
    while there.recv() != "end":
        there.send((page.player.session.num_steps, len(page.server.get_clients()), time.process_time()))
    page.close()


def watch(address: str, number: int, end: float, stay: float, rate: float, counts: Counts) -> None:
    """One place of a viewer, taken by one after the other, each for half to one and a half of a time [s].

    Every tenth one takes all messages at once, the others so many a second.
    """
    rng, is_fast = random.Random(number), number % 10 == 0
    while time.monotonic() < end:
        try:
            with PageClient(address, 0 if is_fast else SLOW_LINE) as viewer:
                counts.visits += 1
                leaves = min(end, time.monotonic() + stay * rng.uniform(0.5, 1.5))
                while time.monotonic() < leaves:
                    if len(viewer.controls) < 10:
                        viewer.listen(1.0)
                        continue
                    heard = viewer.skip(1.0)
                    counts.messages += heard
                    if rng.random() < 0.02:
                        act(viewer, rng)
                    if not is_fast:
                        time.sleep(1.0 / rate)
        except Exception as error:
            counts.errors += 1
            print(f"viewer {number}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
            time.sleep(1.0)


def act(viewer: PageClient, rng: random.Random) -> None:
    """Move the camera, or press a button that there is."""
    labels = [label for label in BUTTONS if label in viewer.controls]
    if labels and rng.random() < 0.5:
        viewer.set(rng.choice(labels), True)
    else:
        viewer.send(**CAMERA | {"position": (rng.uniform(2.0, 5.0), 2.5, 1.45)})


def measure(here: Connection, page: int, end: float, num_rows: int, counts: Counts, log: TextIO) -> list[float]:
    """Write evenly spaced rows of the table; returns the memory of each [MB]."""
    began, memory = time.monotonic(), list[float]()
    for number in range(1, num_rows + 1):
        time.sleep(max(0.0, began + (end - began) * number / num_rows - time.monotonic()))
        memory.append(int(Path(f"/proc/{page}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6)
        here.send("how far")
        steps, viewers, cpu_s = here.recv()
        passed = time.monotonic() - began
        row = (counts.visits, steps, counts.messages, counts.errors)
        tell(log, f"| {passed / 60.0:.0f} | {memory[-1]:.1f} | {cpu_s / passed:.2f} | {viewers} | ")
        tell(log, " | ".join(f"{value:,}" for value in row) + " |\n")
    return memory


def grown(memory: list[float]) -> float:
    """Memory of the last quarter of the time as a share of that of the first one."""
    quarter = max(1, len(memory) // 4)
    return sum(memory[-quarter:]) / sum(memory[:quarter])


def tell(log: TextIO, words: str) -> None:
    """Write to the log, and to the terminal."""
    log.write(words)
    print(words, end="", flush=True)


if __name__ == "__main__":
    main()
