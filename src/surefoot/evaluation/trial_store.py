"""Trial store: outcomes of one agent's trials in a results table, safe from a kill within half a second."""

from __future__ import annotations

import math
import sqlite3
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.results_check import reading, using
from surefoot.evaluation.results_schema import IS_KEY, OUTCOME_COLUMNS, Key, insert, outcome_of, outcome_values
from surefoot.evaluation.trial_json import trial_from_json, trial_to_json
from surefoot.evaluation.trials import Trial
from surefoot.version import __version__

COMMIT_S = 0.1
"""Time from a write to its commit, whether or not more is written [s]."""


class Committer:
    """Commits a database soon after it was written to.

    A thread of its own does it, or whoever writes next if that thread does not get its turn in time.

    Args:
        db: the database; it is shared between threads.
        path: of its file, for errors.
    """

    def __init__(self, db: sqlite3.Connection, path: str | Path):
        self._db = db
        self._path = path
        self._lock = threading.Lock()
        self._timer: threading.Timer | None = None
        self._due = math.inf
        self._error: sqlite3.Error | None = None

    def wrote(self) -> None:
        """Note that something waits to be committed.

        Raises:
            UserError: the last commit failed.
        """
        with self._lock:
            if time.monotonic() > self._due:
                self._commit()
            elif self._timer is None:
                self._due = time.monotonic() + COMMIT_S
                self._timer = threading.Timer(COMMIT_S, self._commit_in_time)
                self._timer.daemon = True
                self._timer.start()
            self._check()

    def now(self) -> None:
        """Commit all that waits.

        Raises:
            UserError: it could not be written, a full disk for example.
        """
        with self._lock:
            self._commit()
            self._check()

    def _commit_in_time(self) -> None:
        with self._lock:
            if time.monotonic() >= self._due:
                self._commit()

    def _commit(self) -> None:
        if self._timer:
            self._timer.cancel()
        self._timer, self._due = None, math.inf
        try:
            self._db.commit()
        except sqlite3.Error as error:
            self._error = error

    def _check(self) -> None:
        if self._error:
            error, self._error = self._error, None
            raise UserError(f"cannot write {self._path}: {error}; all until then is kept") from error


class TrialStore:
    """Outcomes of one policy's trials under one setup.

    Args:
        db: the results table.
        key: key of the agent and setup.
        committer: of the results table.
        path: of the results table, for errors.

    Raises:
        UserError: a row of the table cannot be read.
    """

    def __init__(self, db: sqlite3.Connection, key: Key, committer: Committer, path: str | Path):
        self._db = db
        self._key = key.values()
        self._committer = committer
        self._path = path
        with using(path), reading(path):
            rows = db.execute(f"SELECT trial, {OUTCOME_COLUMNS} FROM trials WHERE {IS_KEY}", self._key)
            self._known = {trial_from_json(trial): outcome_of(outcome) for trial, *outcome in rows}

    @property
    def known(self) -> Mapping[Trial, Outcome]:
        """All outcomes that are known, by trial."""
        return self._known

    def get(self, trial: Trial) -> Outcome | None:
        """The outcome of a trial, if it is known."""
        return self._known.get(trial)

    def put(self, trial: Trial, outcome: Outcome, scenario: str = "") -> None:
        """Keep the outcome of a trial that was run for a scenario.

        Raises:
            UserError: it cannot be written, a full disk for example.
        """
        self._known[trial] = outcome
        push = trial.push
        x, y, _ = push.direction
        angle = math.degrees(math.atan2(y, x)) % 360.0 if x or y else None
        drop = trial.drop.height if trial.drop else 0.0
        row = (
            None, *self._key, scenario, push.body, angle, push.impulse, drop, trial.seed, int(trial.full_length),
            trial_to_json(trial), *outcome_values(outcome), __version__,
        )  # fmt: skip
        try:
            insert(self._db, "trials", [row])
        except sqlite3.Error as error:
            raise UserError(f"cannot write {self._path}: {error}; all until then is kept") from error
        self._committer.wrote()
