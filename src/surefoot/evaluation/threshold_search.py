"""ThresholdSearch: the search for the rejected impulse along one line, by the one definition of success.

J Ns *holds* when at least 95 % of 40 full-length trials recover and no smaller cell of the grid gives way: each smaller
cell has 8 screening trials, and over any four neighbouring cells together at least 90 % of these recover. The rejected
impulse is the largest J that holds. Heights and tilts are searched likewise, each on its own grid.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from scipy.stats import binomtest, norm

from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.scenarios import Line
from surefoot.evaluation.trials import Trial

NUM_SCREENING = PROTOCOL.num_screening
NUM_FULL_LENGTH = PROTOCOL.num_full_length
MIN_SHARE = PROTOCOL.min_share
NEIGHBOURS = PROTOCOL.num_neighbours
MIN_NEIGHBOUR_SHARE = PROTOCOL.min_neighbour_share
LOOK_AHEAD = 12
"""Candidates whose trials are run at once while robots would stand idle otherwise; changes no result."""
NUM_FIRST = 6
"""Full-length trials of a cell that come first, of seeds that rule it out soonest; changes no result."""

CONFIDENCE = float(2.0 * norm.cdf(1.959964) - 1.0)
"""Of the Wilson intervals: 95 %, by the rounded quantile with which all results so far were written."""

_MAX_FAILURES = int((1.0 - MIN_SHARE) * NUM_FULL_LENGTH + 1e-9)


@dataclass(frozen=True)
class Threshold:
    """The largest recovered size along a line: the rejected impulse, the height or the tilt.

    Attributes:
        size: size in the scenario's unit; 0 if not even the smallest cell holds.
        trials, recovered: number of full-length trials at that size, and of those that recovered (0 at a size of 0).
        low, high: Wilson 95 % interval of the recovered share there.
        limited_by: reason why the size is not larger: "gives way", "share" or "search".
    """

    line: Line
    size: float
    trials: int
    recovered: int
    low: float
    high: float
    limited_by: str

    def full_length_trials(self) -> list[Trial]:
        """Return the full-length trials at that size; none at a size of 0."""
        cell = round(self.size / self.line.grid)
        return [self.line.trial(cell, seed, full_length=True) for seed in range(self.trials)]


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """The Wilson 95 % score interval of a share (E. B. Wilson 1927); (0, 1) for no trials."""
    if trials == 0:
        return 0.0, 1.0
    interval = binomtest(successes, trials).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


@dataclass(frozen=True)
class TrialRequest:
    """A trial that a line wants, and for which of its cells."""

    trial: Trial
    cell: int
    full_length: bool


class FixedTrials:
    """The trials of a line along which nothing is searched."""

    def __init__(self, line: Line):
        self.line = line
        trials = line.fixed_trials()
        self._todo = deque(TrialRequest(trial, 0, full_length=True) for trial in trials)
        self._left = len(trials)

    @property
    def done(self) -> bool:
        """Whether all trials have been reported."""
        return self._left == 0

    @property
    def reached(self) -> float:
        """Number of trials so far, for showing."""
        return float(self.line.scenario.trials - self._left)

    def next(self, ahead: bool) -> TrialRequest | None:
        """The next trial; none is needed `ahead`."""
        return self._todo.popleft() if self._todo and not ahead else None

    def report(self, request: TrialRequest, outcome: Outcome) -> None:
        """Take in the outcome of a trial."""
        self._left -= 1

    def wants(self, request: TrialRequest) -> bool:
        """Every trial is wanted."""
        return True

    def drop(self, request: TrialRequest) -> None:
        """Never happens: every trial is wanted."""


class ThresholdSearch:
    """The search along one line: go up the grid until cells give way, then down to the first that holds.

    Args:
        recall: the outcome of a trial that was run before, or None. What is known is taken in before anything is
            asked for, so that a repeated search asks for nothing that the first one could leave out.
    """

    def __init__(self, line: Line, recall: Callable[[Trial], Outcome | None]):
        self.line = line
        self._recall = recall
        self.top = line.num_cells
        """The highest cell that may still hold: every smaller one is to be screened, none of them gives way."""
        self.gave_way = False
        self.screened: dict[int, list[bool]] = {}
        self.full_length: dict[int, list[bool]] = {}
        self._num_screening = 0
        self._to_screen: deque[tuple[int, int]] = deque()
        self._to_run: dict[int, list[int]] = {}
        self._num_failures = [0] * NUM_FULL_LENGTH
        """By seed, of full-length trials at any cell."""
        self._candidate: int | None = None
        self._found_candidates: list[int] | None = None
        for cell in range(1, self.top):
            for seed in range(NUM_SCREENING):
                known = recall(line.trial(cell, seed, full_length=False))
                if known is None:
                    self._to_screen.append((cell, seed))
                else:
                    self._add_screening(cell, line.succeeded(known))

    @property
    def done(self) -> bool:
        """Whether the threshold is known."""
        return self._candidate is not None and not self._undecided(self._candidate)

    @property
    def reached(self) -> float:
        """Lower end of what is not yet known, for showing."""
        if self._candidate is not None:
            return self.line.size(self._candidate)
        full = [cell for cell, outcomes in self.screened.items() if len(outcomes) == NUM_SCREENING]
        return self.line.size(min(max(full, default=0), self.top))

    def next(self, ahead: bool) -> TrialRequest | None:
        """The next trial; with `ahead`, one that is only needed if the candidate turns out not to hold."""
        if self._candidate is None:
            return None if ahead else self._next_screening()
        for cell in self._candidates()[1 if ahead else 0 : LOOK_AHEAD if ahead else 1]:
            if cell not in self._to_run:
                self._begin_candidate(cell)
                if cell == self._candidate and self._descend():
                    return self.next(ahead)
            num_requested, num_known = NUM_FULL_LENGTH - len(self._to_run[cell]), len(self.full_length[cell])
            if num_requested < NUM_FIRST or (not ahead and num_known >= NUM_FIRST and num_requested < NUM_FULL_LENGTH):
                return self._request(cell, self._take_seed(cell), full_length=True)
        return None

    def _next_screening(self) -> TrialRequest | None:
        while self._to_screen:
            cell, seed = self._to_screen.popleft()
            if cell < self.top:
                self._num_screening += 1
                return self._request(cell, seed, full_length=False)
        if self._num_screening:
            return None
        self._candidate, self._found_candidates = self._next_candidate(self.top), None
        return self.next(ahead=False)

    def _request(self, cell: int, seed: int, full_length: bool) -> TrialRequest:
        return TrialRequest(self.line.trial(cell, seed, full_length), cell, full_length)

    def _candidates(self) -> list[int]:
        """The candidate, and who comes next should it not hold; none once it does. The same until a report."""
        if self._found_candidates is None:
            cells: list[int] = []
            self._found_candidates = cells
            cell = self._candidate or 0
            while cell > 0 and len(cells) < LOOK_AHEAD and self._undecided(self._candidate or 0):
                cells.append(cell)
                cell = self._next_candidate(cell - 1)
        return self._found_candidates

    def _undecided(self, cell: int) -> bool:
        return cell > 0 and len(self.full_length.get(cell, [])) < NUM_FULL_LENGTH

    def _take_seed(self, cell: int) -> int:
        """The next one of a candidate: first those that failed most elsewhere, for they rule it out soonest."""
        seed = max(self._to_run[cell], key=lambda seed: (self._num_failures[seed], -seed))
        self._to_run[cell].remove(seed)
        return seed

    def _begin_candidate(self, cell: int) -> None:
        self._found_candidates = None
        outcomes = self.full_length.setdefault(cell, [])
        self._to_run[cell] = []
        for seed in range(NUM_FULL_LENGTH):
            known = self._recall(self.line.trial(cell, seed, full_length=True))
            if known is None:
                self._to_run[cell].append(seed)
            else:
                outcomes.append(self.line.succeeded(known))
                self._num_failures[seed] += not outcomes[-1]

    def wants(self, request: TrialRequest) -> bool:
        """Not the trials of a candidate that was left, nor those above where cells give way."""
        return request.cell in self._candidates() if request.full_length else request.cell < self.top

    def drop(self, request: TrialRequest) -> None:
        """Take back the request of a trial that was stopped."""
        self._num_screening -= not request.full_length

    def report(self, request: TrialRequest, outcome: Outcome) -> None:
        """Take in the outcome of a trial."""
        succeeded = self.line.succeeded(outcome)
        self._found_candidates = None
        if request.full_length:
            self.full_length[request.cell].append(succeeded)
            self._num_failures[request.trial.seed] += not succeeded
            self._descend()
        else:
            self._num_screening -= 1
            self._add_screening(request.cell, succeeded)

    def _add_screening(self, cell: int, succeeded: bool) -> None:
        self.screened.setdefault(cell, []).append(succeeded)
        if not succeeded:
            self._look_for_gap(cell)

    def _look_for_gap(self, cell: int) -> None:
        """Lower `top` if four neighbouring cells about `cell` give way, which bars every size above them."""
        for last in range(max(cell, NEIGHBOURS), cell + NEIGHBOURS):
            if last < self.top and self._gives_way(range(last - NEIGHBOURS + 1, last + 1)):
                self.top = last
                self.gave_way = True
                return

    def _gives_way(self, cells: range) -> bool:
        """Whatever the trials still missing may bring."""
        allowed = (1.0 - MIN_NEIGHBOUR_SHARE) * NUM_SCREENING * len(cells) + 1e-9
        return sum(self._failures(cell) for cell in cells) > allowed

    def _failures(self, cell: int) -> int:
        return self.screened.get(cell, []).count(False)

    def _descend(self) -> bool:
        """Leave every candidate that cannot hold any more; was one left?"""
        before = self._candidate
        while self._candidate and self.full_length.get(self._candidate, []).count(False) > _MAX_FAILURES:
            self._candidate = self._next_candidate(self._candidate - 1)
        return self._candidate != before

    def _next_candidate(self, cell: int) -> int:
        """The next cell down that the trials so far do not rule out already; 0 for none."""
        while cell > 0 and (
            self._failures(cell) > _MAX_FAILURES
            or self.full_length.get(cell, []).count(False) > _MAX_FAILURES
            or self._gap_at_the_foot(cell)
        ):
            cell -= 1
        return cell

    def _gap_at_the_foot(self, cell: int) -> bool:
        """With fewer than four smaller cells, all of them together are the neighbours."""
        return 1 < cell <= NEIGHBOURS and self._gives_way(range(1, cell))

    def result(self) -> Threshold:
        """The threshold, once the search is done."""
        cell = self._candidate or 0
        outcomes = self.full_length.get(cell, []) if cell else []
        low, high = wilson_interval(sum(outcomes), len(outcomes))
        limit = "search" if not self.gave_way else "gives way" if cell == self.top else "share"
        return Threshold(self.line, self.line.size(cell), len(outcomes), sum(outcomes), low, high, limit)
