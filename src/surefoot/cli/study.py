"""Study: the training, evaluation and report of the paper's three algorithms over several seeds.

Every stage leaves its result in the folder and is skipped if the result is there. A training leaves its run folder and
a mark, and an evaluation its rows in the results table. An interrupted training continues from its checkpoint, and an
interrupted evaluation after its last trial.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from surefoot.agents.load import load_policy
from surefoot.evaluation.evaluate import OnProgress, evaluate_and_store
from surefoot.evaluation.results import Results
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.spread import spread
from surefoot.evaluation.suites import PAPER
from surefoot.executors import Executor
from surefoot.executors.shared_folder import check_shared
from surefoot.learning.config import TrainConfig, with_budget
from surefoot.learning.curve import read_curves
from surefoot.learning.preset_file import preset
from surefoot.learning.schedule import Progress
from surefoot.learning.train import go_on
from surefoot.report.page import Report, make_report
from surefoot.whole_file import write_whole

ALGORITHMS = ("trpo", "ppo", "ddpg")
FULL_SEEDS, FAST_SEEDS = 7, 3
"""The paper averages over 7 learning trials."""
GUESSED_EVALUATION_S = 300.0
"""Time of an evaluation while none has been measured."""

_TRAINED = ".trained"


@dataclass(frozen=True)
class Study:
    """The work of a study, and its folder.

    Attributes:
        minutes: of each training; the preset's without it.
    """

    out: Path
    num_seeds: int = FULL_SEEDS
    minutes: float | None = None
    preset: str = "fast"
    algorithms: tuple[str, ...] = ALGORITHMS
    scenarios: tuple[Scenario, ...] = PAPER

    @property
    def results(self) -> Path:
        """The results table of all evaluations."""
        return self.out / "results.sqlite"

    def runs(self) -> list[Run]:
        """All trainings, seed by seed, so that every algorithm has as many when it is cut short."""
        return [
            Run(
                self.out / f"{algorithm}-{seed}",
                with_budget(preset(self.preset, algorithm), self.minutes, None, seed),
                self,
            )
            for seed in range(self.num_seeds)
            for algorithm in self.algorithms
        ]


@dataclass(frozen=True)
class Run:
    """One training and its evaluation."""

    folder: Path
    config: TrainConfig
    study: Study

    @property
    def is_trained(self) -> bool:
        """Has the training come to its end?"""
        return (self.folder / _TRAINED).exists()

    @property
    def is_evaluated(self) -> bool:
        """Are all scenarios of the study in the results table, for this very policy?"""
        if not self.is_trained or not self.study.results.exists():
            return False
        policy = load_policy(self.folder)
        with Results(self.study.results) as results:
            finished = results.finished_scenarios(policy)
        return {scenario.name for scenario in self.study.scenarios} <= finished


def train_run(run: Run, on_progress: Callable[[Progress], None] | None = None) -> None:
    """Train, from the checkpoint if there is one.

    Raises:
        KeyboardInterrupt: on Ctrl-C, after a checkpoint.
        UserError: the folder holds something else.
    """
    if run.is_trained:
        return
    go_on(run.config, run.folder, on_progress)
    (run.folder / _TRAINED).touch()


def train_shared(run: Run) -> None:
    """Train on a worker, in a folder that it shares with who asks; errors are those of `train_run`."""
    check_shared(run.study.out)
    train_run(run)


def evaluate_runs(runs: Sequence[Run], executor: Executor, on_progress: OnProgress | None = None) -> None:
    """Run all scenarios of the study that are not in the results table yet, all runs' lines together."""
    todo = [(load_policy(run.folder), run.study) for run in runs if not run.is_evaluated]
    if not todo:
        return
    study = todo[0][1]
    with Results(study.results) as results:
        found = spread([policy for policy, _ in todo], study.scenarios, results, executor, on_progress)
        for policy, _ in todo:
            spent = sum(done.seconds for task, done in found if task.agent.digest == policy.digest)
            evaluate_and_store(policy, study.scenarios, results, spent_s=spent)


def evaluate_run(run: Run, on_progress: OnProgress | None = None) -> None:
    """Run all scenarios of the study that are not in the results table yet."""
    if run.is_evaluated:
        return
    with Results(run.study.results) as results:
        evaluate_and_store(load_policy(run.folder), run.study.scenarios, results, on_progress)


def report_study(study: Study, on_progress: Callable[[str], None] = lambda words: None) -> Report:
    """The report of all evaluations so far, with the learning curves; also written to the study's folder."""
    folders = [run.folder for run in study.runs() if run.is_trained]
    report = make_report([study.results], read_curves(study.out), folders, on_progress=on_progress)
    write_whole(study.out / "report.html", report.html().encode())
    write_whole(study.out / "report.md", report.markdown().encode())
    return report


def seconds_left(runs: Sequence[Run], measured: Iterable[float] = ()) -> float:
    """Time that the stages which are not done yet will take [s].

    Args:
        runs: of the study.
        measured: time of the evaluations so far [s].
    """
    known = list(measured)
    evaluation = sum(known) / len(known) if known else GUESSED_EVALUATION_S
    training = sum(60.0 * run.config.minutes for run in runs if not run.is_trained)
    return training + evaluation * sum(not run.is_evaluated for run in runs)
