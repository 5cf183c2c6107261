"""Learning curves: the table of a run with one row per validation, read without torch.

The columns keep the names of version 0.1, since committed results and their readers have them: "minutes" and "steps" of
the run, "recovered" and "fell" (shares of the pushes), "within_limits" (recovered with no joint beyond its speed limit;
not in curves of version 0.1), "calm" (share of the whole trials after which the robot stood quietly) and "calm_power"
(median of their mean power [W]), "forward", "left", "backward" and "right" (impulses below which nothing failed [Ns]),
"episode_length" [policy steps] and "episode_return".
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from pathlib import Path

from surefoot.errors import UserError

_PLOTTED = ("minutes", "steps", "recovered")
"""Columns that every curve has."""


def read_curve(path: str | Path) -> list[dict[str, float]]:
    """Return the rows of a learning curve.

    Raises:
        UserError: the file cannot be read as one.
    """
    try:
        with Path(path).open(newline="") as stream:
            return [_numbers(row) for row in csv.DictReader(stream)]
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror or error}") from error
    except (TypeError, ValueError, csv.Error) as error:
        raise UserError(f"{path} is not a learning curve: {error}") from error


def _numbers(row: Mapping[str, str]) -> dict[str, float]:
    """The numbers of a row; ValueError or TypeError for what is no row of a curve."""
    numbers = {key: float(value) for key, value in row.items()}
    wrong = [name for name in _PLOTTED if not math.isfinite(numbers.get(name, math.nan))]
    if wrong:
        raise ValueError(f"a row has no finite number for {wrong[0]}")
    return numbers


def read_curves(folder: str | Path) -> dict[str, list[list[dict[str, float]]]]:
    """Return the learning curves in a folder: algorithm -> runs -> rows.

    Args:
        folder: it holds ALGORITHM-SEED.csv files, or run folders, or is one.

    Raises:
        UserError: there are none, or they cannot be read.
    """
    folder = Path(folder)
    found: dict[str, list[list[dict[str, float]]]] = {}
    for file in sorted([folder / "curve.csv", *folder.glob("*/curve.csv")]):
        if file.exists():
            found.setdefault(_algorithm(file.parent), []).append(read_curve(file))
    for file in [] if found else sorted(folder.glob("*.csv")):
        found.setdefault(file.stem.split("-")[0], []).append(read_curve(file))
    if not found:
        raise UserError(f"no learning curves in {folder}: neither run folders nor ALGORITHM-SEED.csv")
    return found


def _algorithm(run: Path) -> str:
    file = run / "config.json"
    try:
        return json.loads(file.read_text())["algorithm"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"cannot read the algorithm of {file}: {error}") from error
