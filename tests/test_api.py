"""`import surefoot`: what a script needs, loaded when it is used, and documented."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import surefoot
from surefoot.errors import UserError
from surefoot.evaluation.scenarios import Scenario

NAMES = [name for name in surefoot.__all__ if not name.startswith("__")]


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_there_and_says_what_it_takes_and_what_it_gives(name: str) -> None:
    found = getattr(surefoot, name)
    doc = inspect.getdoc(found) or ""
    assert len(doc) > 40
    if inspect.isfunction(found):
        arguments = [p for p in inspect.signature(found).parameters.values() if p.kind != p.VAR_KEYWORD]
        assert all(f"{p.name}" in doc for p in arguments), doc
    else:
        assert found is UserError or ":" in doc


def test_names_are_listed_for_completion_and_a_wrong_one_names_the_valid_ones() -> None:
    assert set(NAMES) <= set(dir(surefoot))
    with pytest.raises(AttributeError, match=r"module 'surefoot' has no attribute 'evaluat'; valid: .*evaluate"):
        surefoot.evaluat  # noqa: B018


def test_importing_surefoot_loads_nothing_heavy() -> None:
    heavy = ("torch", "mujoco", "onnxruntime", "matplotlib", "viser", "scipy", "pyarrow")
    code = f"import sys, surefoot; loaded = [m for m in {heavy} if m in sys.modules]; assert not loaded, loaded"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_one_trial_is_run_by_name_of_policy_and_push() -> None:
    nominal = surefoot.load_agent("nominal")
    weak, strong = (
        surefoot.run_trial(nominal, surefoot.Trial(surefoot.horizontal_push("root", 0.0, size), full_length=False))
        for size in (30.0, 150.0)
    )
    assert weak.recovered
    assert (strong.recovered, strong.reason) == (False, "fell")


def test_scenarios_of_ones_own_are_evaluated_and_kept(tmp_path: Path) -> None:
    """Held by its impedance alone the robot survives no push of 150 Ns: the search ends at the first cells."""
    own = Scenario("shove", directions=("forward",), impulse=150.0, search="", trials=2, horizon=3.0, quiet_from=1.0)
    assert surefoot.evaluate("nominal", [own], results=tmp_path / "r.sqlite") == []
    with pytest.raises(UserError, match="unknown suite 'everything'; valid: push, paper"):
        surefoot.evaluate("nominal", "everything")
    from surefoot.evaluation.results import Results

    with Results(tmp_path / "r.sqlite") as results:
        outcomes = results.fixed_outcomes("nominal-bent")["shove"]
    assert [outcome.reason for outcome in outcomes.values()] == ["fell", "fell"]
