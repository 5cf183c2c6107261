"""The search for the rejected impulse, against trials whose outcome is known by rule, and on the real robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from conftest import Memory, an_outcome

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation import threshold_search as climb
from surefoot.evaluation.evaluate import find_thresholds, full_length_outcomes, push_lines
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.scenarios import Line, Scenario
from surefoot.evaluation.searches import Searches
from surefoot.evaluation.threshold_search import NUM_FULL_LENGTH, NUM_SCREENING, Threshold, wilson_interval
from surefoot.evaluation.trials import Trial

pytestmark = pytest.mark.slow

FORWARD, LEFT = push_lines()[:2]

Fails = Callable[[int, int, bool], bool]
"""(cell, seed, whole) -> does the trial fail?"""


def cell_of(trial: Trial) -> int:
    """On its grid: 6 Ns, 5 cm (pushed by nothing, dropped upright) or 1 degree."""
    if trial.push.impulse or not trial.drop:
        return round(trial.push.impulse / 6.0)
    tilt = math.degrees(math.hypot(trial.drop.roll, trial.drop.pitch))
    return round(tilt) if tilt else round(trial.drop.height / 0.05)


class KnownOutcomes:
    """A store that has every trial already: what the search concludes from them can be worked out by hand."""

    def __init__(self, fails: Fails):
        self.fails = fails
        self.asked: list[Trial] = []

    def get(self, trial: Trial) -> Outcome:
        self.asked.append(trial)
        failed = self.fails(cell_of(trial), trial.seed, trial.full_length)
        return an_outcome(recovered=not failed, reason="fell" if failed else "recovered")

    def put(self, trial: Trial, outcome: Outcome, scenario: str) -> None:
        raise AssertionError("a known trial was run again")


def threshold_where(fails: Fails, line: Line = FORWARD) -> tuple[float, KnownOutcomes]:
    store = KnownOutcomes(fails)
    (threshold,) = find_thresholds(NominalAgent(usual_robot()), [line], store, num_slots=1)
    return threshold.size, store


class Arena:
    """Runs a search as `run_trials` does, but trials end in a drawn order and as a rule says, not by physics.

    Attributes:
        begun: every trial, as they began.
        most: how many were under way at most, by cell, of those that are whole.
    """

    def __init__(
        self,
        lines: Sequence[Line],
        outcome: Callable[[Trial], Outcome],
        num_slots: int,
        seed: int = 0,
        store: Memory | None = None,
    ):
        search, rng = Searches(lines, store, None), np.random.default_rng(seed)
        self.begun: list[Trial] = []
        self.most: dict[int, int] = {}
        running: list[Trial] = []
        while True:
            while len(running) < num_slots and (trial := search.next()):
                running.append(trial)
                self.begun.append(trial)
            for cell in {cell_of(trial) for trial in running if trial.full_length}:
                now = sum(trial.full_length and cell_of(trial) == cell for trial in running)
                self.most[cell] = max(self.most.get(cell, 0), now)
            if not running:
                break
            trial = running.pop(rng.integers(len(running)))
            search.report(trial, outcome(trial))
            for unwanted in [trial for trial in running if not search.wants(trial)]:
                running.remove(unwanted)
                search.drop(unwanted)
        self.thresholds: list[Threshold] = search.thresholds()


def by_rule(fails: Fails) -> Callable[[Trial], Outcome]:
    return lambda trial: an_outcome(recovered=not fails(cell_of(trial), trial.seed, trial.full_length))


def test_seeds_that_failed_elsewhere_are_tried_first() -> None:
    """Seeds 30, 33 and 36 recover at 12 Ns and below only, the others up to 240 Ns."""
    weak = (30, 33, 36)
    arena = Arena([FORWARD], by_rule(lambda cell, seed, whole: cell > (2 if whole and seed in weak else 40)), 8)
    assert [t.size for t in arena.thresholds] == [12.0]
    judged = [cell_of(trial) for trial in arena.begun if trial.full_length]
    # In order the third weak seed would be the 37th trial of each of the cells 40 to 3: 38 * 37 = 1406 trials.
    assert len(judged) < 600
    assert judged.count(2) == 40


def test_a_policy_that_survives_everything_up_to_120_ns_is_worth_120() -> None:
    impulse, _ = threshold_where(lambda cell, seed, whole: cell > 20)
    assert impulse == 20 * 6.0


def test_a_policy_with_a_hole_at_90_ns_that_survives_300_is_worth_84() -> None:
    impulse, _ = threshold_where(lambda cell, seed, whole: cell == 15 or cell > 50)
    assert impulse == 84.0


def test_38_of_40_hold_and_37_do_not() -> None:
    # 0.95 * 40 = 38.
    assert threshold_where(lambda cell, seed, whole: cell > 20 or (cell == 20 and seed >= 38))[0] == 120.0
    assert threshold_where(lambda cell, seed, whole: cell > 20 or (cell == 20 and seed >= 37))[0] == 114.0


def test_three_failures_in_four_neighbouring_cells_are_borne_and_four_are_not() -> None:
    # Four cells have 32 trials; 90 % of them are 28.8, so that 3 may fail.
    scattered = {(5, 0), (6, 0), (7, 0)}
    assert threshold_where(lambda cell, seed, whole: cell > 20 or (not whole and (cell, seed) in scattered))[0] == 120.0
    # With a fourth at cell 8 the window 5..8 gives way: only impulses up to cell 8 itself can hold.
    scattered = scattered | {(8, 0)}
    assert threshold_where(lambda cell, seed, whole: cell > 20 or (not whole and (cell, seed) in scattered))[0] == 48.0


def test_below_five_cells_all_smaller_ones_are_the_neighbours() -> None:
    # Cell 1 has 8 trials and 7.2 must recover: one failure bars cell 2, whose only smaller cell it is. Cells 1 and 2
    # together have 16, of which 14.4 must: one failure is borne again.
    assert threshold_where(lambda cell, seed, whole: cell > 2 or (not whole and (cell, seed) == (1, 0)))[0] == 6.0
    assert threshold_where(lambda cell, seed, whole: cell > 3 or (not whole and (cell, seed) == (1, 0)))[0] == 18.0


def test_a_policy_that_cannot_even_stand_is_worth_nothing() -> None:
    assert threshold_where(lambda cell, seed, whole: True)[0] == 0.0


def test_every_smaller_cell_has_8_trials_and_the_threshold_has_40_whole_ones() -> None:
    _, store = threshold_where(lambda cell, seed, whole: cell > 20)
    for cell in range(1, 20):
        assert {t.seed for t in store.asked if not t.full_length and cell_of(t) == cell} == set(range(NUM_SCREENING))
    assert {t.seed for t in store.asked if t.full_length and t.push.impulse == 120.0} == set(range(NUM_FULL_LENGTH))


def test_no_trial_is_asked_for_twice() -> None:
    _, store = threshold_where(lambda cell, seed, whole: cell > 20 or cell in (11, 13))
    assert len(store.asked) == len(set(store.asked))


@pytest.mark.parametrize(
    ("fails", "limited_by"),
    [
        (lambda cell, seed, whole: cell > 20, "share"),
        # One failure each from cell 18 on: the fourth is at 21, which itself still holds.
        (lambda cell, seed, whole: not whole and cell >= 18 and seed == 0, "gives way"),
        (lambda cell, seed, whole: False, "search"),
    ],
)
def test_a_threshold_says_what_stopped_it(fails: Fails, limited_by: str) -> None:
    (threshold,) = find_thresholds(NominalAgent(usual_robot()), [FORWARD], KnownOutcomes(fails), num_slots=1)
    assert threshold.limited_by == limited_by
    assert (threshold.trials, threshold.recovered) == (40, 40)


def test_the_whole_trials_at_a_threshold_can_be_read_again() -> None:
    store = KnownOutcomes(lambda cell, seed, whole: cell > 20 or seed == 3)
    (threshold,) = find_thresholds(NominalAgent(usual_robot()), [FORWARD], store, num_slots=1)
    outcomes = full_length_outcomes(threshold, store)
    assert [outcome.recovered for outcome in outcomes] == [seed != 3 for seed in range(40)]


def test_a_wilson_interval_by_hand() -> None:
    # 38 of 40, z = 1.96: center (0.95 + 1.96^2/80) / (1 + 1.96^2/40) = 0.9106, half width 0.0756.
    low, high = wilson_interval(38, 40)
    assert low == pytest.approx(0.9106 - 0.0756, abs=5e-4)
    assert high == pytest.approx(0.9106 + 0.0756, abs=5e-4)
    assert wilson_interval(0, 0) == (0.0, 1.0)
    assert wilson_interval(40, 40)[1] == pytest.approx(1.0)


def test_lines_are_evenly_spaced_and_named() -> None:
    assert [line.name for line in push_lines()] == ["forward", "left", "backward", "right"]
    assert push_lines()[1].trial(1, 0, True).push.direction == (0.0, 1.0, 0.0)
    sixteen = push_lines(num_directions=16)
    assert [line.name for line in sixteen[:4]] == ["forward", "22.5", "45", "67.5"]
    np.testing.assert_allclose(np.diff([line.angle for line in sixteen]), np.pi / 8)


def test_a_height_is_searched_in_steps_of_5_cm() -> None:
    (line,) = Scenario("landing_height", search="height", directions=1).lines()
    height, store = threshold_where(lambda cell, seed, whole: cell > 11, line)
    assert height == 0.55
    assert {trial.drop.height for trial in store.asked if not trial.full_length and cell_of(trial) <= 3} == {
        0.05,
        0.1,
        0.15,
    }


def test_a_tilt_is_searched_in_steps_of_1_degree_from_its_height() -> None:
    line = Scenario("landing_tilt", search="tilt", drop=0.4).lines()[1]
    tilt, store = threshold_where(lambda cell, seed, whole: cell > 7, line)
    assert tilt == 7.0
    assert {trial.drop.height for trial in store.asked} == {0.4}
    # To the left: the right side up, a negative roll.
    assert min(trial.drop.roll for trial in store.asked) == pytest.approx(math.radians(-60.0 + 1.0), abs=0.02)


def test_two_lines_that_need_the_same_trials_run_them_once_and_judge_each_by_its_own_rule() -> None:
    lines = [Scenario(name, directions=1, without_step=no).lines()[0] for name, no in (("any", False), ("none", True))]

    def steps_from_36_ns(trial: Trial) -> Outcome:
        return an_outcome(recovered=cell_of(trial) <= 20, foot_shift=0.2 if cell_of(trial) > 5 else 0.0)

    for num_slots in (1, 16, 200):
        arena = Arena(lines, steps_from_36_ns, num_slots, store=Memory())
        assert [threshold.size for threshold in arena.thresholds] == [120.0, 30.0]
        assert len(arena.begun) == len(set(arena.begun))


def rough(cell: int, seed: int, whole: bool) -> bool:
    """Fails ever more often from 60 to 240 Ns, now and then before."""
    chance = np.clip((cell - 10) / 30, 0.01, 1.0)
    return np.random.default_rng([cell, seed, whole]).random() < chance


@pytest.mark.parametrize("num_slots", [1, 7, 192])
def test_looking_ahead_changes_no_result(monkeypatch: pytest.MonkeyPatch, num_slots: int) -> None:
    (expected,) = find_thresholds(NominalAgent(usual_robot()), [FORWARD], KnownOutcomes(rough), num_slots=1)
    assert 0.0 < expected.size < 240.0
    for look_ahead in (1, 3):
        monkeypatch.setattr(climb, "LOOK_AHEAD", look_ahead)
        for seed in range(3):  # of the order in which trials end
            arena = Arena([FORWARD], by_rule(rough), num_slots, seed)
            assert arena.thresholds == [expected]
            assert len(arena.begun) == len(set(arena.begun))


def test_idle_robots_judge_the_next_candidates_by_six_trials_each() -> None:
    # 126 Ns look good when sampled, but nothing from 108 Ns on holds.
    def fails(cell: int, seed: int, whole: bool) -> bool:
        return cell > 21 or (whole and cell >= 18 and seed % 2 == 0)

    arena = Arena([FORWARD], by_rule(fails), num_slots=192)
    assert [threshold.size for threshold in arena.thresholds] == [102.0]
    # Six trials of the candidate first; then six of each of the eleven below it.
    first = [cell_of(trial) for trial in arena.begun if trial.full_length][:72]
    assert first == [cell for cell in range(21, 9, -1) for _ in range(6)]
    assert arena.most[21] == 6


def test_robots_that_are_needed_elsewhere_do_not_look_ahead() -> None:
    # Left is through soon, with 18 Ns; forward climbs to 600 Ns and keeps four robots busy all the while.
    def outcome(trial: Trial) -> Outcome:
        left = trial.push.direction[1] > 0.5
        return an_outcome(recovered=cell_of(trial) <= (3 if left else 100))

    arena = Arena([LEFT, FORWARD], outcome, num_slots=4)
    assert [threshold.size for threshold in arena.thresholds] == [18.0, 600.0]
    judged = [trial for trial in arena.begun if trial.full_length and trial.push.direction[1] > 0.5]
    assert {cell_of(trial) for trial in judged if cell_of(trial) <= 3} == {3}


def test_what_was_looked_ahead_for_is_dropped_once_the_candidate_holds() -> None:
    num_dropped = []
    for seed in range(4):  # of the order in which trials end: in some the candidate's are the last
        store = Memory()
        arena = Arena([FORWARD], by_rule(lambda cell, seed, whole: cell > 20), 192, seed, store)
        assert [threshold.size for threshold in arena.thresholds] == [120.0]
        ahead = [trial for trial in arena.begun if trial.full_length and cell_of(trial) < 20]
        assert len(ahead) <= 11 * 6
        num_dropped.append(sum(trial not in store for trial in ahead))
    assert max(num_dropped) > 0


def test_a_search_that_is_taken_up_again_repeats_nothing_and_ends_alike() -> None:
    store = Memory()
    whole = Arena([FORWARD, LEFT], by_rule(rough), 16)

    class KilledError(Exception):
        pass

    def killed_at_200(trial: Trial) -> Outcome:
        if len(store) == 200:
            raise KilledError
        return by_rule(rough)(trial)

    with pytest.raises(KilledError):
        Arena([FORWARD, LEFT], killed_at_200, 16, store=store)
    before = set(store)
    resumed = Arena([FORWARD, LEFT], by_rule(rough), 16, seed=1, store=store)
    assert resumed.thresholds == whole.thresholds
    assert not before & set(resumed.begun)
    assert Arena([FORWARD, LEFT], by_rule(rough), 16, store=store).begun == []
