"""Works: a training, an evaluation and a study, which the same call begins and goes on with, and checks of each."""

from __future__ import annotations

import dataclasses
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np
from conftest import tiny

import surefoot.learning.budget as budget_module
import surefoot.learning.train as train_module
from killing.told import Told
from surefoot.agents.load import usual_robot
from surefoot.agents.network import NetworkAgent
from surefoot.agents.nominal import NominalAgent
from surefoot.cli import study as study_module
from surefoot.evaluation.evaluate import run_scenarios
from surefoot.evaluation.results import Results
from surefoot.evaluation.results_schema import OUTCOME_COLUMNS
from surefoot.evaluation.scenarios import DIRECTIONS, Scenario
from surefoot.evaluation.trial_store import TrialStore
from surefoot.learning.curve import read_curve
from surefoot.learning.run_folder import BEST, CURVE, LAST, RunFolder
from surefoot.learning.train import Trainer, go_on
from surefoot.learning.validation import Validation

ALGORITHMS = ("ppo", "ddpg", "trpo")
STEPS, VALIDATION_STEPS, CHECKPOINT_S = 960, 320, 0.1
PROMISE_S = 0.5
"""An outcome is safe from a kill so long after it came [s]."""
MANY = tuple(
    Scenario(f"push_{impulse:g}", search="", directions=4, impulse=impulse, trials=4, horizon=2.0, quiet_from=0.0)
    for impulse in (12.0, 60.0, 120.0)
)
FEW = (Scenario("quick", search="", directions=2, impulse=12.0, trials=2, horizon=2.0, quiet_from=0.0),)


class Loss(NamedTuple):
    """What a kill has cost.

    Attributes:
        amount: policy steps, or outcomes of trials.
        seconds: time before the kill from which on they are lost.
        faults: in words, what must not be.
    """

    amount: int
    seconds: float
    faults: list[str]


class Work(NamedTuple):
    """Something that is killed again and again.

    Attributes:
        unit: of what is lost.
        run: does it in a folder, or goes on with it, and tells how far it is.
        check: what is lost by a kill.
        finish: faults of the whole when it is done.
    """

    unit: str
    run: Callable[[Path, Told, int], None]
    check: Callable[[Path, Told], Loss]
    finish: Callable[[Path], list[str]]


def score(policy: NetworkAgent) -> Validation:
    """A score that its digest draws, so that policies become better and worse: what is kept of it is tested here."""
    drawn = int(policy.digest[:8], 16) % 1000 / 1000.0
    none = dict.fromkeys(DIRECTIONS, 0.0)
    return Validation(
        recovered=drawn, within_limits=drawn, fell=0.0, rejected=none, rejected_within_limits=none, quiet=0.0, power=0.0
    )


def watch_training(told: Told) -> None:
    """Let trainings of this process score policies quickly, checkpoint often, and tell how far they are."""
    train_module.CHECKPOINT_S, budget_module.MIN_VALIDATION_STEPS = CHECKPOINT_S, VALIDATION_STEPS
    train_module.validation_for = lambda config: score  # type: ignore[assignment]
    saved, updated = Trainer.checkpoint, Trainer.update_progress

    def checkpoint(self: Trainer) -> None:
        saved(self)
        told.commit(self.progress.steps, self.kept.files.get(CURVE, b"").count(b"\n"), self.kept.best_score)

    def update_progress(self: Trainer) -> None:
        updated(self)
        told.step(self.progress.steps)

    Trainer.checkpoint, Trainer.update_progress = checkpoint, update_progress  # type: ignore[method-assign]


def train(folder: Path, told: Told, number: int) -> None:
    """A run of one of the algorithms, five validations long."""
    watch_training(told)
    go_on(dataclasses.replace(tiny(ALGORITHMS[number % 3]), steps=STEPS), folder)


def check_training(folder: Path, told: Told) -> Loss:
    """Every file of the run is whole; checkpoint, best policy and curve are those of the last commit or later."""
    run, faults = RunFolder(folder), list[str]()
    for file in (*folder.glob("*.onnx"), *folder.glob("kept/*.onnx")):
        NetworkAgent(file.read_bytes(), str(file))
    if (folder / "config.json").exists():
        run.config()
    if (folder / CURVE).exists():
        read_curve(folder / CURVE)
    if not run.has_checkpoint:
        lost = ["a checkpoint is gone"] * bool(told.committed_at)
        return Loss(told.steps, 0.0, lost)
    _, state = run.load_checkpoint()
    files, best, steps = run.restore_files(), float(state["best_score"]), run.num_steps()
    if told.committed_at and steps < told.committed_steps:
        faults.append(f"the checkpoint has {steps} steps, not {told.committed_steps}")
    if told.committed_at and best < told.committed_best:
        faults.append(f"the best score fell from {told.committed_best} to {best}")
    if files and BEST in files:
        kept = NetworkAgent((folder / BEST).read_bytes(), "best").contract.training["validation"]["recovered"]
        scores = [row["recovered"] for row in read_curve(folder / CURVE)]
        if not kept == best == max(scores):
            faults.append(f"the best policy has the score {kept}, the checkpoint {best}, the curve {max(scores)}")
        if (folder / CURVE).read_bytes().count(b"\n") < told.committed_rows:
            faults.append("a row of the curve is gone")
    lost_s = told.killed_at - told.committed_at if told.steps > steps and told.committed_at else 0.0
    return Loss(max(told.steps - steps, 0), lost_s, faults)


