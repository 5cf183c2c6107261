"""Results as files for other programs: .csv and .parquet, and the thresholds of a .csv read back."""

from __future__ import annotations

import csv
import io
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from surefoot.checks import MAX_PATH, check_text, read_text
from surefoot.errors import UserError
from surefoot.evaluation.results_old import threshold_row
from surefoot.evaluation.results_schema import Key, as_dicts, latest, threshold_of
from surefoot.evaluation.setup import Measured
from surefoot.evaluation.threshold_search import Threshold
from surefoot.whole_file import write_whole

MAX_CSV_BYTES = 50_000_000
"""Of a table of thresholds."""
EXPORT_SUFFIXES = (".csv", ".parquet")
_EXPORTS = {
    "policies": "SELECT * FROM policies",
    "trials": "SELECT name, trials.* FROM trials JOIN policies USING (policy) ORDER BY name, id",
    "thresholds": "SELECT name, thresholds.* FROM thresholds JOIN policies USING (policy) "
    f"WHERE {latest('thresholds')} ORDER BY name, engine, scenario, angle_rad",
    "scenarios": "SELECT name, scenarios.* FROM scenarios JOIN policies USING (policy) "
    f"WHERE {latest('scenarios')} ORDER BY name, engine, scenario",
}


@dataclass(frozen=True)
class ThresholdRow:
    """A row of exported thresholds.

    Attributes:
        name: of the policy or controller.
        key: its digest, and how it was measured.
        threshold: what was found.
    """

    name: str
    key: Key
    threshold: Threshold


def export(db: sqlite3.Connection, table: str, path: str | Path) -> None:
    """Write one table to a .csv or .parquet file.

    Raises:
        UserError: unknown table or suffix, or the file cannot be written.
    """
    import pyarrow
    import pyarrow.csv
    import pyarrow.parquet

    if table not in _EXPORTS:
        raise UserError(f"unknown table '{table}'; valid: {', '.join(_EXPORTS)}")
    check_export(path)
    write: Callable[..., None] = pyarrow.csv.write_csv
    if Path(path).suffix == ".parquet":
        write = partial(pyarrow.parquet.write_table, compression="zstd", compression_level=15)
    rows = list(as_dicts(db.execute(_EXPORTS[table])))
    written = io.BytesIO()
    write(pyarrow.Table.from_pylist(rows), written)
    write_whole(Path(path), written.getvalue())


def check_export(path: str | Path) -> None:
    """Check that a table can be exported to a file of this suffix.

    Raises:
        UserError: the suffix names no format.
    """
    suffix = Path(path).suffix
    if suffix not in EXPORT_SUFFIXES:
        raise UserError(f"unknown format '{suffix}' of {path}; valid: {', '.join(EXPORT_SUFFIXES)}")


def read_threshold_rows(path: str | Path) -> list[ThresholdRow]:
    """The rows of exported thresholds in a .csv file, of this version or of the last one.

    Raises:
        UserError: the file is missing or is not such a table.
    """
    text = read_text(path, "table", MAX_CSV_BYTES)
    try:
        rows = csv.DictReader(io.StringIO(text, newline=""))
        return [_threshold_row(row) for row in rows]
    except (KeyError, ValueError, TypeError, OverflowError, csv.Error) as error:
        raise UserError(f"{path} is not a table of thresholds: {error}") from error


def read_thresholds(path: str | Path) -> dict[str, list[Threshold]]:
    """The exported thresholds of every policy in a .csv file, by its name in tables.

    If a policy was measured with several robots, the thresholds of one follow those of the other.

    Raises:
        UserError: the file is missing or is not such a table.
    """
    found: dict[str, list[Threshold]] = {}
    for measured, thresholds in read_measured([path]).items():
        found.setdefault(measured.shown, []).extend(thresholds)
    return found


def read_measured(paths: Sequence[str | Path]) -> dict[Measured, list[Threshold]]:
    """The exported thresholds of several .csv files, by policy, robot and engine.

    Of a policy that stands in several files, with the same robot and engine, the rows of the first file count.

    Raises:
        UserError: a file is missing or is not such a table.
    """
    found: dict[Measured, list[Threshold]] = {}
    for path in paths:
        of_file: dict[Measured, list[Threshold]] = {}
        for row in read_threshold_rows(path):
            setup = row.key.setup
            of_file.setdefault(Measured(row.name, setup.robot, setup.engine_word), []).append(row.threshold)
        found |= {key: rows for key, rows in of_file.items() if key not in found}
    return found


def _threshold_row(row: Mapping[str, Any]) -> ThresholdRow:
    renewed = threshold_row(row) if "setup" in row else row
    return ThresholdRow(check_text("name", renewed["name"], MAX_PATH), Key.of(renewed), threshold_of(renewed))
