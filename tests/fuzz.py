"""Fuzz: feed surefoot 100,000 damaged files of every format that it reads, for an hour at most, and print a table.

Run by `make fuzz`. Every case is made from its format's name and its number alone, so that
`python tests/fuzz.py --case "config.json" 1234` shows a single one again.
"""

from __future__ import annotations

import argparse
import sys
import time

from fuzzing.run import ACCEPTED, CLEAN, cases, run_guarded, table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--case", nargs=2, metavar=("FORMAT", "NUMBER"), help="run this case and show its traceback")
    told = parser.parse_args()
    if told.case:
        _show(told.case[0], int(told.case[1]))
        return
    began = time.monotonic()
    found = run_guarded(cases(told.cases, told.first), 60.0 * told.minutes)
    print(table(found))
    print(f"\n{(time.monotonic() - began) / 60.0:.0f} minutes, first case {told.first}")
    if any(set(counts) - {CLEAN, ACCEPTED} for counts in found.values()):
        sys.exit(1)


def _show(name: str, number: int) -> None:
    import random
    import tempfile
    from pathlib import Path

    from fuzzing.formats import FORMATS

    with tempfile.TemporaryDirectory() as folder:
        FORMATS[name].attempt(random.Random(f"{name} {number}"), Path(folder))


if __name__ == "__main__":
    main()
