"""Results: a typed table on disk of every trial and every threshold. SQLite: one file, safe to kill at any moment.

Rows are keyed by the policy's digest and by the setup (protocol, robot, engine), so that an interrupted evaluation
continues where it was, and results of a changed robot are never mixed with those of the old one.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from surefoot.agents.controllers.step_times import Timing
from surefoot.checks import check_fields, parse_json_table
from surefoot.errors import UserError, notice
from surefoot.evaluation import results_export
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.results_check import check_only_tables, check_results, connect, reading, using
from surefoot.evaluation.results_old import OLD_SCHEMAS, copy_into, copy_to
from surefoot.evaluation.results_schema import (
    IS_KEY,
    KEY,
    OUTCOME,
    SCHEMA,
    TABLES,
    Key,
    as_dicts,
    engine_word,
    insert,
    latest,
    outcome_of,
    threshold_of,
)
from surefoot.evaluation.scenario_file import stored_scenario
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.setup import Setup
from surefoot.evaluation.threshold_search import Threshold
from surefoot.evaluation.trial_json import scenario_to_json, trial_from_json
from surefoot.evaluation.trial_store import Committer, TrialStore
from surefoot.evaluation.trials import Trial
from surefoot.physics.engines import DEFAULT_ENGINE
from surefoot.task.agent import Agent

_AUDIT = f"""
SELECT scenario, count(*) AS trials, sum(reason = 'recovered') AS recovered, sum(reason = 'fell') AS fell,
    sum(reason = 'restless') AS restless, sum(reason = 'tilted') AS tilted, sum(reason = 'diverged') AS diverged,
    sum(reason IN ('raised', 'not finite', 'wrong shape', 'too late')) AS controller,
    max(torque_ratio) AS torque, max(speed_ratio) AS speed,
    max(CASE reason WHEN 'recovered' THEN torque_ratio END) AS torque_recovered,
    max(CASE reason WHEN 'recovered' THEN speed_ratio END) AS speed_recovered
