"""Evaluation: how hard a disturbance a policy survives, by the one definition of success.

J Ns *holds* when at least 95 % of at least 40 whole trials recover and no smaller cell of the 6 Ns grid gives way:
each smaller cell has at least 8 trials, and over any four neighbouring ones together at least 90 % recover. The
rejected impulse is the largest J that holds. Heights and tilts are searched likewise, each on its own grid.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from surefoot.controllers.protocol import Contestant
from surefoot.policy import Policy
from surefoot.scenarios import DIRECTIONS, Line, Scenario
from surefoot.trials import NUM_SLOTS, Outcome, Trial, TrialSource, run_trials

__all__ = ["DIRECTIONS", "Line", "Store", "Threshold", "find_thresholds", "push_lines", "run_scenarios"]

NUM_SAMPLED = 8
NUM_WHOLE = 40
MIN_SHARE = 0.95
NEIGHBOURS = 4
MIN_NEIGHBOUR_SHARE = 0.90
LOOK_AHEAD = 12
"""Candidates that are judged at once while robots would stand idle otherwise."""
NUM_FIRST = 6
"""Whole trials of a cell that come first, of seeds that rule it out soonest; the others only of the candidate."""

_MAX_FAILURES = int((1.0 - MIN_SHARE) * NUM_WHOLE + 1e-9)


@dataclass(frozen=True)
class Threshold:
    """The largest recovered size along a line: the rejected impulse, the height or the tilt.

    Attributes:
        size: in the scenario's unit; 0 if not even the smallest cell holds.
        trials, recovered: whole trials at that size, and how many recovered (0 of 0 at a size of 0).
        low, high: Wilson 95 % interval of the recovered share there.
        limited_by: what stopped it: "gives way", "share" or "search".
    """

    line: Line
    size: float
    trials: int
    recovered: int
    low: float
    high: float
    limited_by: str


class Store(Protocol):
    """Keeps outcomes, so that an interrupted evaluation repeats nothing."""

    def get(self, trial: Trial) -> Outcome | None: ...

    def put(self, trial: Trial, outcome: Outcome, scenario: str) -> None: ...


OnProgress = Callable[[int, int, list[tuple[Line, float]]], None]
"""Told after every trial: trials done, lines done, and the size reached along each line."""


def push_lines(num_directions: int = 4) -> list[Line]:
    """Lines of pushes at the pelvis in evenly spaced directions; the four main ones bear their names."""
    return Scenario("pelvis_push", directions=num_directions).lines()


def run_scenarios(
    policy: Policy | Contestant,
    scenarios: Iterable[Scenario],
    store: Store | None = None,
    on_progress: OnProgress | None = None,
    **options,
) -> list[Threshold]:
    """Run the trials of all scenarios, those in the same world as one batch.

    Args:
        store: asked before a trial is run, told afterwards.
        options: those of `run_trials`.

    Returns:
        The thresholds of all lines that are searched.
    """
    scenarios = list(scenarios)
    thresholds: list[Threshold] = []
    for world in dict.fromkeys(scenario.world for scenario in scenarios):
        lines = [line for s in scenarios if s.world == world for line in s.lines()]
        search = _Search(lines, store, on_progress)
        run_trials(policy, search, world=world, **options)
        thresholds += search.thresholds()
    return thresholds


def find_thresholds(
    policy: Policy | Contestant,
    lines: Sequence[Line],
    store: Store | None = None,
    on_progress: OnProgress | None = None,
    num_slots: int = NUM_SLOTS,
    num_threads: int = 0,
) -> list[Threshold]:
    """Search several lines of one world at once, in one batch of robots; arguments as for `run_scenarios`."""
    search = _Search(lines, store, on_progress)
    run_trials(policy, search, num_slots, num_threads, world=lines[0].scenario.world)
    return search.thresholds()


def recall(store: Store, trial: Trial) -> Outcome | None:
    """The outcome of a trial, if it was run before; a whole trial's also if it was sampled and did not end early.

    A sampled trial differs from the whole one of its seed only in that it may end as recovered once it is quiet. One
    that failed, or was never quiet before its horizon, is the whole trial.
    """
    known = store.get(trial)
    if known is None and trial.whole:
        sampled = store.get(dataclasses.replace(trial, whole=False))
        if sampled and (not sampled.recovered or sampled.seconds >= trial.horizon):
            return sampled
    return known


class _Memory:
    """The store of an evaluation that keeps nothing beyond its end."""

    def __init__(self) -> None:
        self._known: dict[Trial, Outcome] = {}

    def get(self, trial: Trial) -> Outcome | None:
        return self._known.get(trial)

    def put(self, trial: Trial, outcome: Outcome, scenario: str) -> None:
        self._known[trial] = outcome


def whole_outcomes(threshold: Threshold, store: Store) -> list[Outcome]:
    """Outcomes of the whole trials at a threshold."""
    cell = round(threshold.size / threshold.line.grid)
    trials = (threshold.line.trial(cell, seed, whole=True) for seed in range(threshold.trials))
    return [outcome for trial in trials if (outcome := recall(store, trial))]


def wilson_interval(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """Wilson score interval of a share (E. B. Wilson 1927); (0, 1) for no trials."""
    if trials == 0:
        return 0.0, 1.0
    share = successes / trials
    center = share + z * z / (2 * trials)
    spread = z * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    return max(0.0, float((center - spread) / scale)), min(1.0, float((center + spread) / scale))


@dataclass(frozen=True)
class _Ask:
    """A trial that a line wants, and for which of its cells."""

    trial: Trial
    cell: int
    whole: bool


class _Search(TrialSource):
    """Hands out the trials of all lines in turn, and known outcomes without running them."""

    def __init__(self, lines: Sequence[Line], store: Store | None, on_progress: OnProgress | None):
        self._store = store if store is not None else _Memory()
        self.climbs: list[_Climb | _Fixed] = [
            _Climb(line, self._recall) if line.scenario.search else _Fixed(line) for line in lines
        ]
        self._on_progress = on_progress
        self._num_done = 0
        self._turn = deque(self.climbs)
        self._running: dict[Trial, list[tuple[_Climb | _Fixed, _Ask]]] = {}

    def _recall(self, trial: Trial) -> Outcome | None:
        return recall(self._store, trial)

    def thresholds(self) -> list[Threshold]:
        return [climb.result() for climb in self.climbs if isinstance(climb, _Climb)]

    def next(self) -> Trial | None:
        while (found := self._ask()) is not None:
            climb, ask = found
            if ask.trial in self._running:  # two lines may ask for the same trial, with and without stepping
                self._running[ask.trial].append((climb, ask))
                continue
            known = self._recall(ask.trial)
            if known is None:
                self._running[ask.trial] = [(climb, ask)]
                return ask.trial
            climb.report(ask, known)
        return None

    def _ask(self) -> tuple[_Climb | _Fixed, _Ask] | None:
        """What is needed comes first; only if nothing is, what may be needed."""
        for ahead in (False, True):
            for _ in range(len(self._turn)):
                climb = self._turn[0]
                self._turn.rotate(-1)
                ask = climb.next(ahead)
                if ask is not None:
                    return climb, ask
        return None

    def report(self, trial: Trial, outcome: Outcome) -> None:
        asked = self._running.pop(trial)
        self._store.put(trial, outcome, asked[0][0].line.scenario.name)
        for climb, ask in asked:
            climb.report(ask, outcome)
        self._num_done += 1
        if self._on_progress:
            num_lines = sum(climb.done for climb in self.climbs)
            self._on_progress(self._num_done, num_lines, [(climb.line, climb.reached) for climb in self.climbs])

    def wants(self, trial: Trial) -> bool:
        return any(climb.wants(ask) for climb, ask in self._running[trial])

    def drop(self, trial: Trial) -> None:
        for climb, ask in self._running.pop(trial):
            climb.drop(ask)


class _Fixed:
    """The trials of a line along which nothing is searched."""

    def __init__(self, line: Line):
        self.line = line
        trials = line.fixed_trials()
        self._todo = deque(_Ask(trial, 0, whole=True) for trial in trials)
        self._left = len(trials)

    @property
    def done(self) -> bool:
        return self._left == 0

    @property
    def reached(self) -> float:
        return float(self.line.scenario.trials - self._left)

    def next(self, ahead: bool) -> _Ask | None:
        return self._todo.popleft() if self._todo and not ahead else None

    def report(self, ask: _Ask, outcome: Outcome) -> None:
        self._left -= 1

    def wants(self, ask: _Ask) -> bool:
        return True

    def drop(self, ask: _Ask) -> None:
        """Never happens: every trial is wanted."""


class _Climb:
    """The search along one line: climb the grid until cells give way, then descend to the first that holds.

    Args:
        recall: the outcome of a trial that was run before, or None. What is known is taken in before anything is
            asked for, so that a repeated search asks for nothing that the first one could leave out.
    """

    def __init__(self, line: Line, recall: Callable[[Trial], Outcome | None]):
        self.line = line
        self._recall = recall
        self.top = line.num_cells
        """The highest cell that may still hold: every smaller one is to be sampled, none of them gives way."""
        self.gave_way = False
        self.sampled: dict[int, list[bool]] = {}
        self.whole: dict[int, list[bool]] = {}
        self._num_sampling = 0
        self._to_sample: deque[tuple[int, int]] = deque()
        self._to_judge: dict[int, list[int]] = {}
        self._num_failures = [0] * NUM_WHOLE
        """By seed, of whole trials at any cell."""
        self._candidate: int | None = None
        self._found_candidates: list[int] | None = None
        for cell in range(1, self.top):
            for seed in range(NUM_SAMPLED):
                known = recall(line.trial(cell, seed, whole=False))
                if known is None:
                    self._to_sample.append((cell, seed))
                else:
                    self._add_sample(cell, line.succeeded(known))

    @property
    def done(self) -> bool:
        return self._candidate is not None and not self._undecided(self._candidate)

    @property
    def reached(self) -> float:
        """Lower end of what is not yet known, for showing."""
        if self._candidate is not None:
            return self.line.size(self._candidate)
        full = [cell for cell, outcomes in self.sampled.items() if len(outcomes) == NUM_SAMPLED]
        return self.line.size(min(max(full, default=0), self.top))

    def next(self, ahead: bool) -> _Ask | None:
        """The next trial; with `ahead`, one that is only needed if the candidate turns out not to hold."""
        if self._candidate is None:
            return None if ahead else self._next_sample()
        for cell in self._candidates()[1 if ahead else 0 : LOOK_AHEAD if ahead else 1]:
            if cell not in self._to_judge:
                self._begin_candidate(cell)
                if cell == self._candidate and self._descend():
                    return self.next(ahead)
            num_asked, num_known = NUM_WHOLE - len(self._to_judge[cell]), len(self.whole[cell])
            if num_asked < NUM_FIRST or (not ahead and num_known >= NUM_FIRST and num_asked < NUM_WHOLE):
                return self._ask(cell, self._take_seed(cell), whole=True)
        return None

    def _next_sample(self) -> _Ask | None:
        while self._to_sample:
            cell, seed = self._to_sample.popleft()
            if cell < self.top:
                self._num_sampling += 1
                return self._ask(cell, seed, whole=False)
        if self._num_sampling:
            return None
        self._candidate, self._found_candidates = self._next_candidate(self.top), None
        return self.next(ahead=False)

    def _ask(self, cell: int, seed: int, whole: bool) -> _Ask:
        return _Ask(self.line.trial(cell, seed, whole), cell, whole)

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
        return cell > 0 and len(self.whole.get(cell, [])) < NUM_WHOLE

    def _take_seed(self, cell: int) -> int:
        """The next one of a candidate: first those that failed most elsewhere, for they rule it out soonest."""
        seed = max(self._to_judge[cell], key=lambda seed: (self._num_failures[seed], -seed))
        self._to_judge[cell].remove(seed)
        return seed

    def _begin_candidate(self, cell: int) -> None:
        self._found_candidates = None
        outcomes = self.whole.setdefault(cell, [])
        self._to_judge[cell] = []
        for seed in range(NUM_WHOLE):
            known = self._recall(self.line.trial(cell, seed, whole=True))
            if known is None:
                self._to_judge[cell].append(seed)
            else:
                outcomes.append(self.line.succeeded(known))
                self._num_failures[seed] += not outcomes[-1]

    def wants(self, ask: _Ask) -> bool:
        """Not the trials of a candidate that was left, nor those above where cells give way."""
        return ask.cell in self._candidates() if ask.whole else ask.cell < self.top

    def drop(self, ask: _Ask) -> None:
        self._num_sampling -= not ask.whole

    def report(self, ask: _Ask, outcome: Outcome) -> None:
        succeeded = self.line.succeeded(outcome)
        self._found_candidates = None
        if ask.whole:
            self.whole[ask.cell].append(succeeded)
            self._num_failures[ask.trial.seed] += not succeeded
            self._descend()
        else:
            self._num_sampling -= 1
            self._add_sample(ask.cell, succeeded)

    def _add_sample(self, cell: int, succeeded: bool) -> None:
        self.sampled.setdefault(cell, []).append(succeeded)
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
        allowed = (1.0 - MIN_NEIGHBOUR_SHARE) * NUM_SAMPLED * len(cells) + 1e-9
        return sum(self._failures(cell) for cell in cells) > allowed

    def _failures(self, cell: int) -> int:
        return self.sampled.get(cell, []).count(False)

    def _descend(self) -> bool:
        """Leave every candidate that cannot hold any more; was one left?"""
        before = self._candidate
        while self._candidate and self.whole.get(self._candidate, []).count(False) > _MAX_FAILURES:
            self._candidate = self._next_candidate(self._candidate - 1)
        return self._candidate != before

    def _next_candidate(self, cell: int) -> int:
        """The next cell down that the trials so far do not rule out already; 0 for none."""
        while cell > 0 and (
            self._failures(cell) > _MAX_FAILURES
            or self.whole.get(cell, []).count(False) > _MAX_FAILURES
            or self._gap_at_the_foot(cell)
        ):
            cell -= 1
        return cell

    def _gap_at_the_foot(self, cell: int) -> bool:
        """With fewer than four smaller cells, all of them together are the neighbours."""
        return 1 < cell <= NEIGHBOURS and self._gives_way(range(1, cell))

    def result(self) -> Threshold:
        cell = self._candidate or 0
        outcomes = self.whole.get(cell, []) if cell else []
        low, high = wilson_interval(sum(outcomes), len(outcomes))
        limit = "search" if not self.gave_way else "gives way" if cell == self.top else "share"
        return Threshold(self.line, self.line.size(cell), len(outcomes), sum(outcomes), low, high, limit)
