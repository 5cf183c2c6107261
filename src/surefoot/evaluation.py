"""Evaluation: the largest impulse that a policy rejects, by the one definition of success.

J Ns *holds* when at least 95 % of at least 40 whole trials recover and no smaller cell of the 6 Ns grid gives way:
each smaller cell has at least 8 trials, and over any four neighbouring ones together at least 90 % recover. The
rejected impulse is the largest J that holds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from surefoot.disturbance import PUSH_DURATION, Push
from surefoot.policy import Policy
from surefoot.trials import NUM_SLOTS, Outcome, Trial, TrialSource, run_trials

GRID = 6.0
"""Step of the impulse grid [Ns]: the paper's 50 N for 0.12 s."""
MAX_IMPULSE = 900.0
"""Where the search ends [Ns]."""
NUM_SAMPLED = 8
NUM_WHOLE = 40
MIN_SHARE = 0.95
NEIGHBOURS = 4
MIN_NEIGHBOUR_SHARE = 0.90

DIRECTIONS = {"forward": 0.0, "left": 0.5 * np.pi, "backward": np.pi, "right": 1.5 * np.pi}
"""Angles in the horizontal plane [rad], counter-clockwise from +x."""


@dataclass(frozen=True)
class Line:
    """What is searched along: one body pushed in one direction.

    Attributes:
        angle: in the horizontal plane [rad], counter-clockwise from the robot's +x.
        without_step: a trial counts as recovered only if no foot left its place.
    """

    name: str
    body: str
    angle: float
    duration: float = PUSH_DURATION
    without_step: bool = False

    def trial(self, cell: int, seed: int, whole: bool) -> Trial:
        """The trial of cell `cell`: an impulse of `cell` times the grid's step."""
        direction = (round(float(np.cos(self.angle)), 12), round(float(np.sin(self.angle)), 12), 0.0)
        push = Push(self.body, direction, impulse=cell * GRID, duration=self.duration)
        return Trial(push, seed, whole)

    def succeeded(self, outcome: Outcome) -> bool:
        return outcome.without_step if self.without_step else outcome.recovered


@dataclass(frozen=True)
class Threshold:
    """The rejected impulse along a line.

    Attributes:
        impulse: [Ns]; 0 if not even the smallest cell holds.
        trials, recovered: whole trials at that impulse, and how many recovered (0 of 0 at 0 Ns).
        low, high: Wilson 95 % interval of the recovered share there.
        limited_by: what stopped it: "gives way", "share" or "search".
    """

    line: Line
    impulse: float
    trials: int
    recovered: int
    low: float
    high: float
    limited_by: str


class Store(Protocol):
    """Keeps outcomes, so that an interrupted evaluation repeats nothing."""

    def get(self, trial: Trial) -> Outcome | None: ...

    def put(self, trial: Trial, outcome: Outcome) -> None: ...


def push_lines(body: str = "pelvis", num_directions: int = 4, without_step: bool = False) -> list[Line]:
    """Lines in evenly spaced directions; the four main ones bear their names, others their angle in degrees."""
    names = {round(float(np.degrees(angle))): name for name, angle in DIRECTIONS.items()}
    degrees = np.arange(num_directions) * 360.0 / num_directions
    return [
        Line(
            names.get(d, f"{d:g}") if d == round(d) else f"{d:g}", body, float(np.radians(d)), without_step=without_step
        )
        for d in degrees.tolist()
    ]


def find_thresholds(
    policy: Policy,
    lines: Sequence[Line],
    store: Store | None = None,
    on_progress: Callable[[int, list[float]], None] | None = None,
    num_slots: int = NUM_SLOTS,
    num_threads: int = 0,
) -> list[Threshold]:
    """Search the rejected impulse along several lines at once, in one batch of robots.

    Args:
        store: asked before a trial is run, told afterwards.
        on_progress: called after every trial with the trials done and the impulse reached along each line [Ns].
    """
    search = _Search(lines, store, on_progress)
    run_trials(policy, search, num_slots, num_threads)
    return [climb.result() for climb in search.climbs]


