"""Results: a typed table on disk of every trial and every threshold. SQLite: one file, safe to kill at any moment.

Rows are keyed by the policy's digest and by the setup's (robot, physics, protocol), so that an interrupted
evaluation goes on where it was, and a changed robot never answers for an old one.
"""

from __future__ import annotations

import csv
import hashlib
import sqlite3
import time
from collections.abc import Iterable
from dataclasses import astuple
from pathlib import Path
from types import TracebackType

import mujoco

import surefoot
from surefoot import trials
from surefoot.disturbance import Push
from surefoot.errors import UserError
from surefoot.evaluation import Line, Threshold
from surefoot.policy import Policy
from surefoot.robot import load_robot
from surefoot.trials import Outcome, Trial

SCHEMA = 1
"""Version of the tables, in SQLite's `user_version`."""
COMMIT_S = 0.5
"""At most this much work is lost when the process is killed."""

_TABLES = """
CREATE TABLE IF NOT EXISTS policies (
    policy TEXT PRIMARY KEY, name TEXT NOT NULL, contract TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS trials (
    id INTEGER PRIMARY KEY,
    policy TEXT NOT NULL, setup TEXT NOT NULL,
    body TEXT NOT NULL, x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL,
    impulse_Ns REAL NOT NULL, start_s REAL NOT NULL, duration_s REAL NOT NULL,
    seed INTEGER NOT NULL, whole INTEGER NOT NULL,
    recovered INTEGER NOT NULL, reason TEXT NOT NULL, seconds REAL NOT NULL, foot_shift_m REAL NOT NULL,
    com_speed_m_s REAL, torque_ratio REAL NOT NULL, speed_ratio REAL NOT NULL,
    surefoot TEXT NOT NULL, mujoco TEXT NOT NULL,
    UNIQUE (policy, setup, body, x, y, z, impulse_Ns, start_s, duration_s, seed, whole)
);
CREATE TABLE IF NOT EXISTS thresholds (
    policy TEXT NOT NULL, setup TEXT NOT NULL,
    direction TEXT NOT NULL, body TEXT NOT NULL, angle_rad REAL NOT NULL, duration_s REAL NOT NULL,
    without_step INTEGER NOT NULL,
    impulse_Ns REAL NOT NULL, trials INTEGER NOT NULL, recovered INTEGER NOT NULL, low REAL NOT NULL,
    high REAL NOT NULL, limited_by TEXT NOT NULL,
    UNIQUE (policy, setup, body, angle_rad, duration_s, without_step)
);
"""
EXPORT_SUFFIXES = (".csv", ".parquet")
_EXPORTS = {
    "policies": "SELECT * FROM policies",
    "trials": "SELECT name, trials.* FROM trials JOIN policies USING (policy) ORDER BY name, id",
    "thresholds": "SELECT name, thresholds.* FROM thresholds JOIN policies USING (policy) "
    "ORDER BY name, body, without_step, angle_rad",
}


