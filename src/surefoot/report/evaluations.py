"""Evaluations: the input of the report, one `Evaluation` for each policy and setup in any results table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from surefoot.agents.controllers.step_times import Timing
from surefoot.checks import check_fields
from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.results import Results, open_results
from surefoot.evaluation.results_check import reading
from surefoot.evaluation.results_schema import Key
from surefoot.evaluation.scenarios import DIRECTIONS, Line
from surefoot.evaluation.strategy_map import cell_strategy
from surefoot.evaluation.suites import PAPER, ROBUSTNESS, SINGLE
from surefoot.evaluation.threshold_search import NUM_FULL_LENGTH, NUM_SCREENING, Threshold
from surefoot.evaluation.trial_store import TrialStore
from surefoot.evaluation.trials import Trial
from surefoot.physics.engines import DEFAULT_ENGINE
from surefoot.report.thresholds import Fixed, by_scenario, has_main_directions, median_steps, root_pushes
from surefoot.robots import Robot, load_robot
from surefoot.task.contract import Contract

LARGEST = "largest sagittal push"
SHANK = "push at the shank"


@dataclass(frozen=True)
class Cell:
    """A cell of the grid of impulses [Ns]: how many of its trials, screening and full-length, recovered, and how.

    Attributes:
        strategy: as `evaluation.strategies.cell_strategy` says.
    """

    impulse: float
    recovered: int
    trials: int
    strategy: str


@dataclass(frozen=True)
class Case:
    """A trial that the report draws, with its stored outcome."""

    trial: Trial
    outcome: Outcome


@dataclass(frozen=True)
class Evaluation:
    """The results of one policy under one setup.

    Attributes:
        name: of the policy, with the engine that is not the default one, and with the robot or the beginning of its
            digest if another one on the page is named alike.
        policy_name: the policy's own name.
        key: digests of policy and setup.
        steps: median number of steps at the worst direction's threshold, by scenario.
        cells: of pushes at the root, by direction.
        cases: trials to draw, by what they show; the default engine's only.
        audit: per scenario, how its trials ended and what share of the limits they used.
        versions: of surefoot and the engine, with which the trials were run.
        wall_s: time of the evaluation [s].
        timing: of a controller, None of a policy.
        outcomes: of every trial that was run.
    """

    name: str
    policy_name: str
    key: Key
    contract: Contract
    thresholds: list[Threshold]
    fixed: Fixed
    steps: dict[str, float]
    cells: dict[Line, list[Cell]]
    cases: dict[str, Case]
    audit: list[dict[str, Any]]
    versions: str
    wall_s: float
    timing: Timing | None = None
    outcomes: Mapping[Trial, Outcome] = field(default_factory=dict, repr=False)

    @property
    def robot(self) -> Robot:
        """The robot that was evaluated."""
        return load_robot(self.contract.robot)

    @property
    def algorithm(self) -> str:
        """By which it was learned; its name if it was not."""
        return str(self.contract.training.get("algorithm", self.name))

    @property
    def has_main_directions(self) -> bool:
        """Were pushes at the root searched in the four main directions?"""
        return has_main_directions(root_pushes(self.thresholds))

    @property
    def worst(self) -> float:
        """The lowest of the four main directions at the root [Ns]; 0 without them."""
        pushes = root_pushes(self.thresholds)
        return min(pushes[d].size for d in DIRECTIONS) if self.has_main_directions else 0.0


def read_evaluations(files: Sequence[str | Path]) -> list[Evaluation]:
    """Every policy of the tables, in the order in which they are met.

    Raises:
        UserError: a file is missing, is no results table, holds nothing, or two hold the same evaluation.
    """
    found: dict[Key, Evaluation] = {}
    for file in files:
        with open_results(file) as results:
            for key, name, contract in results.evaluated():
                if key in found:
                    raise UserError(
                        f"{name} (digest {key.agent[:12]}) is in two of the results tables: {file} repeats it"
                    )
                with reading(file):
                    assumed = Contract.from_json(contract)
                    check_fields(Contract, asdict(assumed), f"the contract of {name}")
                found[key] = _evaluation(results, key, name, assumed)
    if not found:
        raise UserError(f"no finished evaluation in {', '.join(map(str, files))}; run surefoot evaluate first")
    return _told_apart(list(found.values()))


def _told_apart(evaluations: Sequence[Evaluation]) -> list[Evaluation]:
    """Those that are named alike get the robot's name behind theirs, and those of one robot their digests."""
    names = Counter(e.name for e in evaluations)
    robots = Counter((e.name, e.key.setup.robot) for e in evaluations)
    words = [e.key.setup.robot if robots[e.name, e.key.setup.robot] == 1 else e.key.agent[:6] for e in evaluations]
    return [
        e if names[e.name] == 1 else replace(e, name=f"{e.name} ({word})")
        for e, word in zip(evaluations, words, strict=True)
    ]