def wilson_interval(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """Wilson score interval of a share (E. B. Wilson 1927); (0, 1) for no trials."""
    if trials == 0:
        return 0.0, 1.0
    share = successes / trials
    center = share + z * z / (2 * trials)
    spread = z * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    return max(0.0, float((center - spread) / scale)), min(1.0, float((center + spread) / scale))


class _Search(TrialSource):
    """Hands out the trials of all lines in turn, and known outcomes without running them."""

    def __init__(
        self, lines: Sequence[Line], store: Store | None, on_progress: Callable[[int, list[float]], None] | None
    ):
        self._recall = store.get if store else lambda trial: None
        self.climbs = [_Climb(line, self._recall) for line in lines]
        self._store = store
        self._on_progress = on_progress
        self._num_done = 0
        self._turn = deque(self.climbs)
        self._running: dict[Trial, list[_Climb]] = {}

    def next(self) -> Trial | None:
        while True:
            for _ in range(len(self._turn)):
                climb = self._turn[0]
                self._turn.rotate(-1)
                trial = climb.next()
                if trial is not None:
                    break
            else:
                return None
            if trial in self._running:  # two lines may ask for the same trial, with and without stepping
                self._running[trial].append(climb)
                continue
            known = self._recall(trial)
            if known is None:
                self._running[trial] = [climb]
                return trial
            climb.report(trial, known)

    def report(self, trial: Trial, outcome: Outcome) -> None:
        if self._store:
            self._store.put(trial, outcome)
        for climb in self._running.pop(trial):
            climb.report(trial, outcome)
        self._num_done += 1
        if self._on_progress:
            self._on_progress(self._num_done, [climb.reached for climb in self.climbs])

    def wants(self, trial: Trial) -> bool:
        return any(climb.wants(trial) for climb in self._running[trial])

    def drop(self, trial: Trial) -> None:
        for climb in self._running.pop(trial):
            climb.waiting -= 1


class _Climb:
    """The search along one line: climb the grid until cells give way, then descend to the first that holds.

    Args:
        recall: the outcome of a trial that was run before, or None. What is known is taken in before anything is
            asked for, so that a repeated search asks for nothing that the first one could leave out.
    """

    def __init__(self, line: Line, recall: Callable[[Trial], Outcome | None]):
        self.line = line
        self._recall = recall
        self.top = int(MAX_IMPULSE / GRID)
        """The highest cell that may still hold: every smaller one is to be sampled, none of them gives way."""
        self.gave_way = False
        self.sampled: dict[int, list[bool]] = {}
        self.whole: dict[int, list[bool]] = {}
        self.waiting = 0
        self._to_sample: deque[tuple[int, int]] = deque()
        self._to_judge: deque[int] = deque()
        self._candidate: int | None = None
        for cell in range(1, self.top):
            for seed in range(NUM_SAMPLED):
                known = recall(line.trial(cell, seed, whole=False))
                if known is None:
                    self._to_sample.append((cell, seed))
                else:
                    self._add_sample(cell, line.succeeded(known))

    @property
    def reached(self) -> float:
        """Lower end of what is not yet known [Ns], for showing."""
        if self._candidate is not None:
            return self._candidate * GRID
        full = [cell for cell, outcomes in self.sampled.items() if len(outcomes) == NUM_SAMPLED]
        return min(max(full, default=0), self.top) * GRID

    def next(self) -> Trial | None:
        trial = self._next_sample() if self._candidate is None else None
        if trial is None and self.waiting == 0 and self._candidate is None:
            self._candidate = self._next_candidate(self.top)
        if trial is None and self._candidate:
            trial = self._next_whole()
        self.waiting += trial is not None
        return trial

    def _next_sample(self) -> Trial | None:
        while self._to_sample:
            cell, seed = self._to_sample.popleft()
            if cell < self.top:
                return self.line.trial(cell, seed, whole=False)
        return None

    def _next_whole(self) -> Trial | None:
        while self._candidate and self._candidate not in self.whole:
            self._begin_candidate(self._candidate)
        if not self._candidate or not self._to_judge:
            return None
        return self.line.trial(self._candidate, self._to_judge.popleft(), whole=True)

    def _begin_candidate(self, cell: int) -> None:
        self.whole[cell] = []
        for seed in range(NUM_WHOLE):
            known = self._recall(self.line.trial(cell, seed, whole=True))
            if known is None:
                self._to_judge.append(seed)
            else:
                self.whole[cell].append(self.line.succeeded(known))
        self._judge(cell)

    def wants(self, trial: Trial) -> bool:
        """Not the trials of a candidate that was left, nor those above where cells give way."""
        cell = round(trial.push.impulse / GRID)
        return cell == self._candidate if trial.whole else cell < self.top

    def report(self, trial: Trial, outcome: Outcome) -> None:
        self.waiting -= 1
        cell = round(trial.push.impulse / GRID)
        succeeded = self.line.succeeded(outcome)
        if trial.whole:
            self.whole[cell].append(succeeded)
            self._judge(cell)
        else:
            self._add_sample(cell, succeeded)

    def _add_sample(self, cell: int, succeeded: bool) -> None:
        self.sampled.setdefault(cell, []).append(succeeded)
        if not succeeded:
            self._look_for_gap(cell)

    def _look_for_gap(self, cell: int) -> None:
        """Lower `top` if four neighbouring cells about `cell` give way, which bars every impulse above them."""
        for last in range(max(cell, NEIGHBOURS), cell + NEIGHBOURS):
            if last < self.top and self._gives_way(range(last - NEIGHBOURS + 1, last + 1)):
                self.top = last
                self.gave_way = True
                return

    def _gives_way(self, cells: range) -> bool:
        """Do these cells together fail too often, whatever is still running?"""
        allowed = (1.0 - MIN_NEIGHBOUR_SHARE) * NUM_SAMPLED * len(cells) + 1e-9
        return sum(self._failures(cell) for cell in cells) > allowed

    def _failures(self, cell: int) -> int:
        return self.sampled.get(cell, []).count(False)

    def _judge(self, cell: int) -> None:
        """Leave a candidate as soon as it cannot hold any more."""
        if self.whole[cell].count(False) > _MAX_FAILURES and cell == self._candidate:
            self._to_judge.clear()
            self._candidate = self._next_candidate(cell - 1)

    def _next_candidate(self, cell: int) -> int:
        """The next cell down that the sampled trials do not rule out already; 0 for none."""
        while cell > 0 and (self._failures(cell) > _MAX_FAILURES or self._gap_at_the_foot(cell)):
            cell -= 1
        return cell

    def _gap_at_the_foot(self, cell: int) -> bool:
        """With fewer than four smaller cells, all of them together are the neighbours."""
        return 1 < cell <= NEIGHBOURS and self._gives_way(range(1, cell))

    def result(self) -> Threshold:
        cell = self._candidate or 0
        outcomes = self.whole.get(cell, [])
        low, high = wilson_interval(sum(outcomes), len(outcomes))
        limit = "search" if not self.gave_way else "gives way" if cell == self.top else "share"
        return Threshold(self.line, cell * GRID, len(outcomes), sum(outcomes), low, high, limit)


_MAX_FAILURES = int((1.0 - MIN_SHARE) * NUM_WHOLE + 1e-9)