def finish_training(folder: Path) -> list[str]:
    """A run that is done has made its steps, and kept the best of all scores of its curve."""
    run = RunFolder(folder)
    scores = [row["recovered"] for row in read_curve(folder / CURVE)]
    best = NetworkAgent((folder / BEST).read_bytes(), "best").contract.training["validation"]["recovered"]
    faults = [] if run.num_steps() >= STEPS else [f"it made {run.num_steps()} steps"]
    if best != max(scores) or not (folder / LAST).exists():
        faults.append(f"best.onnx has the score {best} of {scores}")
    return faults + [f"{file.name} was left" for file in folder.rglob(".*")]


def watch_trials(told: Told) -> None:
    """Let trial stores of this process tell of every outcome that they are given."""
    put = TrialStore.put

    def tell(self: TrialStore, *arguments: object) -> None:
        at = time.monotonic()
        put(self, *arguments)  # type: ignore[arg-type]
        told.put(at)

    TrialStore.put = tell  # type: ignore[method-assign]


def evaluate(folder: Path, told: Told, number: int) -> None:
    """Trials of the nominal pose, 8 robots at a time, so that their outcomes come one after the other."""
    watch_trials(told)
    folder.mkdir(exist_ok=True)
    agent = NominalAgent(usual_robot())
    with Results(folder / "results.sqlite") as results:
        run_scenarios(agent, MANY, results.trials_of(agent), num_slots=8, num_threads=1)
        results.add_scenarios(agent, MANY, 1.0)


def check_evaluation(folder: Path, told: Told) -> Loss:
    """The table is whole, and has all outcomes but those of the last moment."""
    return _check_table(folder / "results.sqlite", folder / "known", told)


def _check_table(table: Path, known: Path, told: Told) -> Loss:
    """Compare the number of outcomes with that of the last time, which stands in the file `known`."""
    before = int(known.read_text()) if known.exists() else 0
    if not table.exists():
        return Loss(0, 0.0, ["the table is gone"] * bool(before))
    with closing(sqlite3.connect(table)) as db:
        (whole,) = db.execute("PRAGMA integrity_check").fetchone()
        has_trials = db.execute("SELECT count(*) FROM sqlite_master WHERE name = 'trials'").fetchone()[0]
        count = db.execute("SELECT count(*) FROM trials").fetchone()[0] if has_trials else 0
    known.write_text(str(count))
    found = count - before
    lost = told.num_puts - found
    seconds = told.killed_at - float(told.puts[found]) if lost > 0 else 0.0
    faults = [] if whole == "ok" else [f"the table is damaged: {whole}"]
    if seconds > PROMISE_S:
        faults.append(f"outcomes of {seconds:.2f} s are lost")
    return Loss(max(lost, 0), seconds, faults + ["outcomes of before are gone"] * (found < 0))


def finish_evaluation(folder: Path) -> list[str]:
    """An evaluation that was killed again and again has the very outcomes of one that was not."""
    reference = folder.parent / "reference" / "results.sqlite"
    if not reference.exists():
        return []
    same = _outcomes(folder / "results.sqlite") == _outcomes(reference)
    return [] if same else ["its outcomes differ from those of an evaluation without kills"]


def _outcomes(table: Path) -> list[tuple]:
    with closing(sqlite3.connect(table)) as db:
        return sorted(db.execute(f"SELECT trial, {OUTCOME_COLUMNS} FROM trials"), key=repr)


def reproduce(folder: Path, told: Told, number: int) -> None:
    """A study of one run: training by the clock, evaluation, page."""
    watch_training(told)
    watch_trials(told)
    study = _study(folder, number)
    for run in study.runs():
        study_module.train_run(run)
        study_module.evaluate_run(run)
    study_module.report_study(study)


def _study(folder: Path, number: int) -> study_module.Study:
    small = lambda name, algorithm: dataclasses.replace(tiny(algorithm), steps=None)  # noqa: E731
    study_module.preset = small
    return study_module.Study(folder, 1, 0.06, "tiny", (ALGORITHMS[number % 3],), FEW)


def check_study(folder: Path, told: Told) -> Loss:
    """Its run and its table are whole; a run that is marked as trained has used up its budget."""
    lost, seconds, faults = 0, 0.0, list[str]()
    for run in folder.glob("*-0"):
        lost, seconds, faults = check_training(run, told)
        if (run / ".trained").exists() and not (run / BEST).exists():
            faults.append("it is marked as trained and has no policy")
    trials, before, more = _check_table(folder / "results.sqlite", folder / "known", told)
    page = folder / "report.html"
    if page.exists() and not page.read_text().rstrip().endswith("</html>"):
        faults.append("the page is cut short")
    return Loss(lost + trials, max(seconds, before), faults + more)


def finish_study(folder: Path) -> list[str]:
    """A study that is done has a policy, four outcomes and a page."""
    (run,) = folder.glob("*-0")
    with closing(sqlite3.connect(folder / "results.sqlite")) as db:
        (count,) = db.execute("SELECT count(*) FROM trials").fetchone()
    faults = [] if count == 4 else [f"it has {count} outcomes, not 4"]
    is_whole = (folder / "report.html").exists() and np.isfinite(read_curve(run / CURVE)[-1]["steps"])
    return faults + ([] if is_whole else ["it has no page"])


WORKS = {
    "training": Work("policy steps", train, check_training, finish_training),
    "evaluation": Work("outcomes", evaluate, check_evaluation, finish_evaluation),
    "reproduce": Work("steps and outcomes", reproduce, check_study, finish_study),
}