def has_several_robots(evaluations: Sequence[Evaluation]) -> bool:
    """Are they of more than one robot?"""
    return len(of_first_robot(evaluations)) < len(evaluations)


def of_first_robot(evaluations: Sequence[Evaluation]) -> list[Evaluation]:
    """Those of the robot of the first one, whose thresholds are on the same grid."""
    return [e for e in evaluations if e.contract.robot == evaluations[0].contract.robot]


def _evaluation(results: Results, key: Key, name: str, contract: Contract) -> Evaluation:
    engine, robot = key.setup.engine_word, key.setup.robot
    thresholds = sorted(results.thresholds_of(name, engine, robot), key=lambda t: _place(t.line.scenario.name))
    fixed = dict(sorted(results.fixed_outcomes(name, engine, robot).items(), key=lambda item: _place(item[0])))
    store = results.outcomes(key)
    return Evaluation(
        name=key.setup.shown(name),
        policy_name=name,
        key=key,
        contract=contract,
        thresholds=thresholds,
        fixed=fixed,
        steps=median_steps(thresholds, store),
        cells={t.line: _cells(t.line, store) for t in root_pushes(thresholds).values()},
        cases=_cases(thresholds, fixed, store) if engine == DEFAULT_ENGINE else {},
        audit=sorted(results.audit_rows(key), key=lambda row: _place(row["scenario"])),
        versions=", ".join(f"surefoot {version}, {key.setup.engine}" for version in results.versions(key)),
        wall_s=results.wall_s(key),
        timing=results.timing(key),
        outcomes=store.known,
    )


_ORDER = [scenario.name for scenario in (*PAPER, *ROBUSTNESS)]


def _place(scenario: str) -> int:
    """Scenarios stand in the order of the suites, others after them."""
    return _ORDER.index(scenario) if scenario in _ORDER else len(_ORDER)


def _cells(line: Line, store: TrialStore) -> list[Cell]:
    """The cells that were searched, from the smallest up."""
    cells: list[Cell] = []
    for cell in range(1, line.num_cells + 1):
        outcomes = _known(line, cell, store, NUM_SCREENING, full_length=False)
        if not outcomes:  # what lies above was not searched; single trials of other scenarios may
            break
        outcomes += _known(line, cell, store, NUM_FULL_LENGTH, full_length=True)
        strategy = cell_strategy(outcomes, line.protocol.step_length)
        cells.append(Cell(line.size(cell), sum(map(line.succeeded, outcomes)), len(outcomes), strategy))
    return cells


def _known(line: Line, cell: int, store: TrialStore, num_seeds: int, full_length: bool) -> list[Outcome]:
    trials = (line.trial(cell, seed, full_length) for seed in range(num_seeds))
    return [outcome for trial in trials if (outcome := store.get(trial))]


def _cases(thresholds: Sequence[Threshold], fixed: Fixed, store: TrialStore) -> dict[str, Case]:
    """The paper's four pushes, the largest sagittal push and a push at the shank, as far as they were run."""
    cases = {name: Case(*next(iter(fixed[name].items()))) for name in SINGLE if fixed.get(name)}
    root = root_pushes(thresholds)
    shank = by_scenario(thresholds).get("shank_push", {})
    sagittal = [root[d] for d in ("forward", "backward") if d in root]
    for name, found in ((LARGEST, sagittal), (SHANK, shank.values())):
        case = _largest_recovered(found, store)
        if case:
            cases[name] = case
    return cases


def _largest_recovered(thresholds: Iterable[Threshold], store: TrialStore) -> Case | None:
    """The first recovered full-length trial at the largest of the thresholds."""
    largest = max(thresholds, key=lambda t: t.size, default=None)
    for trial in largest.full_length_trials() if largest else []:
        outcome = store.get(trial)
        if outcome and outcome.recovered:
            return Case(trial, outcome)
    return None
