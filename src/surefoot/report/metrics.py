"""Metrics: the figures of a policy as one flat object for machines, with stable keys (docs/figures.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.scenarios import DIRECTIONS, limited_name, readable_name
from surefoot.evaluation.threshold_search import Threshold
from surefoot.evaluation.trials import Trial
from surefoot.report.bounds import capture_point_bound
from surefoot.report.thresholds import LATERAL, SAGITTAL, by_scenario, has_main_directions
from surefoot.robots import Robot

PUSHES = ("root_push", "root_push_no_step", "torso_push", "thigh_push", "shank_push")
_LANDING = {"landing_height": "height_m", "landing_tilt": "angle_deg", "combined": "horizontal_Ns"}
"""Scenario -> last part of its metric's key."""
QUIET_AFTER = "quiet_after_"


def flat_metrics(
    thresholds: Sequence[Threshold],
    fixed: Mapping[str, Mapping[Trial, Outcome]],
    audit: tuple[float, float],
    robot: Robot,
    pose: np.ndarray,
    wall_s: float,
) -> dict[str, float]:
    """The figures of `surefoot evaluate --json`; scenarios that were not run are left out.

    Args:
        thresholds: of one policy.
        fixed: outcomes of the scenarios in which nothing is searched, by scenario.
        audit: largest share of a torque and of a speed limit over all trials.
        robot: robot of the thresholds.
        pose: the policy's nominal joint angles [rad].
        wall_s: time of the evaluation [s].
    """
    figures: dict[str, float] = {}
    found = by_scenario(thresholds)
    for name, lines in found.items():
        figures |= _threshold_figures(name, list(lines.values()), robot)
    for name in ("root_push", "root_push_no_step"):
        figures |= _plane_figures(name, found.get(name, {}))
        figures |= _plane_figures(limited_name(name), found.get(limited_name(name), {}))
    for name, end in _LANDING.items():
        for named in (str, limited_name):
            if found_lines := found.get(named(name)):
                figures[f"{named(name.split('_')[0])}.{end}"] = min(t.size for t in found_lines.values())
    figures |= _noise_figures(found)
    figures |= _quiet_figures(fixed)
    for name, outcomes in fixed.items():
        figures[f"{name}.trials"] = len(outcomes)
        figures[f"{name}.recovered"] = sum(outcome.recovered for outcome in outcomes.values())
    figures["audit.worst_torque_ratio"], figures["audit.worst_speed_ratio"] = (round(share, 4) for share in audit)
    for name, bound in zip(DIRECTIONS, capture_point_bound(robot, pose, list(DIRECTIONS.values())), strict=True):
        figures[f"bound.{name}"] = round(bound, 1)
    figures["evaluate.wall_s"] = round(wall_s, 2)
    return figures | _with_old_names(figures, robot)


def _plane_figures(name: str, lines: Mapping[str, Threshold]) -> dict[str, float]:
    """The worse direction of each plane, and the better sagittal one, of which the paper speaks."""
    if not has_main_directions(lines):
        return {}
    sagittal = [lines[d].size for d in SAGITTAL]
    return {
        f"{name}.sagittal": min(sagittal),
        f"{name}.better_sagittal": max(sagittal),
        f"{name}.lateral": min(lines[d].size for d in LATERAL),
    }


def _with_old_names(figures: Mapping[str, float], robot: Robot) -> dict[str, float]:
    """The metrics of pushes at the root once more under the robot's own word for it, as the last version named them."""
    old = {readable_name(key, robot.root): value for key, value in figures.items()}
    return {key: value for key, value in old.items() if key not in figures}


def share_kept(clean: Mapping[str, Threshold], disturbed: Mapping[str, Threshold]) -> float:
    """Mean over the directions of what is kept of the undisturbed threshold, at most all of it."""
    return float(np.mean([min(1.0, disturbed[d].size / clean[d].size) if clean[d].size else 0.0 for d in disturbed]))


def _threshold_figures(name: str, thresholds: Sequence[Threshold], robot: Robot) -> dict[str, float]:
    figures: dict[str, float] = {}
    for t in thresholds:
        key = f"{name}.{t.line.name}"
        figures[key] = t.size
        figures[f"{key}.trials"] = t.trials
        figures[f"{key}.recovered"] = t.recovered
        figures[f"{key}.share_low"] = round(t.low, 4)
        figures[f"{key}.share_high"] = round(t.high, 4)
    sizes = [t.size for t in thresholds]
    figures[f"{name}.worst"], figures[f"{name}.best"] = min(sizes), max(sizes)
    figures[f"{name}.directions"] = len(sizes)
    if name in PUSHES or name in map(limited_name, PUSHES):
        figures[f"{name}.worst_Ns_per_kg"] = round(min(sizes) / robot.mass, 4)
        figures[f"{name}.best_Ns_per_kg"] = round(max(sizes) / robot.mass, 4)
    return figures


def _noise_figures(found: Mapping[str, Mapping[str, Threshold]]) -> dict[str, float]:
    if "root_push" not in found:
        return {}
    clean = found["root_push"]
    keys = {
        "noise_both": "noise.share_kept",
        "noise_observation": "noise.observation_share_kept",
        "noise_action": "noise.action_share_kept",
    }
    comparable = {name: lines for name, lines in found.items() if lines.keys() <= clean.keys()}
    return {key: round(share_kept(clean, comparable[name]), 4) for name, key in keys.items() if name in comparable}


def _quiet_figures(fixed: Mapping[str, Mapping[Trial, Outcome]]) -> dict[str, float]:
    figures: dict[str, float] = {}
    if "quiet" in fixed:
        figures |= _stillness("quiet", list(fixed["quiet"].values()))
    after = [o for name, outcomes in fixed.items() if name.startswith(QUIET_AFTER) for o in outcomes.values()]
    if after:
        figures |= _stillness("quiet_after_push", [outcome for outcome in after if outcome.recovered])
        figures["quiet_after_push.recovered_share"] = round(float(np.mean([o.recovered for o in after])), 4)
    return figures


def _stillness(key: str, outcomes: Sequence[Outcome]) -> dict[str, float]:
    """Largest drift and power and all steps of some trials; NaN, JSON's null, if one did not stand to its end."""
    drift = max((o.quiet_drift for o in outcomes), default=math.nan)
    power = max((o.quiet_power for o in outcomes), default=math.nan)
    stood = bool(outcomes) and not any(math.isnan(o.quiet_drift) for o in outcomes)
    return {
        f"{key}.com_drift_m": round(drift, 4) if stood else math.nan,
        f"{key}.mean_power_W": round(power, 2) if stood else math.nan,
        f"{key}.steps": sum(o.quiet_steps for o in outcomes) if stood else math.nan,
    }