class Results:
    """One results file, opened for appending; a context manager.

    Args:
        path: of the file, or ":memory:".

    Raises:
        UserError: the file is not a results table, or is one of another version; it is left as it is.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        try:
            self._db = sqlite3.connect(path)
            version = self._db.execute("PRAGMA user_version").fetchone()[0]
            tables = {name for (name,) in self._db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if tables and version != SCHEMA:
                raise UserError(f"{path} is a results table of version {version}, not {SCHEMA}; give another file")
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

    def trials_of(self, policy: Policy) -> TrialStore:
        """The policy's trials, as the evaluation's store."""
        row = (policy.digest, policy.name, policy.contract.to_json())
        self._db.execute("INSERT OR REPLACE INTO policies VALUES (?, ?, ?)", row)
        return TrialStore(self._db, policy)

    def add_thresholds(self, policy: Policy, thresholds: Iterable[Threshold]) -> None:
        """Keep what was found, in place of what was found before along the same lines."""
        key = (policy.digest, setup_digest(policy.contract.robot))
        rows = [(*key, *astuple(t.line), *astuple(t)[1:]) for t in thresholds]
        self._db.executemany(f"INSERT OR REPLACE INTO thresholds VALUES ({', '.join('?' * 13)})", rows)
        self._db.commit()

    def thresholds_of(self, policy_name: str) -> list[Threshold]:
        """The thresholds of the policy of this name, as they were found."""
        rows = self._db.execute(
            "SELECT direction, body, angle_rad, duration_s, without_step, impulse_Ns, trials, recovered, low, high,"
            " limited_by FROM thresholds JOIN policies USING (policy) WHERE name = ? ORDER BY body, without_step,"
            " angle_rad",
            (policy_name,),
        )
        return [_threshold(*row) for row in rows]

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
        write = pyarrow.csv.write_csv if Path(path).suffix == ".csv" else pyarrow.parquet.write_table
        cursor = self._db.execute(_EXPORTS[table])
        names = [column[0] for column in cursor.description]
        rows = [dict(zip(names, row, strict=True)) for row in cursor]
        try:
            write(pyarrow.Table.from_pylist(rows), str(path))
        except OSError as error:
            raise UserError(f"cannot write {path}: {error}") from error


class TrialStore:
    """Outcomes of one policy's trials under today's setup."""

    def __init__(self, db: sqlite3.Connection, policy: Policy):
        self._db = db
        self._key = (policy.digest, setup_digest(policy.contract.robot))
        self._versions = (surefoot.__version__, mujoco.__version__)
        self._committed = time.monotonic()
        rows = db.execute(
            "SELECT body, x, y, z, impulse_Ns, start_s, duration_s, seed, whole, recovered, reason, seconds,"
            " foot_shift_m, com_speed_m_s, torque_ratio, speed_ratio FROM trials WHERE policy = ? AND setup = ?",
            self._key,
        )
        self._known = {_trial(*row[:9]): _outcome(*row[9:]) for row in rows}

    def get(self, trial: Trial) -> Outcome | None:
        return self._known.get(trial)

    def put(self, trial: Trial, outcome: Outcome) -> None:
        self._known[trial] = outcome
        push = trial.push
        row = (
            *self._key, push.body, *push.direction, push.impulse, push.start, push.duration, trial.seed,
            int(trial.whole), int(outcome.recovered), outcome.reason, outcome.seconds, outcome.foot_shift,
            outcome.com_speed, outcome.torque_ratio, outcome.speed_ratio, *self._versions,
        )  # fmt: skip
        self._db.execute(f"INSERT OR REPLACE INTO trials VALUES (NULL, {', '.join('?' * len(row))})", row)
        if time.monotonic() - self._committed > COMMIT_S:
            self._db.commit()
            self._committed = time.monotonic()


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
    try:
        with Path(path).open(newline="") as stream:
            rows = list(csv.DictReader(stream))
        found: dict[str, list[Threshold]] = {}
        for row in rows:
            angle, duration, impulse, low, high = (
                float(row[key]) for key in ("angle_rad", "duration_s", "impulse_Ns", "low", "high")
            )
            without_step, num_trials, recovered = (int(row[key]) for key in ("without_step", "trials", "recovered"))
            line = Line(row["direction"], row["body"], angle, duration, bool(without_step))
            threshold = Threshold(line, impulse, num_trials, recovered, low, high, row["limited_by"])
            found.setdefault(row["name"], []).append(threshold)
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror or error}") from error
    except (KeyError, ValueError, TypeError) as error:
        raise UserError(f"{path} is not a table of thresholds: {error}") from error
    return found


def setup_digest(robot: str) -> str:
    """Names what an outcome depends on beside the policy: robot, physics engine, protocol."""
    protocol = {name: value for name, value in vars(trials).items() if name.isupper() and name != "NUM_SLOTS"}
    text = f"{load_robot(robot).xml}{mujoco.__version__}{sorted(protocol.items())}"
    return hashlib.sha256(text.encode()).hexdigest()


def _trial(
    body: str, x: float, y: float, z: float, impulse: float, start: float, duration: float, seed: int, whole: int
) -> Trial:
    return Trial(Push(body, (x, y, z), impulse, start, duration), seed, bool(whole))


def _outcome(recovered: int, reason: str, seconds: float, shift: float, speed: float | None, *ratios: float) -> Outcome:
    torque_ratio, speed_ratio = ratios
    speed = float("nan") if speed is None else speed
    return Outcome(bool(recovered), reason, seconds, shift, speed, torque_ratio, speed_ratio)


def _threshold(
    direction: str, body: str, angle: float, duration: float, without_step: int, impulse: float, num_trials: int,
    recovered: int, low: float, high: float, limited_by: str,
) -> Threshold:  # fmt: skip
    line = Line(direction, body, angle, duration, bool(without_step))
    return Threshold(line, impulse, num_trials, recovered, low, high, limited_by)
