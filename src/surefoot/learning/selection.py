"""Selection: the best of several runs' policies, by more held-out trials than a training has time for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import SUFFIX, mean_bytes, with_record
from surefoot.errors import UserError
from surefoot.learning.exam import examine
from surefoot.learning.probe import MAX_PROBE_SCORE, Probe, probe
from surefoot.learning.run_folder import KEPT, write_whole

FIRST_ROUND = 1
"""A training probes with round 0, by which its best policy was chosen already."""


@dataclass(frozen=True)
class Candidate:
    """A policy of a run, and what held-out trials say of it."""

    file: Path
    probes: tuple[Probe, ...]
    exams: tuple[dict[str, float], ...]

    @property
    def recovered(self) -> float:
        return sum(probe.recovered for probe in self.probes) / len(self.probes)

    @property
    def calm(self) -> float:
        return sum(probe.calm for probe in self.probes) / len(self.probes)

    @property
    def rejected(self) -> dict[str, float]:
        """The largest impulse below which nothing failed in any probe, by direction name [Ns]."""
        found: dict[str, float] = {}
        for name, impulse in (item for each in self.probes for item in each.rejected.items()):
            found[name] = min(impulse, found.get(name, impulse))
        return found

    @property
    def passed(self) -> dict[str, float]:
        """Share of the exams' trials that succeeded, by scenario."""
        return {name: sum(exam[name] for exam in self.exams) / len(self.exams) for name in self.exams[0]}

    @property
    def score(self) -> float:
        """Probes see the root's pushes up to large ones and the calm, exams all the rest: they count alike."""
        shares = self.passed.values()
        probed = sum(probe.score for probe in self.probes) / len(self.probes)
        return probed + MAX_PROBE_SCORE * sum(shares) / len(shares)


def files(runs: Sequence[Path]) -> list[Path]:
    """The best and the last policy of run folders; policy files stand for themselves.

    Raises:
        UserError: there is none.
    """
    found = [run / f"{name}{SUFFIX}" for run in runs if run.is_dir() for name in ("best", "last")]
    found = [file for file in (*found, *(run for run in runs if not run.is_dir())) if file.exists()]
    if not found:
        raise UserError(f"no policies in {', '.join(map(str, runs))}")
    return found


def means(run: Path, minutes: float) -> list[Path]:
    """Means of the weights of all policies that a run kept within so many minutes, written into its folder.

    Holes wander from probe to probe; a mean has few of them, if the policies are near each other.

    Args:
        minutes: length of a window; the next one begins half a window later.
    """
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


def judge(file: Path, num_rounds: int) -> Candidate:
    """Probe and examine one policy with `num_rounds` sets of trials that its training has not seen."""
    policy = NetworkAgent(file.read_bytes(), file.stem, str(file))
    rounds = range(FIRST_ROUND, FIRST_ROUND + num_rounds)
    probes = tuple(probe(policy, round=number) for number in rounds)
    return Candidate(file, probes, tuple(examine(policy, round=number) for number in rounds))


def shipped_bytes(candidate: Candidate) -> bytes:
    """The policy's file, with what each of its probes found in its training record."""
    return with_record(candidate.file.read_bytes(), selection=[probe.record() for probe in candidate.probes])
