"""Spread: the lines of an evaluation on the workers of an executor, whose outcomes one process writes.

Lines that ask for the same trials (any, without a step, within limits) are one task. A worker searches them as this
process would, from what is known. With every line's outcomes in the store, the thresholds are found without a trial.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from surefoot.agents.controllers.controller import ControllerAgent
from surefoot.agents.controllers.step_times import StepTimes
from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.protocol import protocol_for
from surefoot.evaluation.results import Results
from surefoot.evaluation.scenarios import Line, Scenario
from surefoot.evaluation.searches import OnProgress, Searches, Store
from surefoot.evaluation.setup import Setup
from surefoot.evaluation.threshold_search import NUM_FULL_LENGTH, NUM_SCREENING
from surefoot.evaluation.trials import Trial, run_trials
from surefoot.executors import Executor
from surefoot.task.agent import Agent

NUM_SLOTS = 48
"""Robots of a worker's batch: one task has fewer trials to run at once than a whole suite."""


@dataclass(frozen=True)
class LineTask:
    """Lines that ask for the same trials.

    Attributes:
        agent: that is tested.
        setup: in which the outcomes are wanted.
        lines: that are searched, or whose trials are run.
        known: outcomes of their trials that are known.
    """

    agent: Agent
    setup: Setup
    lines: tuple[Line, ...]
    known: Mapping[Trial, Outcome]


@dataclass(frozen=True)
class LinesDone:
    """The results of a worker.

    Attributes:
        outcomes: new ones, by trial, with the scenario for which each was run, in the order in which they ended.
        reached: the size reached along each line.
        seconds: processor time that it took [s].
        failures: how often the agent failed a robot, by reason.
        times: of a controller's control steps.
    """

    outcomes: dict[Trial, tuple[Outcome, str]]
    reached: tuple[float, ...]
    seconds: float
    failures: Counter[str]
    times: StepTimes | None


class _Notes:
    """A store that knows some outcomes and keeps the new ones apart."""

    def __init__(self, known: Mapping[Trial, Outcome]):
        self._known = known
        self.new: dict[Trial, tuple[Outcome, str]] = {}

    def get(self, trial: Trial) -> Outcome | None:
        """The outcome of a trial, if it is known."""
        return self.new[trial][0] if trial in self.new else self._known.get(trial)

    def put(self, trial: Trial, outcome: Outcome, scenario: str) -> None:
        """Keep the outcome of a trial that was run for a scenario."""
        self.new[trial] = outcome, scenario


def spread(
    agents: Sequence[Agent],
    scenarios: Sequence[Scenario],
    results: Results,
    executor: Executor,
    on_progress: OnProgress | None = None,
) -> list[tuple[LineTask, LinesDone]]:
    """Let workers run what a results table does not hold yet of some scenarios, and keep it there line by line.

    Args:
        agents: that are tested.
        scenarios: what they are tested in.
        results: the table, which this process alone writes.
        executor: executor with the workers.
        on_progress: told after every task: trials done, lines done, and the size reached along the task's lines.

    Returns:
        The results of each task, in the order in which the tasks were done.

    Raises:
        UserError: a worker lacks something, or works in another setup.
    """
    stores = {agent.digest: results.trials_of(agent) for agent in agents}
    tasks = [
        task for each in agents for task in _left(each, scenarios, stores[each.digest], results.key_of(each).setup)
    ]
    done: list[tuple[LineTask, LinesDone]] = []
    num_trials = num_lines = 0
    for number, found in executor.run(run_lines, [(task,) for task in tasks]):
        task = tasks[number]
        for trial, (outcome, scenario) in found.outcomes.items():
            stores[task.agent.digest].put(trial, outcome, scenario)
        task.agent.failures.update(found.failures)
        controller = ControllerAgent.among(task.agent)
        if controller and found.times:
            controller.times.extend(found.times)
        done.append((task, found))
        num_trials, num_lines = num_trials + len(found.outcomes), num_lines + len(task.lines)
        if on_progress:
            on_progress(num_trials, num_lines, list(zip(task.lines, found.reached, strict=True)))
    return done


def run_lines(task: LineTask) -> LinesDone:
    """Run the trials of a task on a worker.

    Raises:
        UserError: the worker's engine, robot or protocol is another one.
    """
    engine = task.setup.engine_word
    differences = task.setup.differences(Setup.of(task.agent.robot, engine))
    if differences:
        raise UserError(f"the setup is another one than that of who asks: {'; '.join(differences)}")
    notes, began = _Notes(task.known), time.process_time()
    searches = Searches(task.lines, notes, None)
    run_trials(task.agent, searches, NUM_SLOTS, domain=task.lines[0].scenario.domain, engine=engine)
    reached = tuple(search.reached for search in searches.searches)
    seconds, controller = time.process_time() - began, ControllerAgent.among(task.agent)
    times = controller.times if controller else None
    return LinesDone(notes.new, reached, seconds, task.agent.failures, times)


def _left(agent: Agent, scenarios: Sequence[Scenario], store: Store, setup: Setup) -> list[LineTask]:
    """Return a task for all lines that share their trials and still need some."""
    protocol = protocol_for(agent.robot)
    groups: dict[tuple[Trial, ...], list[Line]] = {}
    for line in (line for scenario in scenarios for line in scenario.lines(protocol)):
        groups.setdefault(_shared(line), []).append(line)
    needing = [lines for lines in groups.values() if Searches(lines, store, None).next() is not None]
    return [LineTask(agent, setup, tuple(lines), _known(lines, store)) for lines in needing]


def _shared(line: Line) -> tuple[Trial, ...]:
    """Return trials that tell lines apart that do not ask for the same ones."""
    return (line.trial(1, 0, full_length=False),) if line.scenario.search else tuple(line.fixed_trials())


def _known(lines: Sequence[Line], store: Store) -> dict[Trial, Outcome]:
    """Return the known outcomes of lines that share their trials."""
    line = lines[0]
    if not line.scenario.search:
        asked = line.fixed_trials()
    else:
        cells, seeds = range(1, line.num_cells + 1), ((NUM_SCREENING, False), (NUM_FULL_LENGTH, True))
        asked = [line.trial(cell, seed, whole) for cell in cells for num, whole in seeds for seed in range(num)]
    return {trial: outcome for trial in asked if (outcome := store.get(trial))}
