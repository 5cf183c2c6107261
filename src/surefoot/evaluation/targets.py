"""Targets: the values that a policy is meant to reach, by the key of the flat figure (docs/figures.md)."""

from __future__ import annotations

TARGET_VALUES: dict[str, float] = {
    "root_push_within_limits.worst": 330.0,
    "root_push.worst": 450.0,
    "root_push.best": 600.0,
    "root_push_no_step.better_sagittal": 78.0,
    "root_push_no_step.sagittal": 66.0,
    "root_push_no_step.lateral": 96.0,
    "root_push_no_step.worst": 60.0,
    "torso_push.worst": 264.0,
    "thigh_push.worst": 360.0,
    "shank_push.worst": 264.0,
    "landing_within_limits.height_m": 0.55,
    "landing.height_m": 1.5,
    "landing.angle_deg": 24.0,
    "combined.horizontal_Ns": 240.0,
    "noise.action_share_kept": 0.9,
    "noise.observation_share_kept": 0.95,
    "quiet.com_drift_m": 0.01,
    "quiet.steps": 0.0,
    "quiet.mean_power_W": 5.0,
    "quiet_after_push.com_drift_m": 0.01,
    "quiet_after_push.steps": 0.0,
    "quiet_after_push.mean_power_W": 20.0,
}
"""Figure -> what is to be reached: at least for what a policy withstands, at most for how it stands."""

MAIN_DIRECTIONS: dict[str, tuple[float, float]] = {
    "trpo": (300.0, 240.0),
    "ppo": (300.0, 240.0),
    "ddpg": (300.0, 300.0),
}
"""Algorithm -> target of root_push.sagittal and root_push.lateral [Ns]."""
