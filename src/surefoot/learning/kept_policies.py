"""Kept policies: the policies and the learning curve of a run, and the validation that selects the best one."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import SUFFIX, with_record
from surefoot.errors import notice
from surefoot.evaluation.protocol import PROTOCOL
from surefoot.learning.run_folder import BEST, CURVE, KEPT, LAST
from surefoot.learning.validation import SCORE_VERSION, Validation, validate


class KeptPolicies:
    """The newest, the best and all validated policies of a run, and its learning curve.

    They are held here; a checkpoint brings them onto the disk together with all else that belongs to them.

    Args:
        validate: looks at a policy.

    Attributes:
        best_score: of the best policy so far.
        definition: what a score counts: by which validation, which version of it, and which protocol.
        files: name in the run folder -> content. Of all validated policies it has the newest one only: the older ones
            are in the folder.
    """

    def __init__(self, validate: Callable[[NetworkAgent], Validation] = validate):
        self.best_score = -np.inf
        self.definition = {
            "validation": getattr(validate, "func", validate).__name__,  # of a function, or of a part of one
            "version": SCORE_VERSION,
            "protocol": PROTOCOL.version,
        }
        self.files: dict[str, bytes] = {}
        self.validate = validate

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint needs beside the files."""
        return {"best_score": self.best_score, "score_definition": self.definition}

    def restore(self, state: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        """Go on with what a checkpoint kept; a best policy whose score counted something else is validated again."""
        self.best_score, self.files = float(state["best_score"]), dict(files)
        if BEST in self.files and state.get("score_definition") != self.definition:
            self.best_score = self.validate(NetworkAgent(self.files[BEST], BEST)).score
            notice(f"{BEST} was validated again, because its score had another definition")

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
