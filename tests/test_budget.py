"""The budget of a training: minutes are turned into policy steps once, and nothing else follows the clock."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from conftest import tiny

from surefoot.learning.budget import SPEED, SPENT, budget_for
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.schedule import Schedule


def test_minutes_become_policy_steps_once_and_the_schedules_follow_these(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = dataclasses.replace(tiny("ppo"), steps=None, minutes=2.0)
    folder, measured = RunFolder.create(tmp_path / "run", config), list[str]()

    def measure() -> dict[str, float]:
        measured.append("again")
        return {SPEED: 1000.0 * len(measured), SPENT: 20.0}

    budget = budget_for(config, folder, measure)
    assert budget.steps == 85_000  # 0.85 * 1000 / s * (120 s - 20 s)
    assert (budget_for(config, RunFolder(tmp_path / "run"), measure), len(measured)) == (budget, 1)
    schedule, found = Schedule(config, budget), []
    for clock in (0.0, 3600.0):
        monkeypatch.setattr("surefoot.learning.schedule.time.monotonic", lambda clock=clock: clock)
        schedule.start() if not found else None
        schedule.update(42_500)
        found.append((schedule.share, schedule.position, schedule.exploration_share, schedule.learning_rate()))
    assert schedule.seconds == 3600.0
    assert found[0] == found[1]
    assert found[0][0] == 0.5
