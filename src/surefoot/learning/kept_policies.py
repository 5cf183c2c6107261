"""Kept policies: the policies that a run leaves in its folder, and the validation by which the best one is told."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import with_record
from surefoot.learning.run_folder import KEPT, RunFolder
from surefoot.learning.validation import Validation, validate


class KeptPolicies:
    """The newest, the best and all validated policies of a run.

    Args:
        folder: of the run.
        best_score: of the best policy that it holds.
        validate: looks at a policy.
    """

    def __init__(
        self,
        folder: RunFolder,
        best_score: float = -np.inf,
        validate: Callable[[NetworkAgent], Validation] = validate,
    ):
        self.folder = folder
        self.best_score = best_score
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
        self.folder.save_policy("last", data)
        self.folder.save_policy(f"{KEPT}/{row['minutes']:06.1f}", data)
        if found.score > self.best_score:
            self.best_score = found.score
            self.folder.save_policy("best", data)
        self.folder.append_curve({**row, **found.columns(), **last_columns})
        return found
