"""The search for the rejected impulse, against stores whose outcome is known for every trial, and on the real robot."""

import numpy as np
import pytest

from surefoot.evaluation import (
    GRID,
    NUM_SAMPLED,
    NUM_WHOLE,
    find_thresholds,
    push_lines,
    wilson_interval,
)
from surefoot.policy import NominalPolicy
from surefoot.trials import Outcome, Trial, run_list


class KnownOutcomes:
    """A store that has every trial already: what the search concludes from them can be worked out by hand.

    Args:
        fails: (cell, seed, whole) -> does the trial fail?
    """

    def __init__(self, fails):
        self.fails = fails
        self.asked: list[Trial] = []

    def get(self, trial: Trial) -> Outcome:
        self.asked.append(trial)
        failed = self.fails(round(trial.push.impulse / GRID), trial.seed, trial.whole)
        return Outcome(not failed, "fell" if failed else "recovered", 1.0, 0.0, 0.0, 0.5, 0.5)

    def put(self, trial: Trial, outcome: Outcome) -> None:
        raise AssertionError("a known trial was run again")


def threshold_where(fails) -> tuple[float, KnownOutcomes]:
    store = KnownOutcomes(fails)
    (threshold,) = find_thresholds(NominalPolicy(), push_lines()[:1], store, num_slots=1)
    return threshold.impulse, store


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
        sampled = {t.seed for t in store.asked if not t.whole and round(t.push.impulse / GRID) == cell}
        assert sampled == set(range(NUM_SAMPLED))
    assert {t.seed for t in store.asked if t.whole and t.push.impulse == 120.0} == set(range(NUM_WHOLE))


def test_no_trial_is_asked_for_twice() -> None:
    _, store = threshold_where(lambda cell, seed, whole: cell > 20 or cell in (11, 13))
    assert len(store.asked) == len(set(store.asked))


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


def test_holding_the_nominal_pose_rejects_what_its_own_trials_say() -> None:
    """The real robot: at the threshold found, 40 fresh runs of the whole trials recover as often as reported."""
    policy = NominalPolicy(pose="straight")
    backward = push_lines()[2]
    (threshold,) = find_thresholds(policy, [backward])
    assert 0.0 < threshold.impulse < 60.0
    cell = round(threshold.impulse / GRID)
    outcomes = run_list(policy, [backward.trial(cell, seed, whole=True) for seed in range(NUM_WHOLE)])
    assert sum(outcome.recovered for outcome in outcomes.values()) == threshold.recovered >= 38
