"""Results: a typed table on disk of every trial and every threshold. SQLite: one file, safe to kill at any moment.

Rows are keyed by the policy's digest and by the setup's (robot, physics, protocol), so that an interrupted
evaluation goes on where it was, and a changed robot never answers for an old one.
"""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import json
import math
import sqlite3
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import mujoco

import surefoot
from surefoot.agents.agent import Named
from surefoot.agents.controllers.step_times import Timing
from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.scenarios import Line, Scenario, from_json
from surefoot.evaluation.setup import Setup
from surefoot.evaluation.threshold_search import Threshold
from surefoot.evaluation.trial_json import scenario_to_json, trial_from_json, trial_to_json
from surefoot.evaluation.trials import Trial

SCHEMA = 2
"""Version of the tables, in SQLite's `user_version`."""
COMMIT_S = 0.5
"""At most this much work is lost when the process is killed."""

_OUTCOME_TYPES = {"bool": "INTEGER", "int": "INTEGER", "float": "REAL", "str": "TEXT", "tuple[float, ...]": "TEXT"}
_OUTCOME = {field.name: str(field.type) for field in dataclasses.fields(Outcome)}
_OUTCOME_COLUMNS = ", ".join(_OUTCOME)

_TABLES = f"""
CREATE TABLE IF NOT EXISTS policies (
    policy TEXT PRIMARY KEY, name TEXT NOT NULL, contract TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS trials (
    id INTEGER PRIMARY KEY,
    policy TEXT NOT NULL, setup TEXT NOT NULL,
    scenario TEXT NOT NULL, body TEXT NOT NULL, angle_deg REAL, impulse_Ns REAL NOT NULL, drop_m REAL NOT NULL,
    seed INTEGER NOT NULL, whole INTEGER NOT NULL, trial TEXT NOT NULL,
    {", ".join(f"{name} {_OUTCOME_TYPES[kind]}" for name, kind in _OUTCOME.items())},
    surefoot TEXT NOT NULL, mujoco TEXT NOT NULL,
    UNIQUE (policy, setup, trial)
);
CREATE TABLE IF NOT EXISTS scenarios (
    policy TEXT NOT NULL, setup TEXT NOT NULL, scenario TEXT NOT NULL, definition TEXT NOT NULL, wall_s REAL NOT NULL,
    UNIQUE (policy, setup, scenario)
);
CREATE TABLE IF NOT EXISTS thresholds (
    policy TEXT NOT NULL, setup TEXT NOT NULL,
    scenario TEXT NOT NULL, direction TEXT NOT NULL, angle_rad REAL NOT NULL,
    size REAL NOT NULL, unit TEXT NOT NULL, trials INTEGER NOT NULL, recovered INTEGER NOT NULL, low REAL NOT NULL,
    high REAL NOT NULL, limited_by TEXT NOT NULL, definition TEXT NOT NULL,
    UNIQUE (policy, setup, scenario, direction)
);
CREATE TABLE IF NOT EXISTS controllers (
    policy TEXT NOT NULL, setup TEXT NOT NULL, timing TEXT NOT NULL, UNIQUE (policy, setup)
);
"""


def _latest(table: str) -> str:
    """Condition on rows joined with `policies`: of each name the policy and setup that wrote last.

    A policy that was learned anew bears the name of the old one, whose rows are still there.
    """
    last = f"SELECT max({table}.rowid) FROM {table} JOIN policies USING (policy) GROUP BY name"
    return f"(policy, setup) IN (SELECT policy, setup FROM {table} WHERE rowid IN ({last}))"


EXPORT_SUFFIXES = (".csv", ".parquet")
_EXPORTS = {
    "policies": "SELECT * FROM policies",
    "trials": "SELECT name, trials.* FROM trials JOIN policies USING (policy) ORDER BY name, id",
    "thresholds": "SELECT name, thresholds.* FROM thresholds JOIN policies USING (policy) "
    f"WHERE {_latest('thresholds')} ORDER BY name, scenario, angle_rad",
    "scenarios": "SELECT name, scenarios.* FROM scenarios JOIN policies USING (policy) "
    f"WHERE {_latest('scenarios')} ORDER BY name, scenario",
}


