"""Strategy map: the strategies of an agent against pushes from all directions, by direction and impulse."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from surefoot.checks import MAX_PATH, check_number, check_text, read_text
from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.protocol import protocol_for
from surefoot.evaluation.setup import Setup
from surefoot.evaluation.trials import Trial, run_list
from surefoot.physics.engines import DEFAULT_ENGINE
from surefoot.physics.pushes import horizontal_push
from surefoot.task.agent import Agent
from surefoot.whole_file import write_whole

STRATEGIES = ("none", "ankle", "hip", "foot tilt", "1 step", "2 steps", "3+ steps")
"""From the mildest on: what is named is the strongest that was used."""
GIVES_WAY = "gives way"
HOLDS = 0.9
"""Share of a cell's trials that must recover, as of a cell of the threshold search."""
STRIDE = 6
"""From one impulse to the next, in steps of the robot's grid."""
MAX_CSV_BYTES = 5_000_000


@dataclass(frozen=True)
class StrategyCell:
    """An agent's answer to a push at the root, in one direction and with one impulse.

    Attributes:
        name: of the agent.
        robot: its robot's name.
        engine: of the physics, with its version.
        protocol: version of the definitions.
        mass: of the robot [kg].
        angle_deg: direction of the push, counter-clockwise from forward.
        impulse: of the push [Ns].
        trials, recovered: how many there were, and how many of them recovered.
        strategy: the median strategy of those that recovered, or `GIVES_WAY` if fewer than `HOLDS` of all did.
    """

    name: str
    robot: str
    engine: str
    protocol: int
    mass: float
    angle_deg: float
    impulse: float
    trials: int
    recovered: int
    strategy: str


def strategy_of(outcome: Outcome, step_length: float) -> str:
    """The strongest strategy of a trial that recovered.

    Args:
        outcome: of the trial.
        step_length: how far a foot that has not stepped may come from its place [m]. Once the trunk leans too far,
            steps are not counted any more: a foot that has come farther has made one at least.
    """
    steps = max(outcome.steps, not outcome.is_without_step(step_length))
    if steps:
        return STRATEGIES[3 + min(steps, 3)]
    used = (outcome.foot_tilt, outcome.hip, outcome.ankle)
    return next((STRATEGIES[3 - place] for place, was_used in enumerate(used) if was_used), STRATEGIES[0])


def cell_strategy(outcomes: Sequence[Outcome], step_length: float) -> str:
    """The strategy of a cell, from all its outcomes."""
    ranks = [STRATEGIES.index(strategy_of(outcome, step_length)) for outcome in outcomes if outcome.recovered]
    if len(ranks) < HOLDS * len(outcomes) or not ranks:
        return GIVES_WAY
    return STRATEGIES[int(np.ceil(np.median(ranks)))]


def map_strategies(
    agent: Agent, num_directions: int, largest: float, num_trials: int, engine: str = DEFAULT_ENGINE
) -> list[StrategyCell]:
    """Push an agent's robot at the root from all around, harder and harder.

    Args:
        agent: agent of the pushed robot.
        num_directions: evenly spaced, from forward on.
        largest: impulse [Ns]; the others are `STRIDE` steps of the robot's grid apart.
        num_trials: of each cell, with the seeds from 0 on.
        engine: name of the physics engine.
    """
    robot, protocol = agent.robot, protocol_for(agent.robot)
    stride = STRIDE * protocol.impulse_step
    angles = [360.0 * number / num_directions for number in range(num_directions)]
    impulses = [round(stride * number, 9) for number in range(1, int(largest / stride + 1e-9) + 1)]
    cells = {
        (angle, impulse): [
            Trial(horizontal_push("root", angle, impulse), seed, full_length=False) for seed in range(num_trials)
        ]
        for impulse in impulses
        for angle in angles
    }
    outcomes = run_list(agent, (trial for trials in cells.values() for trial in trials), engine=engine)
    setup = Setup.of(robot, engine)
    found = []
    for (angle, impulse), trials in cells.items():
        results = [outcomes[trial] for trial in trials]
        strategy = cell_strategy(results, protocol.step_length)
        where = (agent.name, robot.name, setup.engine, protocol.version, round(robot.mass, 3), angle, impulse)
        found.append(StrategyCell(*where, num_trials, sum(result.recovered for result in results), strategy))
    return found


def write_strategies(path: Path, cells: Iterable[StrategyCell]) -> None:
    """Write cells to a .csv file, in the place of those of the same agents and engines that it holds.

    Raises:
        UserError: the file cannot be read as such a table, or not be written.
    """
    new = list(cells)
    keys = {(cell.name, cell.engine) for cell in new}
    kept = [cell for cell in read_strategies(path) if (cell.name, cell.engine) not in keys] if path.exists() else []
    text = io.StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(StrategyCell)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(cell) for cell in [*kept, *new])
    write_whole(path, text.getvalue().encode())


def read_strategies(path: Path) -> list[StrategyCell]:
    """The cells of a .csv file that `write_strategies` wrote.

    Raises:
        UserError: the file is missing or is not such a table.
    """
    text = read_text(path, "table", MAX_CSV_BYTES)
    try:
        return [_cell(row) for row in csv.DictReader(io.StringIO(text, newline=""))]
    except (KeyError, ValueError, TypeError, csv.Error) as error:
        raise UserError(f"{path} is not a table of strategies: {error}") from error


def _cell(row: dict[str, str]) -> StrategyCell:
    if row["strategy"] not in (*STRATEGIES, GIVES_WAY):
        raise ValueError(f"unknown strategy {row['strategy'][:20]!r}; valid: {', '.join((*STRATEGIES, GIVES_WAY))}")
    name, robot, engine = (check_text(key, row[key], MAX_PATH) for key in ("name", "robot", "engine"))
    protocol, trials, recovered = (int(row[key]) for key in ("protocol", "trials", "recovered"))
    mass, impulse = (float(check_number(key, float(row[key]), 0.0, above=True)) for key in ("mass", "impulse"))
    angle = float(check_number("angle_deg", float(row["angle_deg"]), -360.0, 360.0))
    return StrategyCell(
        name, robot, engine, protocol, mass, angle, impulse, trials, recovered, strategy=row["strategy"]
    )
