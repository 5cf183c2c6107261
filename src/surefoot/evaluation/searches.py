"""Searches: the searches along several lines as one source of trials, which uses stored outcomes first."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

from surefoot.evaluation.half_search import HalfSearch
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.scenarios import Line
from surefoot.evaluation.threshold_search import FixedTrials, Threshold, ThresholdSearch, TrialRequest
from surefoot.evaluation.trials import Trial, TrialSource


class Store(Protocol):
    """Keeps outcomes, so that an interrupted evaluation repeats nothing."""

    def get(self, trial: Trial) -> Outcome | None:
        """The outcome of a trial, if it is known."""
        ...

    def put(self, trial: Trial, outcome: Outcome, scenario: str) -> None:
        """Keep the outcome of a trial that was run for a scenario."""
        ...


OnProgress = Callable[[int, int, list[tuple[Line, float]]], None]
"""Told after every trial: trials done, lines done, and the size reached along each line."""

AnySearch = ThresholdSearch | HalfSearch | FixedTrials


def _search_of(line: Line, recall: Callable[[Trial], Outcome | None]) -> AnySearch:
    """A source of the trials of a line."""
    if not line.scenario.search:
        return FixedTrials(line)
    return HalfSearch(line, recall) if line.scenario.half else ThresholdSearch(line, recall)


class Searches(TrialSource):
    """Hands out the trials of all lines in turn, and known outcomes without running them.

    Args:
        lines: that are searched, or whose trials are run.
        store: asked before a trial is run, told afterwards.
        on_progress: told after every trial.
    """

    def __init__(self, lines: Sequence[Line], store: Store | None, on_progress: OnProgress | None):
        self._recall = store.get if store is not None else lambda trial: None
        self.searches = [_search_of(line, self._recall) for line in lines]
        self._store = store
        self._on_progress = on_progress
        self._num_done = 0
        self._turn = deque(self.searches)
        self._running: dict[Trial, list[tuple[AnySearch, TrialRequest]]] = {}

    def thresholds(self) -> list[Threshold]:
        """The thresholds of all lines that are searched."""
        return [search.result() for search in self.searches if not isinstance(search, FixedTrials)]

    def next(self) -> Trial | None:
        """The next trial that is neither known nor running."""
        while (found := self._next_request()) is not None:
            search, request = found
            if request.trial in self._running:  # two lines may ask for the same trial, with and without stepping
                self._running[request.trial].append((search, request))
                continue
            known = self._recall(request.trial)
            if known is None:
                self._running[request.trial] = [(search, request)]
                return request.trial
            search.report(request, known)
        return None

    def _next_request(self) -> tuple[AnySearch, TrialRequest] | None:
        """Needed trials come first, and possibly needed ones only if there are none."""
        for ahead in (False, True):
            for _ in range(len(self._turn)):
                search = self._turn[0]
                self._turn.rotate(-1)
                request = search.next(ahead)
                if request is not None:
                    return search, request
        return None

    def report(self, trial: Trial, outcome: Outcome) -> None:
        """Store an outcome and tell the lines that asked for it."""
        requested = self._running.pop(trial)
        if self._store is not None:
            self._store.put(trial, outcome, requested[0][0].line.scenario.name)
        for search, request in requested:
            search.report(request, outcome)
        self._num_done += 1
        if self._on_progress:
            num_lines = sum(search.done for search in self.searches)
            self._on_progress(self._num_done, num_lines, [(search.line, search.reached) for search in self.searches])

    def wants(self, trial: Trial) -> bool:
        """Whether any line still wants the outcome of a running trial."""
        return any(search.wants(request) for search, request in self._running[trial])

    def drop(self, trial: Trial) -> None:
        """Tell the lines that asked for a trial that it was stopped."""
        for search, request in self._running.pop(trial):
            search.drop(request)