Key = tuple[str, str]
"""Digests of a policy and of a setup."""


@dataclass(frozen=True)
class Row:
    """A trial as it stands in the table: enough to run it again."""

    policy_name: str
    policy: str
    setup: str
    scenario: str
    trial: Trial
    outcome: Outcome


class Results:
    """One results file, opened for appending; a context manager.

    Args:
        path: of the file, or ":memory:".

    Raises:
        UserError: the file is not a results table, is damaged, or is one of another version; it is left as it is.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        try:
            self._db = sqlite3.connect(path, timeout=60.0)
            version = self._db.execute("PRAGMA user_version").fetchone()[0]
            tables = {name for (name,) in self._db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if tables and version != SCHEMA:
                raise UserError(f"{path} is a results table of version {version}, not {SCHEMA}; give another file")
            damage = self._db.execute("PRAGMA quick_check(1)").fetchone()[0]
            if damage != "ok":
                raise UserError(f"cannot use {path} as a results table: {' '.join(damage.split())}")
            self._db.executescript(_TABLES)
            self._db.execute(f"PRAGMA user_version = {SCHEMA}")
            self._db.commit()
        except sqlite3.Error as error:
            raise UserError(f"cannot use {path} as a results table: {error}") from error

    def __enter__(self) -> Results:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        self.close()

    def close(self) -> None:
        """Commit what is there."""
        self._db.commit()
        self._db.close()

    def trials_of(self, policy: Named) -> TrialStore:
        """The policy's trials, as the evaluation's store."""
        row = (policy.digest, policy.name, policy.contract.to_json())
        self._db.execute("INSERT OR REPLACE INTO policies VALUES (?, ?, ?)", row)
        return TrialStore(self._db, policy.digest, setup_digest(policy.contract.robot))

    def add_thresholds(self, policy: Named, thresholds: Iterable[Threshold]) -> None:
        """Keep what was found, in place of what was found before along the same lines."""
        key = (policy.digest, setup_digest(policy.contract.robot))
        rows = [
            (
                *key, t.line.scenario.name, t.line.name, t.line.angle, t.size, t.line.scenario.unit, t.trials,
                t.recovered, t.low, t.high, t.limited_by, scenario_to_json(t.line.scenario),
            )
            for t in thresholds
        ]  # fmt: skip
        self._db.executemany(f"INSERT OR REPLACE INTO thresholds VALUES ({', '.join('?' * 13)})", rows)
        self._db.commit()

    def add_scenarios(self, policy: Named, scenarios: Iterable[Scenario], wall_s: float) -> None:
        """Note that these have been run to their end, in so many seconds altogether."""
        key = (policy.digest, setup_digest(policy.contract.robot))
        rows = [(*key, scenario.name, scenario_to_json(scenario), wall_s) for scenario in scenarios]
        self._db.executemany("INSERT OR REPLACE INTO scenarios VALUES (?, ?, ?, ?, ?)", rows)
        self._db.commit()

    def add_timing(self, policy: Named, timing: Timing) -> None:
        """Keep how long a controller's steps took, in place of what was kept before."""
        key = (policy.digest, setup_digest(policy.contract.robot))
        self._db.execute("INSERT OR REPLACE INTO controllers VALUES (?, ?, ?)", (*key, json.dumps(asdict(timing))))
        self._db.commit()

    def timing(self, key: Key) -> Timing | None:
        """A controller's times per control step; None for policies."""
        row = self._db.execute("SELECT timing FROM controllers WHERE policy = ? AND setup = ?", key).fetchone()
        return Timing(**json.loads(row[0])) if row else None

    def policies(self) -> dict[str, tuple[str, str]]:
        """Name -> (digest, contract as JSON) of every policy in the table."""
        return {name: (digest, text) for digest, name, text in self._db.execute("SELECT * FROM policies")}

    def thresholds_of(self, policy_name: str) -> list[Threshold]:
        """The thresholds of the policy of this name, as they were found."""
        cursor = self._db.execute(
            "SELECT thresholds.* FROM thresholds JOIN policies USING (policy)"
            f" WHERE name = ? AND {_latest('thresholds')} ORDER BY scenario, angle_rad",
            (policy_name,),
        )
        return [_threshold(values) for values in _as_dicts(cursor)]

    def fixed_outcomes(self, policy_name: str) -> dict[str, dict[Trial, Outcome]]:
        """Outcomes of the scenarios in which nothing is searched, by scenario."""
        found: dict[str, dict[Trial, Outcome]] = {}
        stores: dict[Key, TrialStore] = {}
        for policy, setup, name, definition, _ in self._db.execute(
            f"SELECT scenarios.* FROM scenarios JOIN policies USING (policy) WHERE name = ? AND {_latest('scenarios')}",
            (policy_name,),
        ).fetchall():
            scenario = from_json(json.loads(definition))
            if not scenario.search:
                known = stores.get((policy, setup)) or self.outcomes((policy, setup))
                stores[policy, setup] = known
                asked = [trial for line in scenario.lines() for trial in line.fixed_trials()]
                found[name] = {trial: outcome for trial in asked if (outcome := known.get(trial))}
        return found

    def evaluated(self) -> list[tuple[Key, str, str]]:
        """Key, name and contract as JSON of every policy with a finished evaluation, the last one of each name."""
        rows = self._db.execute(
            "SELECT DISTINCT policy, setup, name, contract FROM scenarios JOIN policies USING (policy)"
            f" WHERE {_latest('scenarios')} ORDER BY name"
        )
        return [((policy, setup), name, contract) for policy, setup, name, contract in rows]

    def outcomes(self, key: Key) -> TrialStore:
        """All outcomes of one policy under one setup."""
        return TrialStore(self._db, *key)

    def query(self, sql: str, *values: Any) -> list[dict[str, Any]]:
        """Rows of a SELECT, for reports."""
        return _as_dicts(self._db.execute(sql, values))

    def audit(self, policy: Named) -> tuple[float, float]:
        """Largest share of a torque and of a speed limit that any of the policy's trials used."""
        return self._db.execute(
            "SELECT max(torque_ratio), max(speed_ratio) FROM trials WHERE policy = ? AND setup = ?",
            (policy.digest, setup_digest(policy.contract.robot)),
        ).fetchone()

    def row(self, row_id: int) -> Row:
        """One trial by the `id` of its row.

        Raises:
            UserError: there is no such row.
        """
        cursor = self._db.execute(
            f"SELECT name, policy, setup, scenario, trial, {_OUTCOME_COLUMNS} FROM trials JOIN policies USING (policy)"
            " WHERE id = ?",
            (row_id,),
        )
        values = cursor.fetchone()
        if values is None:
            last = self._db.execute("SELECT max(id) FROM trials").fetchone()[0] or 0
            raise UserError(f"{self.path} has no row {row_id}; valid: 1 to {last}")
        name, policy, setup, scenario, trial, *outcome = values
        return Row(name, policy, setup, scenario, trial_from_json(trial), _outcome(outcome))

    def export(self, table: str, path: str | Path) -> None:
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
        rows = _as_dicts(self._db.execute(_EXPORTS[table]))
        try:
            write(pyarrow.Table.from_pylist(rows), str(path))
        except OSError as error:
            raise UserError(f"cannot write {path}: {error}") from error