FROM trials WHERE {IS_KEY} GROUP BY scenario ORDER BY min(id)
"""


@dataclass(frozen=True)
class Row:
    """A trial as it stands in the table: enough to run it again."""

    policy_name: str
    key: Key
    scenario: str
    trial: Trial
    outcome: Outcome


class Results:
    """One results file, opened for appending; a context manager.

    A file of an older version is left as it is: its rows are copied into a file of this version beside it, which is
    used instead, or into memory where no file can be written.

    Args:
        path: of the file, or ":memory:".
        engine: name of the physics engine whose results are written, and read unless another one is named.

    Raises:
        UserError: the file is not a results table, is damaged, or is one of another version; it is left as it is.
    """

    def __init__(self, path: str | Path, engine: str = DEFAULT_ENGINE):
        self.path = Path(path)
        self.engine = engine
        with using(path):
            self._db = connect(path)
            check_only_tables(self._db, path)
            version = self._db.execute("PRAGMA user_version").fetchone()[0]
            tables = {name for (name,) in self._db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if tables and version not in (SCHEMA, *OLD_SCHEMAS):
                raise UserError(f"{path} is a results table of version {version}, not {SCHEMA}; give another file")
            damage = self._db.execute("PRAGMA quick_check(1)").fetchone()[0]
            if damage != "ok":
                raise UserError(f"cannot use {path} as a results table: {' '.join(damage.split())}")
            if tables and version in OLD_SCHEMAS:
                self._db.close()
                self.path, self._db = _renewed(self.path, version)
                check_only_tables(self._db, self.path)
            if tables:
                check_results(self._db, path)
            self._db.executescript(TABLES)
            self._db.execute(f"PRAGMA user_version = {SCHEMA}")
            self._db.commit()
        self._committer = Committer(self._db, self.path)

    def __enter__(self) -> Results:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Commit what is there."""
        try:
            self._committer.now()
        finally:
            self._db.close()

    def key_of(self, policy: Agent) -> Key:
        """By which the policy's results are found in today's setup."""
        return Key(policy.digest, Setup.now(policy.contract.robot, self.engine))

    def trials_of(self, policy: Agent) -> TrialStore:
        """The policy's trials, as the evaluation's store."""
        insert(self._db, "policies", [(policy.digest, policy.name, policy.contract.to_json())])
        return self.outcomes(self.key_of(policy))

    def add_thresholds(self, policy: Agent, thresholds: Iterable[Threshold]) -> None:
        """Keep what was found, in place of what was found before along the same lines."""
        key = self.key_of(policy).values()
        rows = [
            (
                *key, t.line.scenario.name, t.line.name, t.line.angle, t.size, t.line.scenario.unit, t.trials,
                t.recovered, t.low, t.high, t.limited_by, scenario_to_json(t.line.scenario),
            )
            for t in thresholds
        ]  # fmt: skip
        insert(self._db, "thresholds", rows)
        self._committer.now()

    def add_scenarios(self, policy: Agent, scenarios: Iterable[Scenario], wall_s: float) -> None:
        """Note that these have been run to their end, in so many seconds altogether."""
        key = self.key_of(policy).values()
        rows = [(*key, scenario.name, scenario_to_json(scenario), wall_s) for scenario in scenarios]
        insert(self._db, "scenarios", rows)
        self._committer.now()

    def add_timing(self, policy: Agent, timing: Timing) -> None:
        """Keep how long a controller's steps took, in place of what was kept before."""
        insert(self._db, "controllers", [(*self.key_of(policy).values(), json.dumps(asdict(timing)))])
        self._committer.now()

    def timing(self, key: Key) -> Timing | None:
        """A controller's times per control step; None for policies."""
        row = self._db.execute(f"SELECT timing FROM controllers WHERE {IS_KEY}", key.values()).fetchone()
        if not row:
            return None
        with reading(self.path):
            values = parse_json_table(row[0], "the times of a controller")
            check_fields(Timing, {key: 0.0 if value != value else value for key, value in values.items()}, "times")
            return Timing(**values)

    def policies(self) -> dict[str, tuple[str, str]]:
        """Name -> (digest, contract as JSON) of every policy in the table."""
        return {name: (digest, text) for digest, name, text in self._db.execute("SELECT * FROM policies")}

    def thresholds_of(self, policy_name: str, engine: str = "", robot: str = "") -> list[Threshold]:
        """The thresholds of the policy of this name, as they were found; of any robot unless one is named."""
        cursor = self._named("thresholds", policy_name, engine, robot, "ORDER BY scenario, angle_rad")
        with reading(self.path):
            return [threshold_of(row) for row in as_dicts(cursor)]

    def fixed_outcomes(self, policy_name: str, engine: str = "", robot: str = "") -> dict[str, dict[Trial, Outcome]]:
        """Outcomes of the scenarios in which nothing is searched, by scenario; of any robot unless one is named."""
        found: dict[str, dict[Trial, Outcome]] = {}
        stores: dict[Key, TrialStore] = {}
        for row in list(as_dicts(self._named("scenarios", policy_name, engine, robot))):
            with reading(self.path):
                key, scenario = Key.of(row), stored_scenario(row["definition"])
            if not scenario.search:
                stores[key] = stores.get(key) or self.outcomes(key)
                asked = [trial for line in scenario.lines() for trial in line.fixed_trials()]
                found[row["scenario"]] = {t: outcome for t in asked if (outcome := stores[key].get(t))}
        return found

    def _named(self, table: str, policy_name: str, engine: str, robot: str, order: str = "") -> sqlite3.Cursor:
        """Rows of a table that were written last under a policy's name, in an engine."""
        return self._db.execute(
            f"SELECT {table}.* FROM {table} JOIN policies USING (policy) WHERE name = ?"
            f" AND {engine_word(table)} = ? AND ? IN ('', {table}.robot) AND {latest(table)} {order}",
            (policy_name, engine or self.engine, robot),
        )

    def evaluated(self) -> list[tuple[Key, str, str]]:
        """Key, name and contract as JSON of every finished evaluation, the last one of each name, robot and engine."""
        cursor = self._db.execute(
            f"SELECT DISTINCT {KEY}, name, contract FROM scenarios JOIN policies USING (policy)"
            f" WHERE {latest('scenarios')} ORDER BY name"
        )
        return [(Key.of(row), row["name"], row["contract"]) for row in as_dicts(cursor)]

    def finished_scenarios(self, policy: Agent) -> set[str]:
        """Names of the scenarios that the policy has been through, in today's setup."""
        sql = f"SELECT scenario FROM scenarios WHERE {IS_KEY}"
        return {name for (name,) in self._db.execute(sql, self.key_of(policy).values())}

    def outcomes(self, key: Key) -> TrialStore:
        """All outcomes of one policy under one setup."""
        return TrialStore(self._db, key, self._committer, self.path)

    def audit_rows(self, key: Key) -> list[dict[str, Any]]:
        """By scenario: how many trials ended how, and the largest shares of the limits that they used."""
        return list(as_dicts(self._db.execute(_AUDIT, key.values())))

    def audit(self, policy: Agent) -> tuple[float, float]:
        """Largest share of a torque and of a speed limit that any of the policy's trials used."""
        sql = f"SELECT max(torque_ratio), max(speed_ratio) FROM trials WHERE {IS_KEY}"
        torque, speed = self._db.execute(sql, self.key_of(policy).values()).fetchone()
        return torque, speed

    def versions(self, key: Key) -> list[str]:
        """Versions of surefoot with which the trials were run."""
        sql = f"SELECT DISTINCT surefoot FROM trials WHERE {IS_KEY} ORDER BY surefoot"
        return [version for (version,) in self._db.execute(sql, key.values())]

    def wall_s(self, key: Key) -> float:
        """Time that the evaluation took [s]."""
        sql = f"SELECT sum(wall_s) FROM (SELECT DISTINCT wall_s FROM scenarios WHERE {IS_KEY})"
        return float(self._db.execute(sql, key.values()).fetchone()[0] or 0.0)

    def row(self, row_id: int) -> Row:
        """One trial by the `id` of its row.

        Raises:
            UserError: there is no such row.
        """
        sql = "SELECT name, trials.* FROM trials JOIN policies USING (policy) WHERE id = ?"
        found = list(as_dicts(self._db.execute(sql, (row_id,))))
        if not found:
            last = self._db.execute("SELECT max(id) FROM trials").fetchone()[0] or 0
            raise UserError(f"{self.path} has no row {row_id}; valid: 1 to {last}")
        row = found[0]
        with reading(self.path):
            outcome = outcome_of([row[name] for name in OUTCOME])
            return Row(row["name"], Key.of(row), row["scenario"], trial_from_json(row["trial"]), outcome)

    def export(self, table: str, path: str | Path) -> None:
        """Write one table to a .csv or .parquet file; see `results_export.export`."""
        results_export.export(self._db, table, path)


def open_results(path: str | Path) -> Results:
    """A results table that is there already, to read from.

    Raises:
        UserError: it is not there, or not a results table.
    """
    if not Path(path).is_file():
        raise UserError(f"there is no results table {path}; surefoot evaluate --results writes one")
    return Results(path)


def _renewed(path: Path, version: int) -> tuple[Path, sqlite3.Connection]:
    """A copy of a table of an older version in today's tables: beside it, or in memory."""
    new = path.with_name(f"{path.stem}-schema{SCHEMA}{path.suffix}")
    if not new.exists():
        part = new.with_name(f".{new.name}.part")
        try:
            part.unlink(missing_ok=True)
            with reading(path):
                copy_to(path, part)
            part.rename(new)
        except (OSError, sqlite3.OperationalError):
            db = connect(":memory:")
            with reading(path):
                copy_into(path, db)
            return path, db
        finally:
            part.unlink(missing_ok=True)
    notice(f"{path} is a results table of version {version}; its copy in version {SCHEMA} is used: {new}")
    return new, connect(new)
