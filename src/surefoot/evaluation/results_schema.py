"""The schema of results tables: their columns, and how rows become outcomes and thresholds."""

from __future__ import annotations

import dataclasses
import json
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from surefoot.checks import check_number, check_text, parse_json, shortened
from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.protocol import PROTOCOL, Protocol, protocol_for
from surefoot.evaluation.scenario_file import stored_scenario
from surefoot.evaluation.scenarios import Line
from surefoot.evaluation.setup import Setup
from surefoot.evaluation.threshold_search import Threshold
from surefoot.physics.engines import DEFAULT_ENGINE, ENGINES
from surefoot.robots import load_robot

SCHEMA = 4
"""Version of the tables, in SQLite's `user_version`."""

MAX_TRIALS, MAX_SIZE, MAX_ANGLE, MAX_WORD = 10_000, 100_000.0, 10.0, 60
"""Of a threshold that is read: its trials, its size, its direction's angle [rad], and the length of its words."""

SETUP_COLUMNS = tuple(field.name for field in dataclasses.fields(Setup))
KEY = ", ".join(("policy", *SETUP_COLUMNS))
"""The columns of a `Key`, by which every row is found."""
IS_KEY = " AND ".join(f"{column} = ?" for column in ("policy", *SETUP_COLUMNS))
"""Condition on the rows of one key."""

OUTCOME = {field.name: str(field.type) for field in dataclasses.fields(Outcome)}
"""Column -> type of the field."""
OUTCOME_COLUMNS = ", ".join(OUTCOME)
_OUTCOME_TYPES = {"bool": "INTEGER", "int": "INTEGER", "float": "REAL", "str": "TEXT", "tuple[float, ...]": "TEXT"}

_KEY_TYPES = (
    "policy TEXT NOT NULL, protocol INTEGER NOT NULL, robot TEXT NOT NULL, robot_fingerprint TEXT NOT NULL,"
    " engine TEXT NOT NULL"
)
TABLES = f"""
CREATE TABLE IF NOT EXISTS policies (
    policy TEXT PRIMARY KEY, name TEXT NOT NULL, contract TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS trials (
    id INTEGER PRIMARY KEY,
    {_KEY_TYPES},
    scenario TEXT NOT NULL, body TEXT NOT NULL, angle_deg REAL, impulse_Ns REAL NOT NULL, drop_m REAL NOT NULL,
    seed INTEGER NOT NULL, full_length INTEGER NOT NULL, trial TEXT NOT NULL,
    {", ".join(f"{name} {_OUTCOME_TYPES[kind]}" for name, kind in OUTCOME.items())},
    surefoot TEXT NOT NULL,
    UNIQUE ({KEY}, trial)
);
CREATE TABLE IF NOT EXISTS scenarios (
    {_KEY_TYPES},
    scenario TEXT NOT NULL, definition TEXT NOT NULL, wall_s REAL NOT NULL,
    UNIQUE ({KEY}, scenario)
);
CREATE TABLE IF NOT EXISTS thresholds (
    {_KEY_TYPES},
    scenario TEXT NOT NULL, direction TEXT NOT NULL, angle_rad REAL NOT NULL,
    size REAL NOT NULL, unit TEXT NOT NULL, trials INTEGER NOT NULL, recovered INTEGER NOT NULL, low REAL NOT NULL,
    high REAL NOT NULL, limited_by TEXT NOT NULL, definition TEXT NOT NULL,
    UNIQUE ({KEY}, scenario, direction)
);
CREATE TABLE IF NOT EXISTS controllers (
    {_KEY_TYPES},
    timing TEXT NOT NULL, UNIQUE ({KEY})
);
"""


class Key(NamedTuple):
    """The agent of results, and the way in which they were measured.

    Attributes:
        agent: digest of the policy or controller.
        setup: all else that they depend on.
    """

    agent: str
    setup: Setup

    def values(self) -> tuple[Any, ...]:
        """The values of the columns `KEY`."""
        return (self.agent, *dataclasses.astuple(self.setup))

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Key:
        """The key of a row by its columns' names."""
        return cls(
            row["policy"],
            Setup(int(row["protocol"]), *(str(row[column]) for column in SETUP_COLUMNS[1:])),
        )