class TrialStore:
    """Outcomes of one policy's trials under one setup."""

    def __init__(self, db: sqlite3.Connection, policy: str, setup: str):
        self._db = db
        self._key = (policy, setup)
        self._versions = (surefoot.__version__, mujoco.__version__)
        self._committed = time.monotonic()
        rows = db.execute(f"SELECT trial, {_OUTCOME_COLUMNS} FROM trials WHERE policy = ? AND setup = ?", self._key)
        self._known = {trial_from_json(trial): _outcome(outcome) for trial, *outcome in rows}

    def get(self, trial: Trial) -> Outcome | None:
        return self._known.get(trial)

    def put(self, trial: Trial, outcome: Outcome, scenario: str = "") -> None:
        self._known[trial] = outcome
        push = trial.push
        x, y, _ = push.direction
        angle = math.degrees(math.atan2(y, x)) % 360.0 if x or y else None
        values = (getattr(outcome, name) for name in _OUTCOME)
        row = (
            *self._key, scenario, push.body, angle, push.impulse, trial.drop.height if trial.drop else 0.0, trial.seed,
            int(trial.full_length), trial_to_json(trial),
            *(json.dumps(value) if isinstance(value, tuple) else value for value in values), *self._versions,
        )  # fmt: skip
        self._db.execute(f"INSERT OR REPLACE INTO trials VALUES (NULL, {', '.join('?' * len(row))})", row)
        if time.monotonic() - self._committed > COMMIT_S:
            self._db.commit()
            self._committed = time.monotonic()


