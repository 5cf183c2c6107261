"""surefoot reproduce: run the paper's whole study."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from surefoot.cli.terminal import clock, evaluation_bar, needs_torch, say, training_bar
from surefoot.cli.work import Work

if TYPE_CHECKING:
    from surefoot.cli.study import Study
    from surefoot.executors import Executor


@dataclass(frozen=True)
class Reproduce(Work):
    """Run the paper's whole study: train three algorithms over seeds, evaluate them on its tests, make the page.

    Finished stages are skipped, so the same command continues after an interruption. Seven seeds as in the
    paper are 21 trainings of 15 to 20 minutes and as many evaluations: seven to eight hours on two free cores.
    """

    fast: bool = False
    """Use three seeds instead of seven."""
    minutes: float | None = None
    """Minutes of each training (default: the preset's)."""
    preset: str = "fast"
    """Preset of the trainings, as for `surefoot train`."""
    suite: str = "paper"
    """Suite of the evaluations, as for `surefoot evaluate`."""
    out: Path = Path("runs/reproduce")
    """Folder for run folders, results table and page."""

    def main(self) -> None:
        """Do what is left of the study."""
        with needs_torch():
            from surefoot.cli import study as reproduce
        from surefoot.agents.load import usual_robot
        from surefoot.evaluation.scenario_file import suite

        num_seeds = reproduce.FAST_SEEDS if self.fast else reproduce.FULL_SEEDS
        scenarios = suite(self.suite, usual_robot())
        study = reproduce.Study(self.out, num_seeds, self.minutes, self.preset, scenarios=scenarios)
        try:
            with self.opened() as executor:
                if executor.is_local:
                    self._run(study)
                else:
                    self._spread(study, executor)
                self._report(study)
        except KeyboardInterrupt:
            say("interrupted; the same command continues from here")
            raise

    def _run(self, study: Study) -> None:
        from surefoot.cli import study as reproduce

        runs, measured = study.runs(), list[float]()
        num_lines = sum(len(scenario.lines()) for scenario in study.scenarios)
        for number, run in enumerate(runs):
            for stage, is_done in (("train", run.is_trained), ("evaluate", run.is_evaluated)):
                words = f"{2 * number + 1 + (stage == 'evaluate')}/{2 * len(runs) + 1} {stage} {run.folder.name}"
                if is_done:
                    say(f"{words}: done before")
                    continue
                left = clock(reproduce.seconds_left(runs, measured))
                say(f"{words}; about {left} left in all")
                if stage == "train":
                    with training_bar() as show:
                        reproduce.train_run(run, show)
                else:
                    began = time.monotonic()
                    with evaluation_bar(num_lines) as watch:
                        reproduce.evaluate_run(run, watch)
                    measured.append(time.monotonic() - began)

    def _spread(self, study: Study, executor: Executor) -> None:
        """Let workers train all that is left, then evaluate all of it."""
        from surefoot.cli import study as reproduce

        runs = study.runs()
        todo = [run for run in runs if not run.is_trained]
        study.out.mkdir(parents=True, exist_ok=True)
        say(f"{len(runs) - len(todo)} of {len(runs)} trainings are done; {len(todo)} are left")
        for place, _ in executor.run(reproduce.train_shared, [(run,) for run in todo]):
            say(f"trained {todo[place].folder.name}")
        num_lines = len(runs) * sum(len(scenario.lines()) for scenario in study.scenarios)
        with evaluation_bar(num_lines) as watch:
            reproduce.evaluate_runs(runs, executor, watch)

    def _report(self, study: Study) -> None:
        from surefoot.cli import study as reproduce

        say("report")
        reproduce.report_study(study)
        say(f"page: {study.out / 'report.html'}")
