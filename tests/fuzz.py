"""Fuzz: feed surefoot 100,000 damaged files of every format that it reads, and print a table.

Run by `make fuzz`. Every case is made from its format's name and its number alone, so that
`python tests/fuzz.py --case "config.json" 1234` shows a single one again. What was found is kept in build/fuzz.json:
who stops it goes on there by the same call.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fuzzing.run import ACCEPTED, CLEAN, Tally, run_guarded, table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--minutes", type=float, default=60.0, help="after which it stops")
    parser.add_argument("--tally", type=Path, default=Path("build/fuzz.json"), help="what was found so far")
    parser.add_argument("--case", nargs=2, metavar=("FORMAT", "NUMBER"), help="run this case and show its traceback")
    told = parser.parse_args()
    if told.case:
        _show(told.case[0], int(told.case[1]))
        return
    tally = Tally(told.tally)
    run_guarded(told.cases, told.minutes, tally)
    print(table(tally.found))
    print(f"\n{tally.next:,} of {told.cases:,} cases in {tally.seconds / 60.0:.0f} minutes")
    if tally.next == told.cases:
        told.tally.unlink()  # the next call begins anew
    sys.exit(any(set(counts) - {CLEAN, ACCEPTED} for counts in tally.found.values()))


def _show(name: str, number: int) -> None:
    import random
    import tempfile

    from fuzzing.formats import FORMATS

    with tempfile.TemporaryDirectory() as folder:
        FORMATS[name].attempt(random.Random(f"{name} {number}"), Path(folder))


if __name__ == "__main__":
    main()
