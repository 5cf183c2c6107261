"""Evaluate: the search for the hardest disturbances that an agent survives, with one batch of robots for all lines."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from surefoot.agents.load import load_agent
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.protocol import PROTOCOL, protocol_for
from surefoot.evaluation.results import Results
from surefoot.evaluation.scenario_file import suite as read_suite
from surefoot.evaluation.scenarios import DIRECTIONS, Line, Scenario, with_limits
from surefoot.evaluation.searches import OnProgress, Searches, Store
from surefoot.evaluation.spread import spread
from surefoot.evaluation.threshold_search import Threshold
from surefoot.evaluation.trial_store import TrialStore
from surefoot.evaluation.trials import NUM_SLOTS, run_trials
from surefoot.executors import Executor
from surefoot.physics.engines import DEFAULT_ENGINE
from surefoot.robots import Robot
from surefoot.task.agent import Agent

__all__ = ["DIRECTIONS", "Line", "OnProgress", "Store", "Threshold", "find_thresholds", "push_lines", "run_scenarios"]


def push_lines(num_directions: int = 4, robot: Robot | None = None) -> list[Line]:
    """Lines of pushes at the root in evenly spaced directions; the four main ones bear their names.

    Args:
        num_directions: how many.
        robot: robot whose grid of impulses is searched. The default is the paper's robot.
    """
    return Scenario("root_push", directions=num_directions).lines(protocol_for(robot) if robot else PROTOCOL)


def run_scenarios(
    policy: Agent,
    scenarios: Iterable[Scenario],
    store: Store | None = None,
    on_progress: OnProgress | None = None,
    **options: Any,
) -> list[Threshold]:
    """Run the trials of all scenarios, those in the same world as one batch.

    Args:
        policy: the agent that is tested.
        scenarios: what it is tested in.
        store: asked before a trial is run, told afterwards.
        on_progress: told after every trial.
        options: those of `run_trials`.

    Returns:
        The thresholds of all lines that are searched.
    """
    scenarios, protocol = list(scenarios), protocol_for(policy.robot)
    thresholds: list[Threshold] = []
    for domain in dict.fromkeys(scenario.domain for scenario in scenarios):
        lines = [line for s in scenarios if s.domain == domain for line in s.lines(protocol)]
        search = Searches(lines, store, on_progress)
        run_trials(policy, search, domain=domain, **options)
        thresholds += search.thresholds()
    return thresholds


def find_thresholds(
    policy: Agent,
    lines: Sequence[Line],
    store: Store | None = None,
    on_progress: OnProgress | None = None,
    num_slots: int = NUM_SLOTS,
    num_threads: int = 0,
) -> list[Threshold]:
    """Search several lines of one world at once, in one batch of robots; arguments as for `run_scenarios`."""
    search = Searches(lines, store, on_progress)
    run_trials(policy, search, num_slots, num_threads, domain=lines[0].scenario.domain)
    return search.thresholds()


@dataclass(frozen=True)
class Evaluated:
    """The results of an evaluation.

    Attributes:
        thresholds: of all lines that were searched.
        store: outcomes of the agent's trials.
        wall_s: time that it took [s].
    """

    thresholds: list[Threshold]
    store: TrialStore
    wall_s: float


def evaluate_and_store(
    agent: Agent,
    scenarios: Sequence[Scenario],
    results: Results,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
    spent_s: float = 0.0,
) -> Evaluated:
    """Run what the results table does not hold yet of these scenarios, and keep it there.

    Args:
        agent: that is tested.
        scenarios: what it is tested in.
        results: the table, which this process alone writes.
        on_progress: told after every trial, or after every line that workers have done.
        executor: executor of the trials. The default is this process.
        spent_s: time that was spent on it before [s].
    """
    began = time.monotonic() - spent_s
    if executor and not executor.is_local:
        spread([agent], scenarios, results, executor, on_progress)
    store = results.trials_of(agent)
    thresholds = run_scenarios(agent, scenarios, store, on_progress, engine=results.engine)
    wall_s = time.monotonic() - began
    results.add_thresholds(agent, thresholds)
    results.add_scenarios(agent, scenarios, wall_s)
    return Evaluated(thresholds, store, wall_s)


def evaluate(
    agent: Agent | str,
    suite: str | Sequence[Scenario] = "push",
    directions: int | None = None,
    results: str | Path | None = None,
    on_progress: OnProgress | None = None,
    engine: str = DEFAULT_ENGINE,
    executor: Executor | None = None,
) -> list[Threshold]:
    """Find the hardest disturbances that an agent survives, by the one definition of success (docs/method.md).

    Args:
        agent: a policy or a controller, or its name as `load_agent` takes it.
        suite: "push", "paper", "robustness", "ring", a scenario file (.toml), or scenarios of your own, whose sizes
            and directions stay as they are.
        directions: number of evenly spaced directions of the pushes at the root, and of all pushes of the suite ring;
            the default is the suite's own number.
        results: results table (SQLite) to fill; trials already in it are not run again. Without it nothing is kept.
        on_progress: called after every trial.
        engine: name of the physics engine: "mujoco" or "pybullet".
        executor: executor of the trials, see `open_executor`. The default is this process.

    Returns:
        The largest size that holds along each searched line, once with any joint speeds and once within the
        joints' limits: `line.scenario.name`, `line.name` (the direction), `size` [Ns, m or deg], `recovered`, `trials`.

    Raises:
        UserError: there is no such agent, suite or engine, or the results table cannot be used.
    """
    agent = load_agent(agent) if isinstance(agent, str) else agent
    scenarios = chosen_scenarios(suite, directions, agent.robot) if isinstance(suite, str) else with_limits(suite)
    with Results(":memory:" if results is None else results, engine) as table:
        return evaluate_and_store(agent, scenarios, table, on_progress, executor).thresholds


def chosen_scenarios(suite: str, directions: int | None, robot: Robot) -> list[Scenario]:
    """Return the scenarios of a suite for a robot, each that is searched followed by its twin within the limits.

    Args:
        suite: its name, or a scenario file.
        directions: of the pushes at the root, and of all pushes of the suite ring, evenly spaced; the suite's own
            number without it.
        robot: that is tested.

    Raises:
        UserError: there is no such suite.
    """
    turned = (Scenario("root_push"), Scenario("root_push_no_step", without_step=True))
    found = read_suite(suite, robot)
    if directions:
        found = tuple(
            dataclasses.replace(s, directions=directions) if s in turned or (suite == "ring" and s.search) else s
            for s in found
        )
    return with_limits(found)


def full_length_outcomes(threshold: Threshold, store: Store) -> list[Outcome]:
    """Outcomes of the full-length trials at a threshold."""
    return [outcome for trial in threshold.full_length_trials() if (outcome := store.get(trial))]
