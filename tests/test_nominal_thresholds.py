"""Thresholds of the nominal pose, by real trials."""

from __future__ import annotations

import pytest
from conftest import Memory

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation.evaluate import find_thresholds, run_scenarios
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.threshold_search import NUM_FULL_LENGTH
from surefoot.evaluation.trials import run_list

pytestmark = pytest.mark.slow


def test_holding_the_nominal_pose_rejects_what_its_own_trials_say() -> None:
    """At the threshold found, 40 fresh runs of the whole trials recover as often as reported."""
    policy, backward = NominalAgent(usual_robot(), "straight"), Scenario("short", horizon=3.0).lines()[2]
    (threshold,) = find_thresholds(policy, [backward], num_slots=32)
    assert 0.0 < threshold.size < 60.0
    cell = round(threshold.size / backward.grid)
    trials = [backward.trial(cell, seed, full_length=True) for seed in range(NUM_FULL_LENGTH)]
    outcomes = run_list(policy, trials, num_slots=40)
    assert sum(outcome.recovered for outcome in outcomes.values()) == threshold.recovered >= 38


def test_a_scenario_without_a_search_runs_exactly_its_trials() -> None:
    fixed = Scenario("hard", search="", impulse=400.0, directions=("left", 30.0), trials=2)
    store, told = Memory(), []
    thresholds = run_scenarios(
        NominalAgent(usual_robot()), [fixed], store, lambda *progress: told.append(progress[:2]), num_slots=4
    )
    assert thresholds == []
    assert set(store) == {trial for line in fixed.lines() for trial in line.fixed_trials()}
    assert sorted((round(trial.push.direction[0], 3), trial.seed) for trial in store) == [
        (0.0, 0), (0.0, 1), (0.866, 0), (0.866, 1)
    ]  # fmt: skip
    assert {outcome.reason for outcome in store.values()} == {"fell"}
    assert set(store.scenarios.values()) == {"hard"}
    # One after the other; both lines are through at the end.
    assert [num_trials for num_trials, _ in told] == [1, 2, 3, 4]
    assert told[-1] == (4, 2)


def test_scenarios_of_different_worlds_run_each_in_its_own() -> None:
    policy = NominalAgent(usual_robot())
    strong, weak = (
        Scenario(name, search="", impulse=400.0, directions=1, trials=1, motor_strength=strength)
        for name, strength in (("strong", 1.0), ("weak", 0.5))
    )
    store = Memory()
    run_scenarios(policy, [strong, weak, strong], store, num_slots=2, num_threads=1)
    assert sorted(store.scenarios.values()) == ["strong", "weak"]
    for trial, outcome in store.items():
        alone = run_list(policy, [trial], num_slots=1, domain=trial.domain)[trial]
        assert repr(outcome) == repr(alone)
    torque = {store.scenarios[trial]: max(outcome.torque_peaks) for trial, outcome in store.items()}
    assert torque == {"strong": 350.0, "weak": 175.0}


def test_a_trial_for_another_world_is_refused() -> None:
    (trial,) = Scenario("ice", search="", directions=1, trials=1, friction=0.1).lines()[0].fixed_trials()
    with pytest.raises(
        UserError, match=r"a trial has other domain parameters than this batch's, DomainParameters\(friction=None"
    ):
        run_list(NominalAgent(usual_robot()), [trial], num_slots=1, num_threads=1)
