"""Reproduce: stages that are done are skipped, and an interrupted one goes on where it was."""

from __future__ import annotations

import importlib.resources
import os
import re
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from surefoot.cli import study as reproduce
from surefoot.cli.reproduce import Reproduce
from surefoot.cli.study import Study
from surefoot.errors import UserError
from surefoot.evaluation.scenarios import Scenario
from surefoot.executors import open_executor
from surefoot.learning.budget import budget_for
from surefoot.learning.curve import read_curve
from surefoot.learning.preset_file import preset
from surefoot.learning.run_folder import RunFolder, discard_beginning
from surefoot.learning.schedule import Progress

pytestmark = pytest.mark.slow

SHIPPED = importlib.resources.files("surefoot.agents") / "shipped" / "ppo.onnx"
SCENARIOS = (Scenario("quick", search="", directions=2, impulse=12.0, trials=1, horizon=2.0, quiet_from=0.0),)


def study(out: Path, **changes) -> Study:
    """One short training, and an evaluation of two trials."""
    short = Study(out, 1, 5.0, "fast", ("ppo",), SCENARIOS)
    return replace(short, **changes)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """A study that was interrupted in its training, and went on."""
    out = tmp_path_factory.mktemp("study")
    first_sitting: list[float] = []

    def interrupt(progress: Progress) -> None:
        first_sitting.append(progress.seconds)
        os.kill(os.getpid(), signal.SIGINT)

    (run,) = study(out, minutes=5.0).runs()
    with pytest.raises(KeyboardInterrupt):
        reproduce.train_run(run, interrupt)
    assert not run.is_trained
    assert (run.folder / "checkpoint.npz").exists()
    whole = study(out, minutes=(first_sitting[0] + 2.0) / 60.0)
    (run,) = whole.runs()
    reproduce.train_run(run)
    curve = read_curve(run.folder / "curve.csv")
    # The minutes were turned into policy steps at the start, and these have been made.
    assert curve[-1]["steps"] >= budget_for(run.config, RunFolder(run.folder)).steps
    reproduce.evaluate_run(run)
    return whole


def test_the_paper_has_seven_seeds_and_the_fast_study_three(tmp_path: Path) -> None:
    runs = Study(tmp_path).runs()
    assert [run.folder.name for run in runs][:4] == ["trpo-0", "ppo-0", "ddpg-0", "trpo-1"]
    assert len(runs) == 21
    assert all(run.config.minutes == preset("fast", run.config.algorithm).minutes for run in runs)
    assert [run.config.seed for run in runs] == sorted(run.config.seed for run in runs)
    assert len(Study(tmp_path, reproduce.FAST_SEEDS).runs()) == 9


def test_stages_that_are_done_are_skipped(finished: Study) -> None:
    (run,) = finished.runs()
    assert run.is_trained
    assert run.is_evaluated

    def never(*_: object) -> None:
        raise AssertionError("this was done already")

    before = {file: file.stat().st_mtime_ns for file in run.folder.iterdir()}
    reproduce.train_run(run, never)
    reproduce.evaluate_run(run, never)
    assert {file: file.stat().st_mtime_ns for file in run.folder.iterdir()} == before


def test_the_report_holds_the_policy_and_its_learning_curve(finished: Study) -> None:
    report = reproduce.report_study(finished)
    assert [e.name for e in report.evaluations] == ["ppo-0"]
    assert [figure.slug for figure in report.comparison_figures] == ["learning"]
    page = (finished.out / "report.html").read_text()
    assert re.search(r"ppo, preset fast, seed 0", page)
    assert "| quick | 2 |" in (finished.out / "report.md").read_text()


def test_a_new_policy_is_evaluated_anew(finished: Study) -> None:
    (run,) = finished.runs()
    more = replace(finished, scenarios=(*SCENARIOS, Scenario("other", search="", trials=1)))
    assert not replace(run, study=more).is_evaluated
    data = (run.folder / "best.onnx").read_bytes()
    try:
        (run.folder / "best.onnx").write_bytes(SHIPPED.read_bytes())
        assert not run.is_evaluated
    finally:
        (run.folder / "best.onnx").write_bytes(data)


def test_a_training_killed_before_its_first_checkpoint_begins_anew(tmp_path: Path) -> None:
    (run,) = study(tmp_path).runs()
    run.folder.mkdir()
    for name in ("config.json", "events.out.tfevents.1"):
        (run.folder / name).write_text("{}")
    discard_beginning(run.folder)
    assert not run.folder.exists()


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path) -> None:
    (run,) = study(tmp_path).runs()
    run.folder.mkdir()
    (run.folder / "thesis.tex").write_text("years of work")
    with pytest.raises(UserError, match=r"ppo-0 holds thesis\.tex, which no training wrote; give another folder"):
        reproduce.train_run(run)
    assert (run.folder / "thesis.tex").read_text() == "years of work"


def test_time_left_is_the_budgets_and_the_mean_evaluation(tmp_path: Path) -> None:
    runs = Study(tmp_path, 1, minutes=2.0).runs()
    assert reproduce.seconds_left(runs, [100.0, 200.0]) == pytest.approx(3 * 120.0 + 3 * 150.0)
    runs[0].folder.mkdir()
    (runs[0].folder / ".trained").touch()
    (runs[0].folder / "best.onnx").write_bytes(SHIPPED.read_bytes())
    assert reproduce.seconds_left(runs) == pytest.approx(2 * 120.0 + 3 * reproduce.GUESSED_EVALUATION_S)


def test_workers_evaluate_all_that_is_trained_and_train_in_a_folder_that_they_share_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = study(tmp_path / "out")
    (run,) = short.runs()
    run.folder.mkdir(parents=True)
    shutil.copy(str(SHIPPED), run.folder / "best.onnx")
    (run.folder / ".trained").touch()
    with open_executor("processes", workers=1) as executor:
        Reproduce()._spread(short, executor)
        assert run.is_evaluated
        assert "1 of 1 trainings are done; 0 are left" in capsys.readouterr().err
        with pytest.raises(UserError, match=r"^worker \S+: it does not see the folder .*elsewhere; give one that all"):
            list(executor.run(reproduce.train_shared, [(study(tmp_path / "elsewhere").runs()[0],)]))
    assert not (tmp_path / "elsewhere").exists()