def engine_word(table: str) -> str:
    """SQL for `Setup.engine_word` of a row."""
    others = ", ".join(f"'{name}'" for name in ENGINES)
    word = f"substr({table}.engine, 1, instr({table}.engine || ' ', ' ') - 1)"
    return f"CASE WHEN {word} IN ({others}) THEN {word} ELSE '{DEFAULT_ENGINE}' END"


def latest(table: str) -> str:
    """Condition on rows joined with `policies`: of each name, robot and engine the policy and setup that wrote last.

    A policy that was learned anew bears the name of the old one, whose rows are still there.
    """
    groups = f"name, {table}.robot, {engine_word(table)}"
    last = f"SELECT max({table}.rowid) FROM {table} JOIN policies USING (policy) GROUP BY {groups}"
    return f"({KEY}) IN (SELECT {KEY} FROM {table} WHERE rowid IN ({last}))"


def insert(db: sqlite3.Connection, table: str, rows: Sequence[Sequence[Any]]) -> None:
    """Write rows of all columns, in the place of those with the same key."""
    for row in rows:
        db.execute(f"INSERT OR REPLACE INTO {table} VALUES ({', '.join('?' * len(row))})", row)


def as_dicts(cursor: sqlite3.Cursor) -> Iterator[dict[str, Any]]:
    """Rows by the names of their columns."""
    names = [column[0] for column in cursor.description]
    return (dict(zip(names, row, strict=True)) for row in cursor)


def outcome_values(outcome: Outcome) -> tuple[Any, ...]:
    """Return the values of the columns of an outcome."""
    values = (getattr(outcome, name) for name in OUTCOME)
    return tuple(json.dumps(value) if isinstance(value, tuple) else value for value in values)


def outcome_of(values: Sequence[Any]) -> Outcome:
    """The inverse of `outcome_values`.

    Raises:
        UserError, TypeError: they are no such values.
    """
    readers: dict[str, Callable[[Any], Any]] = {
        "bool": bool,
        "float": lambda value: float("nan") if value is None else value,  # SQLite keeps NaN as NULL
        "tuple[float, ...]": _numbers,
    }
    pairs = zip(OUTCOME.items(), values, strict=True)
    restored: dict[str, Any] = {name: readers.get(kind, lambda value: value)(value) for (name, kind), value in pairs}
    return Outcome(**restored)


def _numbers(text: str) -> tuple[float, ...]:
    """Numbers of a JSON list; they may be NaN."""
    values = parse_json(text, "a list of numbers")
    if not isinstance(values, list) or not all(type(value) in (int, float) for value in values):
        raise UserError(f"a list of numbers is needed, not {shortened(text)}")
    return tuple(values)


def threshold_of(row: Mapping[str, Any]) -> Threshold:
    """The threshold of a row by its columns' names, whose values may be text.

    Raises:
        KeyError, ValueError, TypeError: it is no such row.
    """
    scenario = stored_scenario(row["definition"])
    direction = check_text("direction", row["direction"], MAX_WORD)
    angle = check_number("angle_rad", float(row["angle_rad"]), -MAX_ANGLE, MAX_ANGLE)
    line = Line(scenario, direction, angle, _protocol_of(row.get("robot")))
    size = check_number("size", float(row["size"]), 0.0, MAX_SIZE)
    trials = int(check_number("trials", int(row["trials"]), 0, MAX_TRIALS))
    recovered = int(check_number("recovered", int(row["recovered"]), 0, trials))
    low, high = (check_number(key, float(row[key]), 0.0, 1.0) for key in ("low", "high"))
    limited_by = check_text("limited_by", row["limited_by"], MAX_WORD)
    return Threshold(line, size, trials, recovered, low, high, limited_by)


def _protocol_of(robot: str | None) -> Protocol:
    """The protocol scaled to a row's robot; that of the paper's robot where this robot cannot be had."""
    try:
        return protocol_for(load_robot(robot)) if robot else PROTOCOL
    except UserError:
        return PROTOCOL
