"""Soak: 50 viewers of the live page for two hours, who come, watch, push and go, and the memory of the page meanwhile.

Run by `make soak`. The page runs in a process of its own. The viewers are connections as browsers make them, and
messages as browsers send them; each of them stays for a minute or so and is then followed by another one.
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

from page_client import CAMERA, PageClient
from test_guard import free_port

BUTTONS = ("Push", "Reset", "Lift and push")
GROWTH_LIMIT = 0.1
"""Share by which the page's memory may grow from the first quarter of the time to the last one."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--viewers", type=int, default=50)
    parser.add_argument("--stay", type=float, default=60.0, help="mean time that a viewer stays [s]")
    parser.add_argument("--rows", type=int, default=12, help="rows of the table")
    told = parser.parse_args()
    logging.disable()  # of what websockets says of a connection that ends
    here, there = multiprocessing.Pipe()
    page = multiprocessing.get_context("spawn").Process(target=serve, args=(there,), daemon=True)
    page.start()
    address, end = here.recv(), time.monotonic() + 60.0 * told.minutes
    counts = Counts()
    viewers = [
        threading.Thread(target=watch, args=(address, i, end, told.stay, counts), daemon=True)
        for i in range(told.viewers)
    ]
    for viewer in viewers:
        viewer.start()
    rows = measure(here, page.pid or 0, end, told.rows, counts)
    for viewer in viewers:
        viewer.join(20.0)
    here.send("end")
    page.join(30.0)
    print(table(rows))
    quarter = max(1, len(rows) // 4)
    before = sum(row[1] for row in rows[:quarter]) / quarter
    after = sum(row[1] for row in rows[-quarter:]) / quarter
    print(f"\n{told.viewers} viewers, {told.minutes:g} minutes.", end=" ")
    print(f"The memory of the last quarter is {after / before:.2f} of that of the first.")
    sys.exit(after > (1.0 + GROWTH_LIMIT) * before)


class Counts:
    """What the viewers have done and met."""

    visits = messages = errors = 0


def serve(there: Connection) -> None:
    """Show the page until somebody says that it is over; tell its policy steps when asked."""
    from surefoot.viewer.page import Page
    from surefoot.viewer.source import PolicySource

    page = Page(PolicySource("nominal"), port=free_port(), folders=[Path(tempfile.mkdtemp())])
    there.send(page.address)
    while there.recv() != "end":
        there.send((page.player.session.num_steps, len(page.server.get_clients())))
    page.close()


def watch(address: str, number: int, end: float, stay: float, counts: Counts) -> None:
    """One place of a viewer, taken by one after the other, each for half to one and a half of a time [s]."""
    rng = random.Random(number)
    while time.monotonic() < end:
        try:
            with PageClient(address) as viewer:
                counts.visits += 1
                leaves = min(end, time.monotonic() + stay * rng.uniform(0.5, 1.5))
                while time.monotonic() < leaves:
                    if len(viewer.controls) < 10:
                        viewer.listen(1.0)
                        continue
                    counts.messages += viewer.skip(1.0)
                    if rng.random() < 0.02:
                        act(viewer, rng)
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


def measure(here: Connection, page: int, end: float, num_rows: int, counts: Counts) -> list[tuple[float, ...]]:
    """(minutes, MB, viewers, visits, policy steps, messages, errors) at evenly spaced times."""
    began, rows = time.monotonic(), list[tuple[float, ...]]()
    for number in range(1, num_rows + 1):
        time.sleep(max(0.0, began + (end - began) * number / num_rows - time.monotonic()))
        resident = int(Path(f"/proc/{page}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        here.send("how far")
        steps, viewers = here.recv()
        minutes = (time.monotonic() - began) / 60.0
        rows.append((minutes, resident / 1e6, viewers, counts.visits, steps, counts.messages, counts.errors))
        print(rows[-1], file=sys.stderr, flush=True)
    return rows


def table(rows: list[tuple[float, ...]]) -> str:
    """The rows as Markdown."""
    names = ("minutes", "memory [MB]", "viewers", "visits so far", "policy steps", "messages heard", "errors")
    lines = ["| " + " | ".join(names) + " |", "|" + "---:|" * len(names)]
    return "\n".join(lines + ["| " + " | ".join(f"{value:,.0f}" for value in row) + " |" for row in rows])


if __name__ == "__main__":
    main()