def open_results(path: str | Path) -> Results:
    """A results table that is there already, to read from.

    Raises:
        UserError: it is not there, or not a results table.
    """
    if not Path(path).is_file():
        raise UserError(f"there is no results table {path}; surefoot evaluate --results writes one")
    return Results(path)


def check_export(path: str | Path) -> None:
    """Raises UserError: the suffix names no format to export to."""
    suffix = Path(path).suffix
    if suffix not in EXPORT_SUFFIXES:
        raise UserError(f"unknown format '{suffix}' of {path}; valid: {', '.join(EXPORT_SUFFIXES)}")


def read_thresholds(path: str | Path) -> dict[str, list[Threshold]]:
    """The exported thresholds of every policy in a .csv file, by the policy's name.

    Raises:
        UserError: the file is missing or is not such a table.
    """
    found: dict[str, list[Threshold]] = {}
    try:
        with Path(path).open(newline="") as stream:
            for row in csv.DictReader(stream):
                found.setdefault(row["name"], []).append(_threshold(row))
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror or error}") from error
    except (KeyError, ValueError, TypeError) as error:
        raise UserError(f"{path} is not a table of thresholds: {error}") from error
    return found


def setup_digest(robot: str) -> str:
    """Names what an outcome depends on beside the policy: robot, physics engine, protocol."""
    return hashlib.sha256(str(Setup.now(robot)).encode()).hexdigest()


def _outcome(values: Sequence[Any]) -> Outcome:
    readers: dict[str, Callable[[Any], Any]] = {
        "bool": bool,
        "float": lambda value: float("nan") if value is None else value,  # SQLite keeps NaN as NULL
        "tuple[float, ...]": lambda text: tuple(json.loads(text)),
    }
    pairs = zip(_OUTCOME.items(), values, strict=True)
    restored: dict[str, Any] = {name: readers.get(kind, lambda value: value)(value) for (name, kind), value in pairs}
    return Outcome(**restored)


def _as_dicts(cursor: sqlite3.Cursor) -> list[dict[str, Any]]:
    names = [column[0] for column in cursor.description]
    return [dict(zip(names, row, strict=True)) for row in cursor]


def _threshold(row: dict[str, Any]) -> Threshold:
    line = Line(from_json(json.loads(row["definition"])), row["direction"], float(row["angle_rad"]))
    size, low, high = (float(row[key]) for key in ("size", "low", "high"))
    return Threshold(line, size, int(row["trials"]), int(row["recovered"]), low, high, row["limited_by"])
