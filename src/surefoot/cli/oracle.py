"""surefoot oracle: find the hardest push that a robot can reject if it knows the push in advance."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from surefoot.cli.terminal import chosen_robot, console
from surefoot.cli.work import Work
from surefoot.errors import UserError

if TYPE_CHECKING:
    from surefoot.evaluation.oracle import Possible
    from surefoot.evaluation.scenarios import Line
    from surefoot.task.agent import Agent

FIRST_SIZE = 8
"""The search along a line begins at this cell of its grid: 48 Ns for the paper's robot."""
COLUMNS = ("agent", "scenario", "direction", "angle_deg", "size", "unit", "succeeded", "trials")


@dataclass(frozen=True)
class Oracle(Work):
    """Find the hardest push that a robot can reject if it knows the push, by trajectory optimisation.

    The search varies offsets to an agent's joint targets in a batch of robots, with all limits in force. A push that is
    rejected here is possible to reject. One that is not may still be possible.
    """

    agent: Annotated[str, tyro.conf.Positional] = "nominal"
    """Agent whose joint targets are varied: the nominal pose, or a policy as for `surefoot evaluate`."""
    directions: int = 16
    """Number of directions, evenly spaced."""
    body: str = "root"
    """The body that is pushed."""
    lever: float | None = None
    """Height of the push above the robot's CoM in its nominal pose [m]. The default is the CoM of the body."""
    steps: bool = False
    """Allow steps. Without it, no foot may leave its place."""
    robot: str = ""
    """The robot of "nominal". The default is the shipped policies' robot."""
    export: Path | None = None
    """Write the results to this .csv file, one direction at a time; directions already in it are not searched again."""
    beside: Path | None = None
    """A .csv file of `surefoot evaluate --export-thresholds`, whose thresholds the picture also shows."""
    picture: Path | None = None
    """Draw the results by direction (.png, .svg or .pdf)."""

    def main(self) -> None:
        """Search, print, write and draw."""
        from surefoot.agents.load import load_agent
        from surefoot.evaluation.oracle import largest_possible

        agent = load_agent(self.agent, chosen_robot(self.robot))
        lines = self._lines(agent)
        known = _read(self.export) if self.export else {}
        todo = [line for line in lines if (agent.name, line.scenario.name, line.name) not in known]
        with self.opened() as executor, _progress(len(todo)) as (show, count):
            told = [show(line) if executor.is_local else None for line in todo]
            tasks = [(agent, line, FIRST_SIZE, tell) for line, tell in zip(todo, told, strict=True)]
            for place, found in executor.run(largest_possible, tasks):
                known[agent.name, found.line.scenario.name, todo[place].name] = _row(agent, found)
                if self.export:
                    _write(self.export, known.values())
                count()
        rows = [known[agent.name, line.scenario.name, line.name] for line in lines]
        self._print(agent, rows)
        if self.picture:
            self._draw(agent, lines, rows)

    def _lines(self, agent: Agent) -> list[Line]:
        from surefoot.evaluation.protocol import protocol_for
        from surefoot.evaluation.scenarios import Scenario

        name = f"{self.body}_push" + ("" if self.steps else "_no_step")
        agent.robot.body_id(self.body)
        scenario = Scenario(
            name, directions=self.directions, body=self.body, lever=self.lever, without_step=not self.steps
        )
        return scenario.lines(protocol_for(agent.robot))

    def _print(self, agent: Agent, rows: Sequence[dict[str, str]]) -> None:
        from surefoot.evaluation.oracle import NUM_CHECKS
        from surefoot.report.table import Table

        cells = [(row["direction"], row["size"], f"{row['succeeded']}/{row['trials']}") for row in rows]
        words = "with steps" if self.steps else "without a step"
        note = (
            f"The largest push that a planned motion rejects in at least half of {NUM_CHECKS} trials with other start"
            " angles. More may be possible than was found."
        )
        title = f"Oracle: pushes at the {self.body}, {words}, on top of {agent.name}"
        Console().print(Table(title, ("direction", "possible [Ns]", "succeeded"), cells, note).rich())

    def _draw(self, agent: Agent, lines: Sequence[Line], rows: Sequence[dict[str, str]]) -> None:
        import numpy as np

        from surefoot.evaluation.results_export import read_thresholds
        from surefoot.report.bounds import capture_point_bound
        from surefoot.report.threshold_plots import polar_map
        from surefoot.report.thresholds import by_scenario

        assert self.picture
        points = {"oracle": [(line.angle, float(row["size"])) for line, row in zip(lines, rows, strict=True)]}
        for name, thresholds in (read_thresholds(self.beside) if self.beside else {}).items():
            found = by_scenario(thresholds).get(lines[0].scenario.name, {})
            if found:
                points[name] = [(t.line.angle, t.size) for t in found.values()]
        angles = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False).tolist()
        pose = np.array(agent.contract.nominal_pose)
        bound = list(zip(angles, capture_point_bound(agent.robot, pose, angles), strict=True))
        polar_map(points, bound, self.picture, title="Possible and rejected impulses")


Show = Callable[[float, int, float], None]


@contextmanager
def _progress(num_lines: int) -> Iterator[tuple[Callable[[Line], Show], Callable[[], None]]]:
    """A bar of lines done: what tells it of a line's size, iteration and share of samples, and of its end."""
    columns = (SpinnerColumn(), BarColumn(bar_width=12), TextColumn("{task.fields[says]}"), TimeElapsedColumn())
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("oracle", total=num_lines, says="searching")

        def of_line(line: Line) -> Show:
            def show(size: float, iteration: int, share: float) -> None:
                says = f"{line.name}: {size:g} {line.scenario.unit}, iteration {iteration + 1}, {share:.0%} succeed"
                bar.update(task, says=says)

            return show

        yield of_line, lambda: bar.advance(task)
        bar.update(task, says="done")


def _row(agent: Agent, found: Possible) -> dict[str, str]:
    import math

    from surefoot.evaluation.oracle import NUM_CHECKS

    line = found.line
    angle = f"{math.degrees(line.angle):g}"
    values = (
        agent.name, line.scenario.name, line.name, angle, f"{found.size:g}", line.scenario.unit,
        str(found.succeeded), str(NUM_CHECKS),
    )  # fmt: skip
    return dict(zip(COLUMNS, values, strict=True))


def _read(path: Path) -> dict[tuple[str, str, str], dict[str, str]]:
    """The rows of an earlier search, by agent, scenario and direction; none if there is no such file."""
    if not path.exists():
        return {}
    with path.open(newline="") as stream:
        reader = csv.DictReader(stream)
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise UserError(f"{path} is not a table of the oracle: its columns must be {', '.join(COLUMNS)}")
        return {(row["agent"], row["scenario"], row["direction"]): row for row in reader}


def _write(path: Path, rows: Iterable[dict[str, str]]) -> None:
    part = path.with_name(f".{path.name}.part")
    with part.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    part.replace(path)
