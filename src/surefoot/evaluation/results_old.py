"""Results of older schemas, copied into today's tables.

Schema 2 named a setup by one digest and fields by other words. Schema 3 did not know by how much a joint's mean speed
exceeds its limit; the copy leaves it out.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import importlib.resources
import sqlite3
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from surefoot.agents.load import usual_robot
from surefoot.checks import parse_json_table
from surefoot.errors import UserError
from surefoot.evaluation.results_schema import SCHEMA, SETUP_COLUMNS, TABLES, as_dicts, insert
from surefoot.evaluation.scenario_file import stored_scenario
from surefoot.evaluation.scenarios import ROOT, canonical_name
from surefoot.evaluation.setup import UNKNOWN_PROTOCOL, Setup
from surefoot.evaluation.trial_json import scenario_to_json, trial_from_json, trial_to_json
from surefoot.evaluation.trials import Trial
from surefoot.robots import load_robot

OLD_SCHEMAS = (2, 3)

_OLD_COLUMNS = {"full_length": "whole"} | {f"quiet_{word}": f"calm_{word}" for word in ("drift", "power", "steps")}
"""Column -> what it was called."""


@functools.cache
def _known_setups() -> dict[str, Setup]:
    file = importlib.resources.files("surefoot.evaluation") / "schema2_setups.toml"
    return {digest: Setup(**values) for digest, values in tomllib.loads(file.read_text()).items()}


def setup_of_digest(digest: str, robot: str, engine: str) -> Setup:
    """The setup that a digest of schema 2 named; one that is told to be unknown and keeps the digest, if none is known.

    Args:
        digest: the row's column `setup`.
        robot: its name, from the policy's contract.
        engine: name and version of the engine, as far as the row tells.
    """
    unknown = Setup(UNKNOWN_PROTOCOL, robot, f"setup {digest}", engine)
    return _known_setups().get(digest, unknown)


def threshold_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of exported thresholds of schema 2 in today's columns; KeyError or ValueError for anything else."""
    robot = usual_robot().name
    setup = setup_of_digest(row["setup"], robot, "unknown")
    name, definition = _scenario(row["scenario"], row["definition"], setup.robot)
    return {**row, **dataclasses.asdict(setup), "scenario": name, "definition": definition}


def copy_to(old: Path, new: str | Path) -> None:
    """Write the rows of a table of an older schema into a new table of today's schema; the old file is left as it is.

    Raises:
        sqlite3.Error, OSError: one cannot be read or the other not written.
    """
    with contextlib.closing(sqlite3.connect(new)) as db:
        copy_into(old, db)


def copy_into(old: Path, db: sqlite3.Connection) -> None:
    """Write the rows of a table of an older schema into an empty database."""
    with contextlib.closing(sqlite3.connect(f"{old.absolute().as_uri()}?mode=ro", uri=True)) as source:
        db.executescript(TABLES)
        is_schema_2 = source.execute("PRAGMA user_version").fetchone()[0] == 2
        setups = _setups(source) if is_schema_2 else {}
        insert(db, "policies", source.execute("SELECT policy, name, contract FROM policies").fetchall())
        for table, columns in _columns(db).items():
            rows = as_dicts(source.execute(f"SELECT * FROM {table} ORDER BY rowid"))
            if is_schema_2:
                rows = (_renewed(row, columns, setups[row["policy"], row["setup"]]) for row in rows)
            insert(db, table, [[row.get(column) for column in columns] for row in rows])
        db.execute(f"PRAGMA user_version = {SCHEMA}")
        db.commit()


def _columns(db: sqlite3.Connection) -> dict[str, list[str]]:
    tables = ("trials", "scenarios", "thresholds", "controllers")
    return {table: [name for _, name, *_ in db.execute(f"PRAGMA table_info({table})")] for table in tables}


def _setups(source: sqlite3.Connection) -> dict[tuple[str, str], Setup]:
    """Digests of policy and setup -> the setup, for all that the tables hold."""
    robots = {digest: str(parse_json_table(text, "a contract")["robot"]) for digest, text in source.execute(
        "SELECT policy, contract FROM policies"
    )}  # fmt: skip
    engines = dict(source.execute("SELECT DISTINCT setup, 'mujoco ' || mujoco FROM trials"))
    keys: set[tuple[str, str]] = set()
    for table in ("trials", "scenarios", "thresholds", "controllers"):
        keys |= set(source.execute(f"SELECT DISTINCT policy, setup FROM {table}"))
    return {
        (policy, setup): setup_of_digest(setup, robots[policy], engines.get(setup, "unknown")) for policy, setup in keys
    }


def _renewed(row: dict[str, Any], columns: list[str], setup: Setup) -> dict[str, Any]:
    """A row of schema 2 by today's columns, as far as it has them."""
    renewed = row | dict(zip(SETUP_COLUMNS, dataclasses.astuple(setup), strict=True))
    if "trial" in row:
        trial = _trial(row["trial"], setup.robot)
        renewed |= {"trial": trial_to_json(trial), "body": trial.push.body}
        renewed["scenario"] = canonical_name(row["scenario"], _root(setup.robot))
    if "definition" in row:
        renewed["scenario"], renewed["definition"] = _scenario(row["scenario"], row["definition"], setup.robot)
    old = _OLD_COLUMNS | {"root_tilt": f"{_root(setup.robot)}_tilt"}
    return {column: renewed.get(column, renewed.get(old.get(column, ""))) for column in columns}


def _trial(text: str, robot: str) -> Trial:
    """The trial of a JSON text, pushed at the body that today's results name."""
    trial = trial_from_json(text)
    if trial.push.body == _root(robot):
        trial = dataclasses.replace(trial, push=dataclasses.replace(trial.push, body=ROOT))
    if trial.preceding and trial.preceding.body == _root(robot):
        trial = dataclasses.replace(trial, preceding=dataclasses.replace(trial.preceding, body=ROOT))
    return trial


def _scenario(name: str, definition: str, robot: str) -> tuple[str, str]:
    """Name and definition of a scenario in today's words."""
    scenario, root = stored_scenario(definition), _root(robot)
    body = ROOT if scenario.body == root else scenario.body
    renewed = dataclasses.replace(scenario, name=canonical_name(scenario.name, root), body=body)
    return canonical_name(name, root), scenario_to_json(renewed)


def _root(robot: str) -> str:
    """The robot's own word for its root; today's word for a robot that is not there any more."""
    try:
        return load_robot(robot).root
    except UserError:
        return ROOT
