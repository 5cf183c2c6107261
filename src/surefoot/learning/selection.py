"""Selection: the choice of the best policy of several runs, by more held-out trials than a training can afford."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import SUFFIX, mean_bytes, with_record
from surefoot.errors import UserError
from surefoot.learning.run_folder import KEPT
from surefoot.learning.stages import run_folders
from surefoot.learning.suite_validation import validate_suite
from surefoot.learning.validation import MAX_SCORE, Validation, validate
from surefoot.whole_file import write_whole

FIRST_ROUND = 1
"""A training validates with round 0, by which its best policy was chosen already."""


@dataclass(frozen=True)
class Candidate:
    """A policy of a run, and what held-out trials say of it.

    Attributes:
        file: of the policy.
        validations: one of each round.
        suites: the share of the suite's trials that succeeded by scenario, of each round.
    """

    file: Path
    validations: tuple[Validation, ...]
    suites: tuple[dict[str, float], ...]

    @property
    def recovered(self) -> float:
        """Share of all pushes in the mean of the rounds."""
        return sum(found.recovered for found in self.validations) / len(self.validations)

    @property
    def within_limits(self) -> float:
        """Share of all pushes that it recovers from within the joints' speed limits, in the mean of the rounds."""
        return sum(found.within_limits for found in self.validations) / len(self.validations)

    @property
    def quiet(self) -> float:
        """Share of the whole trials after which the robot stood quietly, in the mean of the rounds."""
        return sum(found.quiet for found in self.validations) / len(self.validations)

    @property
    def rejected(self) -> dict[str, float]:
        """The largest impulse below which nothing failed within limits in any round, by direction name [Ns]."""
        found: dict[str, float] = {}
        for name, impulse in (item for each in self.validations for item in each.rejected_within_limits.items()):
            found[name] = min(impulse, found.get(name, impulse))
        return found

    @property
    def passed(self) -> dict[str, float]:
        """Share of the suite's trials that succeeded, by scenario, in the mean of the rounds."""
        return {name: sum(suite[name] for suite in self.suites) / len(self.suites) for name in self.suites[0]}

    @property
    def score(self) -> float:
        """The score by which candidates are ranked.

        The quick validation sees large pushes at the root and quiet standing, the suite all the rest: they count alike.
        """
        shares = self.passed.values()
        quick = sum(found.score for found in self.validations) / len(self.validations)
        return quick + MAX_SCORE * sum(shares) / len(shares)


def files(runs: Sequence[Path]) -> list[Path]:
    """Return the best and the last policy of run folders; policy files stand for themselves.

    Of a folder of curriculum stages it is the policies of all its stages.

    Raises:
        UserError: there is none.
    """
    folders = [folder for run in runs if run.is_dir() for folder in run_folders(run)]
    found = [folder / f"{name}{SUFFIX}" for folder in folders for name in ("best", "last")]
    found = [file for file in (*found, *(run for run in runs if not run.is_dir())) if file.exists()]
    if not found:
        raise UserError(f"no policies in {', '.join(map(str, runs))}")
    return found


def means(run: Path, minutes: float) -> list[Path]:
    """Write means of the weights of all policies that a run kept within a window of time into its folder.

    Every checkpoint fails at a few isolated push sizes; a mean of policies that are near each
    other fails at few of them.

    Args:
        run: a run folder, or a folder of curriculum stages.
        minutes: length of a window; the next one begins half a window later.

    Returns:
        The files.
    """
    return [file for folder in run_folders(run) for file in _means_of_run(folder, minutes)]


def _means_of_run(run: Path, minutes: float) -> list[Path]:
    kept = sorted((run / KEPT).glob(f"*{SUFFIX}"))
    at = np.array([float(file.name.removesuffix(SUFFIX)) for file in kept])
    found = []
    for begin in np.arange(0.0, at.max(initial=0.0) - 0.5 * minutes, 0.5 * minutes):
        within = [file for file, minute in zip(kept, at, strict=True) if begin <= minute < begin + minutes]
        if len(within) > 1:
            data = mean_bytes([file.read_bytes() for file in within], mean_from_minute=float(begin))
            found.append(run / f"mean-{begin:g}-to-{begin + minutes:g}{SUFFIX}")
            write_whole(found[-1], data)
    return found


def validate_candidate(file: Path, num_rounds: int, data: bytes | None = None) -> Candidate:
    """Run both validations of one policy with sets of trials that its training has not seen.

    Args:
        file: of the policy.
        num_rounds: how many sets.
        data: what is in the file, for a worker that does not see it.
    """
    policy = NetworkAgent(data or file.read_bytes(), file.stem, str(file))
    rounds = range(FIRST_ROUND, FIRST_ROUND + num_rounds)
    found = tuple(validate(policy, round=number) for number in rounds)
    return Candidate(file, found, tuple(validate_suite(policy, round=number) for number in rounds))


def best_candidate(candidates: Sequence[Candidate]) -> Candidate:
    """Return the candidate with the highest score, the first of equals."""
    return max(candidates, key=lambda candidate: candidate.score)


def shipped_bytes(candidate: Candidate) -> bytes:
    """Return the policy's file, with what each round of its validation found in its training record."""
    return with_record(candidate.file.read_bytes(), selection=[found.record() for found in candidate.validations])
