"""surefoot agent check: find out whether a fault is in the policy or in its adapter."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from surefoot.cli.terminal import chosen_robot, working

if TYPE_CHECKING:
    from surefoot.evaluation.agent_check import AgentCheck, WayResult
    from surefoot.task.agent import Agent

_NO_REACTION = 1e-9
_SHOWN_JOINTS = 5


@dataclass(frozen=True)
class AgentCommand:
    """Check whether an agent stands, follows and has the right joint order, and list what it sees and reacts to.

    The exit code is 1 if the agent as given does not stand.
    """

    action: Annotated[Literal["check"], tyro.conf.Positional]
    """The action: check."""
    policy: Annotated[str, tyro.conf.Positional]
    """FILE.py:CLASS, FILE.onnx (surefoot docs foreign-policies), controllers/NAME, or a policy of surefoot."""
    robot: str = ""
    """A shipped robot's name, or a description (.toml). The default is the shipped policies' robot."""
    seconds: float = 20.0
    """Time for which the agent must stand [s]."""

    def main(self) -> None:
        """Check and print."""
        from surefoot.agents.load import load_agent
        from surefoot.checks import check_number
        from surefoot.evaluation.agent_check import check_agent_by_driving

        check_number("seconds", self.seconds, low=5.0, high=600.0)
        agent = load_agent(self.policy, chosen_robot(self.robot))
        with working(f"driving {agent.name}"):
            found = check_agent_by_driving(agent, self.seconds)
        output = Console()
        print_agent(agent, output)
        print_check(agent, found, output)
        if not found.stands:
            sys.exit(1)


def print_agent(agent: Agent, output: Console) -> None:
    """Print an agent's description as read, before it has moved anything."""
    robot, gains = agent.robot, agent.gains
    ratio = gains.stiffness / robot.stiffness
    own = "the robot's own" if np.allclose(ratio, 1.0) else f"{ratio.min():.2f} to {ratio.max():.2f} of the robot's own"
    pose = np.abs(np.array(agent.contract.nominal_pose) - robot.pose())
    rows = {
        "agent": f"{agent.name}, for {robot.name} with {robot.num_joints} controlled joints",
        "control steps": f"{agent.rate_hz} Hz, targets by path '{agent.path}'",
        "stiffness": own,
        "begins": f"up to {pose.max():.2f} rad from the pose '{robot.default_pose}'",
        "targets": "clipped to the joint ranges" if agent.clips_targets else "may lie beyond the joint ranges",
        "is given": "the filtered observation" if agent.inputs == "observation" else "the state",
    }
    table = Table("what was understood", "", title_justify="left")
    for words in rows.items():
        table.add_row(*words)
    output.print(table)


def print_check(agent: Agent, found: AgentCheck, output: Console) -> None:
    """Print the results of the check, and whether a fault is in the policy or the adapter."""
    output.print(_ways_table([found.given, *found.wrong]))
    if found.commands:
        output.print(_commands_table(found.commands))
    output.print(_inputs_table(found))
    output.print(_targets_table(agent, found))
    for sentence in verdict(agent, found):
        output.print(sentence, markup=False, soft_wrap=True)


def _ways_table(results: list[WayResult]) -> Table:
    table = Table("driven", "stood", "for [s]", "foot shift [m]", "power [W]", title="Does it stand only as given?")
    for result in results:
        shift = np.median([outcome.foot_shift for outcome in result.outcomes])
        power = np.median([outcome.quiet_power for outcome in result.outcomes])
        table.add_row(
            result.way.name,
            f"{result.num_stood} of {len(result.outcomes)}",
            f"{result.seconds:.1f}",
            f"{shift:.3f}",
            "" if np.isnan(power) else f"{power:.2f}",
        )
    return table


def _commands_table(results: list[WayResult]) -> Table:
    table = Table("asked", "for", "did", "stood", "follows", title="Does it follow?")
    for result in results:
        axis = int(np.argmax(np.abs(result.way.command)))
        did = "" if np.isnan(result.speed[axis]) else f"{result.speed[axis]:.2f} "
        unit = ("m/s", "m/s", "rad/s")[axis]
        table.add_row(
            result.way.name,
            f"{result.way.command[axis]:.2f} {unit}",
            f"{did}{unit}" if did else "fell",
            f"{result.num_stood} of {len(result.outcomes)}",
            "yes" if result.follows else "no",
        )
    return table


def _inputs_table(found: AgentCheck) -> Table:
    table = Table("input", "lowest", "mean", "highest", title="Inputs while it stood")
    for name, seen in found.ranges.items():
        table.add_row(name, f"{seen.low:.3f}", f"{seen.mean:.3f}", f"{seen.high:.3f}")
    return table


def _targets_table(agent: Agent, found: AgentCheck) -> Table:
    table = Table("a small change of", "moves targets by [rad]", title="Reactions to its inputs")
    for name, moved in sorted(found.reactions.items(), key=lambda pair: -pair[1]):
        if moved > _NO_REACTION:
            table.add_row(name, f"{moved:.4f}")
    return table


def verdict(agent: Agent, found: AgentCheck) -> list[str]:
    """Say in sentences whether a fault is in the policy or the adapter."""
    said = []
    far = np.argsort(-found.target_error)[:_SHOWN_JOINTS]
    joints = ", ".join(f"{agent.robot.joint_names[joint]} {found.target_error[joint]:.3f}" for joint in far)
    said.append(f"Joints that are farthest from their targets [rad]: {joints}.")
    if found.beyond_share >= 0.0005:
        said.append(f"{100 * found.beyond_share:.1f} % of the targets lie beyond the joint ranges.")
    still = [name for name, moved in found.reactions.items() if moved <= _NO_REACTION]
    if still:
        said.append(f"It does not react to {', '.join(still)}.")
    return said + (_of_one_that_stands(found) if found.stands else _of_one_that_does_not(found))


def _of_one_that_stands(found: AgentCheck) -> list[str]:
    said = [f"It stands for the whole time, all {len(found.given.outcomes)} robots."]
    said.extend(
        f"It also stands with {result.way.name}, so standing does not show whether that is right."
        for result in found.indifferent_ways
    )
    lost = [result.way.name for result in found.commands if not result.follows]
    if lost:
        said.append(
            f"It does not follow when {', '.join(lost)}. Either it was never taught to, or it is given the command "
            "in another order or unit."
        )
    return [*said, "The adapter is right as far as this shows; the behaviour under a push is the policy's."]


def _of_one_that_does_not(found: AgentCheck) -> list[str]:
    given, better = found.given, found.better_ways
    reasons = ", ".join(dict.fromkeys(outcome.reason for outcome in given.outcomes if not outcome.recovered))
    said = [f"It does not stand: {given.num_stood} of {len(given.outcomes)} stood, {given.seconds:.1f} s ({reasons})."]
    if better:
        said.append(
            f"It is the adapter: {better[0].num_stood} of {len(given.outcomes)} stand with {better[0].way.name}."
        )
    else:
        said.append(
            "No other joint order and no other sign makes it stand. Compare its inputs with those of its training: "
            "gains, default pose, action scale, rate, and the order, scale and history of the observations."
        )
    return said
