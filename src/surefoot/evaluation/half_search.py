"""HalfSearch: the search along one line for J50, the impulse from which half of the trials recover.

It goes up the grid with the screening trials of the threshold search, whose outcomes both share, until at most half of
the trials of four neighbouring cells recover. J50 is the upper one of the two cells in the middle.
"""

from __future__ import annotations

from collections.abc import Callable

from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.scenarios import Line
from surefoot.evaluation.threshold_search import (
    NEIGHBOURS,
    NUM_SCREENING,
    Threshold,
    TrialRequest,
    wilson_interval,
)
from surefoot.evaluation.trials import Trial


class HalfSearch:
    """The search for J50 along one line; it asks for its trials cell by cell.

    Args:
        recall: the outcome of a trial that was run before, or None.
    """

    def __init__(self, line: Line, recall: Callable[[Trial], Outcome | None]):
        self.line = line
        self._recall = recall
        self._outcomes: dict[int, list[bool]] = {}
        self._asked = 0
        """Trials that were asked for or recalled, in the order of cells and seeds."""
        self._num_screened = 0
        """Cells from the smallest up, all of whose trials are known."""
        self._found = 0
        """The last of the first four neighbouring cells of which at most half recover; 0 if they are not known yet."""

    @property
    def done(self) -> bool:
        """Whether J50 is known."""
        return bool(self._found) or self._num_screened == self.line.num_cells

    @property
    def reached(self) -> float:
        """The smallest size that is not yet screened, for showing."""
        return self.line.size(min(self._asked // NUM_SCREENING, self.line.num_cells))

    def next(self, ahead: bool) -> TrialRequest | None:
        """The next trial; none is needed `ahead`."""
        while not ahead and not self._found and self._asked < NUM_SCREENING * self.line.num_cells:
            cell, seed = self._asked // NUM_SCREENING + 1, self._asked % NUM_SCREENING
            self._asked += 1
            trial = self.line.trial(cell, seed, full_length=False)
            known = self._recall(trial)
            if known is None:
                return TrialRequest(trial, cell, full_length=False)
            self._add(cell, self.line.succeeded(known))
        return None

    def report(self, request: TrialRequest, outcome: Outcome) -> None:
        """Take in the outcome of a trial."""
        self._add(request.cell, self.line.succeeded(outcome))

    def wants(self, request: TrialRequest) -> bool:
        """Not the trials above the four cells that were found."""
        return not self._found or request.cell <= self._found

    def drop(self, request: TrialRequest) -> None:
        """Nothing is to be taken back: only trials that cannot change the result are stopped."""

    def result(self) -> Threshold:
        """J50, once the search is done; the trials are those of the four cells."""
        last = self._found or self.line.num_cells
        outcomes = [ok for cell in range(last - NEIGHBOURS + 1, last + 1) for ok in self._outcomes[cell]]
        low, high = wilson_interval(sum(outcomes), len(outcomes))
        middle = last - NEIGHBOURS // 2 + 1 if self._found else last
        limit = "half" if self._found else "search"
        return Threshold(self.line, self.line.size(middle), len(outcomes), sum(outcomes), low, high, limit)

    def _add(self, cell: int, succeeded: bool) -> None:
        self._outcomes.setdefault(cell, []).append(succeeded)
        while (
            not self._found and self._num_screened < self.line.num_cells and self._is_screened(self._num_screened + 1)
        ):
            self._num_screened += 1
            last = self._num_screened
            found = sum(sum(self._outcomes[cell]) for cell in range(max(last - NEIGHBOURS + 1, 1), last + 1))
            if last >= NEIGHBOURS and 2 * found <= NUM_SCREENING * NEIGHBOURS:
                self._found = last

    def _is_screened(self, cell: int) -> bool:
        return len(self._outcomes.get(cell, [])) == NUM_SCREENING
