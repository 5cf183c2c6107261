"""What N cores would give an evaluation: the tasks of a results table, given to whichever core is free first.

    python results/scaling/schedule.py lines runs/results.sqlite > results/scaling/lines.csv
    python results/scaling/schedule.py simulate results/scaling/lines.csv

A task holds the lines that share their trials, as `surefoot evaluate --executor` sends them. Its length is measured:
the time that its robots were simulated, settling included. The bench says how much of that a core does in a second.
"""

from __future__ import annotations

import csv
import heapq
import json
import sqlite3
import sys
from collections.abc import Sequence
from pathlib import Path

CORES = (1, 2, 8, 64, 512)
STUDY = 21
"""Policies of `surefoot reproduce`: three algorithms, seven seeds."""
BENCH_CORES, PHYSICS_HZ = 2, 500
"""Of results/bench.json."""
RELAXED_S = 0.32
"""Before a trial the weight of its robot settles on the feet so long [s of the robot's time]; the bench counts it."""
START_S = 3.0
"""Until a new worker has loaded what it needs [s]."""
TASKS = """
SELECT replace(replace(scenario, '_within_limits', ''), '_no_step', '') AS task, round(angle_deg, 3) AS angle_deg,
    count(*) AS trials, round(sum(seconds + (drop_m = 0)), 1) AS robot_s
FROM trials GROUP BY task, angle_deg ORDER BY min(id)
"""


def write_lines(table: str) -> None:
    """Print the tasks of a results table of one policy as CSV."""
    with sqlite3.connect(f"file:{table}?mode=ro", uri=True) as db:
        found = db.execute(TASKS)
        writer = csv.writer(sys.stdout, lineterminator="\n")
        writer.writerow([column[0] for column in found.description])
        writer.writerows(found)


def makespan(seconds: Sequence[float], num_cores: int) -> float:
    """When the last task ends, if each core takes the next one as soon as it is free."""
    free = [START_S] * num_cores
    for each in seconds:
        heapq.heapreplace(free, free[0] + each)
    return max(free)


def simulate(lines: str) -> None:
    """Print when the last task ends, by the number of cores."""
    bench = json.loads((Path(__file__).parent.parent / "bench.json").read_text())
    per_core = bench["bench.physics_steps_per_s"] * bench["bench.trials_over_physics"] / PHYSICS_HZ / BENCH_CORES
    with open(lines, newline="") as stream:
        rows = list(csv.DictReader(stream))
    suite = [(float(row["robot_s"]) + RELAXED_S * int(row["trials"])) / per_core for row in rows]
    print(f"{len(suite)} tasks, {sum(suite):.0f} s of one core, the longest {max(suite):.0f} s")
    for words, tasks in (("one policy", suite), (f"{STUDY} policies", suite * STUDY)):
        print(f"\n{words}\n| cores | in the suite's order [s] | longest first [s] | speed-up |\n|---|---|---|---|")
        alone = makespan(tasks, 1)
        for cores in CORES:
            plain, sorted_ = makespan(tasks, cores), makespan(sorted(tasks, reverse=True), cores)
            print(f"| {cores} | {plain:.0f} | {sorted_:.0f} | {alone / plain:.1f} |")


if __name__ == "__main__":
    {"lines": write_lines, "simulate": simulate}[sys.argv[1]](sys.argv[2])
