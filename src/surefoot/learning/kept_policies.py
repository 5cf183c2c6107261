"""Kept policies: the policies and the learning curve of a run, and the validation by which the best one is told."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping

import numpy as np

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import SUFFIX, with_record
from surefoot.learning.run_folder import BEST, CURVE, KEPT, LAST
from surefoot.learning.validation import Validation, validate


class KeptPolicies:
    """The newest, the best and all validated policies of a run, and its learning curve.

    They are held here; a checkpoint brings them onto the disk together with all else that belongs to them.

    Args:
        best_score: of the best policy so far.
        files: name in the run folder -> content, of a run that goes on.
        validate: looks at a policy.

    Attributes:
        files: the same now. Of all validated policies it has the newest one only: the older ones are in the folder.
    """

    def __init__(
        self,
        best_score: float = -np.inf,
        files: Mapping[str, bytes] | None = None,
        validate: Callable[[NetworkAgent], Validation] = validate,
    ):
        self.best_score = best_score
        self.files = dict(files or {})
        self.validate = validate

    def add(self, data: bytes, row: Mapping[str, float], last_columns: Mapping[str, float]) -> Validation:
        """Validate a policy file, keep it, and add a row to the learning curve.

        Args:
            data: the policy file.
            row: the first columns of the learning curve, with "minutes".
            last_columns: what stands in the row behind the results of the validation.
        """
        found = self.validate(NetworkAgent(data, "validated"))
        # Version 0.1 had "probe" for "validation"; its readers still look for that.
        data = with_record(data, validation=found.record(), probe=found.record())
        best = self.files.get(BEST, data)
        if found.score > self.best_score:
            self.best_score, best = found.score, data
        curve = _with_row(self.files.get(CURVE, b""), {**row, **found.columns(), **last_columns})
        name = f"{KEPT}/{row['minutes']:06.1f}{SUFFIX}"
        self.files = {name: data, LAST: data, BEST: best, CURVE: curve}
        return found


def _with_row(curve: bytes, row: Mapping[str, float]) -> bytes:
    """Return a learning curve with one more row; a new one has the row's columns."""
    known = curve.decode().partition("\n")[0].strip()
    stream = io.StringIO()
    writer = csv.DictWriter(stream, known.split(",") if known else list(row), restval="nan", extrasaction="ignore")
    if not known:
        writer.writeheader()
    writer.writerow({key: f"{value:.6g}" for key, value in row.items()})
    return curve + stream.getvalue().encode()
