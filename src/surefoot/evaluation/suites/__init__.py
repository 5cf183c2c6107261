"""The suites that come with the package, read from the scenario files of this folder."""

from __future__ import annotations

import dataclasses

from surefoot.evaluation.scenario_file import SUITE_NAMES, suite
from surefoot.evaluation.scenarios import Scenario

SUITES: dict[str, tuple[Scenario, ...]] = {name: suite(name) for name in SUITE_NAMES}
"""Name -> scenarios."""
PAPER, ROBUSTNESS, RING = (SUITES[name] for name in ("paper", "robustness", "ring"))

_PAPER = {scenario.name: scenario for scenario in PAPER}

ROOT_16: Scenario = dataclasses.replace(_PAPER["root_push"], directions=16)
"""Pushes at the root in sixteen directions."""
SINGLE = {name: _PAPER[name] for name in ("sagittal_24", "sagittal_72", "sagittal_240", "lateral_78")}
"""The paper's four pushes of Table II (section V-A)."""
NOISE = {name: _PAPER[name] for name in ("noise_observation", "noise_action", "noise_both")}
"""Section V-D of the paper: noise on the observation before its filter, and on the joint targets [rad]."""
