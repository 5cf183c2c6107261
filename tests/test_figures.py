"""Figures for machines: their keys, and what they say of results whose numbers are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import an_outcome

from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.suites import PAPER
from surefoot.evaluation.threshold_search import Threshold
from surefoot.evaluation.trials import Trial
from surefoot.report.metrics import flat_metrics, share_kept
from surefoot.report.thresholds import by_scenario
from surefoot.robots import Robot

BY_NAME = {scenario.name: scenario for scenario in PAPER}
FELL = an_outcome(
    recovered=False, reason="fell", com_speed=math.nan, quiet_drift=math.nan, quiet_power=math.nan, quiet_steps=math.nan
)


def found(name: str, *sizes: float) -> list[Threshold]:
    pairs = zip(BY_NAME[name].lines(), sizes, strict=True)
    return [Threshold(line, size, 40, 39, 0.87123, 0.99456, "share") for line, size in pairs]


def fixed(name: str, *outcomes: Outcome) -> dict[str, dict[Trial, Outcome]]:
    return {name: {Trial(seed=seed): outcome for seed, outcome in enumerate(outcomes)}}


def figures_of(robot: Robot, thresholds: list[Threshold], outcomes: dict | None = None) -> dict[str, float]:
    return flat_metrics(thresholds, outcomes or {}, (0.98765, 0.5), robot, robot.pose("bent"), 12.345)


def test_a_searched_scenario_has_its_directions_and_its_extremes(robot: Robot) -> None:
    figures = figures_of(robot, found("root_push", 120.0, 84.0, 96.0, 90.0))
    assert {key: value for key, value in figures.items() if key.startswith("root_push.left")} == {
        "root_push.left": 84.0, "root_push.left.trials": 40, "root_push.left.recovered": 39,
        "root_push.left.share_low": 0.8712, "root_push.left.share_high": 0.9946,
    }  # fmt: skip
    assert (figures["root_push.worst"], figures["root_push.best"], figures["root_push.directions"]) == (
        84,
        120,
        4,
    )
    assert figures["root_push.worst_Ns_per_kg"] == pytest.approx(84 / 137.287494, abs=5e-5)
    assert figures["root_push.best_Ns_per_kg"] == pytest.approx(120 / 137.287494, abs=5e-5)


def test_every_evaluation_has_its_audit_its_bounds_and_its_time(robot: Robot) -> None:
    figures = figures_of(robot, [])
    assert set(figures) == {
        "audit.worst_torque_ratio", "audit.worst_speed_ratio", "bound.forward", "bound.left", "bound.backward",
        "bound.right", "evaluate.wall_s",
    }  # fmt: skip
    assert (figures["audit.worst_torque_ratio"], figures["audit.worst_speed_ratio"]) == (0.9877, 0.5)
    assert figures["evaluate.wall_s"] == pytest.approx(12.345, abs=0.0051)
    assert figures["bound.left"] == pytest.approx(figures["bound.right"], rel=0.02)


def test_the_papers_other_tests_have_figures_of_their_own(robot: Robot) -> None:
    thresholds = [
        *found("root_push", 120.0, 84.0, 96.0, 90.0), *found("root_push_no_step", 72.0, 66.0, 54.0, 78.0),
        *found("landing_height", 0.55), *found("landing_tilt", 5.0, 3.0, 4.0, 6.0),
        *found("combined", 60.0, 48.0, 54.0, 72.0), *found("noise_both", 60.0, 84.0, 48.0, 120.0),
        *found("noise_action", 120.0, 84.0, 96.0, 0.0),
    ]  # fmt: skip
    figures = figures_of(robot, thresholds)
    assert (figures["root_push_no_step.sagittal"], figures["root_push_no_step.lateral"]) == (54.0, 66.0)
    assert (figures["landing.height_m"], figures["landing.angle_deg"]) == (0.55, 3.0)
    assert figures["combined.horizontal_Ns"] == 48.0
    # (60/120 + 84/84 + 48/96 + min(1, 120/90)) / 4 = 0.75, and (1 + 1 + 1 + 0) / 4
    assert figures["noise.share_kept"] == 0.75
    assert figures["noise.action_share_kept"] == 0.75
    assert "noise.observation_share_kept" not in figures
    assert all(np.isfinite(value) for value in figures.values())


def test_the_share_kept_by_hand() -> None:
    clean = by_scenario(found("root_push", 100.0, 50.0, 0.0, 80.0))["root_push"]
    noisy = by_scenario(found("noise_both", 50.0, 60.0, 30.0, 20.0))["noise_both"]
    # 0.5, 1 (not more than all of it), 0 (of nothing nothing is kept), 0.25
    assert share_kept(clean, noisy) == pytest.approx(1.75 / 4)
    # Sixteen directions undisturbed, four with noise: those four are compared.
    sixteen = {
        line.name: Threshold(line, 60.0, 40, 40, 0.9, 1.0, "share")
        for line in Scenario("root_push", directions=16).lines()
    }
    assert share_kept(sixteen, noisy) == pytest.approx((50 / 60 + 1.0 + 0.5 + 20 / 60) / 4)


def test_quiet_standing_is_the_largest_drift_and_all_the_steps(robot: Robot) -> None:
    stood = (
        an_outcome(quiet_drift=0.01234, quiet_power=3.0),
        an_outcome(quiet_drift=0.002, quiet_power=4.567, quiet_steps=2.0),
    )
    figures = figures_of(robot, [], fixed("quiet", *stood))
    assert (figures["quiet.com_drift_m"], figures["quiet.mean_power_W"], figures["quiet.steps"]) == (0.0123, 4.57, 2.0)
    # Who does not stand for a minute is not quiet.
    figures = figures_of(robot, [], fixed("quiet", *stood, FELL))
    assert all(math.isnan(figures[f"quiet.{key}"]) for key in ("com_drift_m", "mean_power_W", "steps"))


def test_quiet_after_a_push_is_that_of_the_recovered_and_says_how_many_they_are(robot: Robot) -> None:
    outcomes = fixed("quiet_after_48", an_outcome(quiet_steps=1.0), an_outcome(quiet_drift=0.03))
    outcomes |= fixed("quiet_after_150", FELL, an_outcome(quiet_power=9.0))
    figures = figures_of(robot, [], outcomes)
    assert figures["quiet_after_push.recovered_share"] == 0.75
    assert figures["quiet_after_push.com_drift_m"] == 0.03
    assert (figures["quiet_after_push.mean_power_W"], figures["quiet_after_push.steps"]) == (9.0, 1.0)
    none = figures_of(robot, [], fixed("quiet_after_48", FELL))
    assert none["quiet_after_push.recovered_share"] == 0.0
    assert math.isnan(none["quiet_after_push.com_drift_m"])


def test_scenarios_of_a_users_own_directions_have_their_own_keys_only(robot: Robot) -> None:
    thresholds = [
        Threshold(line, 60.0, 40, 40, 0.9, 1.0, "share")
        for name, angle in (("root_push", 0.0), ("root_push_no_step", 45.0), ("noise_both", 45.0))
        for line in Scenario(name, directions=(angle,)).lines()
    ]
    figures = figures_of(robot, thresholds)
    assert figures["root_push_no_step.45"] == 60.0
    assert not {"root_push_no_step.sagittal", "noise.share_kept"} & set(figures)


def test_pushes_at_the_root_stand_under_the_last_versions_names_too(robot: Robot) -> None:
    figures = figures_of(robot, found("root_push", 120.0, 84.0, 96.0, 90.0))
    new = {key: value for key, value in figures.items() if key.startswith("root_push.")}
    assert new["root_push.left"] == 84.0
    assert {key.replace("root_", "pelvis_"): value for key, value in new.items()}.items() <= figures.items()
