"""Agent ways: one agent, driven as given and with typical errors of an adapter, side by side."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from surefoot.evaluation.agent_inputs import quantities, with_quantities
from surefoot.robots import Robot
from surefoot.task.agent import Agent, Command, Gains, Inputs
from surefoot.task.contract import Contract

AS_GIVEN = "as given"


@dataclass(frozen=True, eq=False)
class Way:
    """How some robots are driven: the joints in another order, quantities with another sign, or under a command.

    Attributes:
        name: in words.
        order: places of the joints in the order in which the agent is given and answers them; None for their own.
        negated: names of the quantities whose sign is changed.
        command: forward, left and turning speed that the robots are asked for (3,) [m/s, m/s, rad/s].
    """

    name: str
    order: np.ndarray | None = None
    negated: tuple[str, ...] = ()
    command: tuple[float, float, float] = (0.0, 0.0, 0.0)


def wrong_ways(robot: Robot) -> list[Way]:
    """Ways in which adapters are wrong: joints in another order, sensors with another sign."""
    given = np.arange(robot.num_joints)
    back = np.argsort(robot.breadth_first)
    orders = {
        "joints breadth first, as Isaac Lab counts": robot.breadth_first,
        "joints depth first, if they are breadth first": back,
        "left and right exchanged": robot.mirror_source,
        "joints in reverse order": given[::-1].copy(),
    }
    ways = [Way(name, order) for name, order in orders.items() if not np.array_equal(order, given)]
    ways.append(Way("gravity upside down", negated=("gravity_direction", "root_attitude")))
    ways.append(Way("gyroscope negated", negated=("gyroscope", "root_angular_velocity")))
    ways.append(Way("joint speeds negated", negated=("joint_velocity",)))
    return ways


class AgentInWays:
    """An agent that drives `num_each` robots in each of some ways: an `Agent` itself.

    Robots 0 to `num_each` - 1 are driven in the first way, and so on.

    Args:
        agent: the agent.
        ways: how it is driven.
        num_each: robots in each way.
        order: places of the joints in the order in which the agent's gains and its pose stand, if not in their own.

    Attributes:
        takes_commands: whether the agent can be asked for a speed.
        last_inputs, last_targets: what the agent was given and answered for the robots of its last call.
        last_ids: the robots of that call (n,).
    """

    def __init__(self, agent: Agent, ways: Sequence[Way], num_each: int, order: np.ndarray | None = None):
        self.agent, self.ways, self.num_each = agent, ways, num_each
        self.name, self.digest, self.robot = agent.name, agent.digest, agent.robot
        self.contract: Contract = agent.contract
        self.rate_hz, self.path, self.inputs = agent.rate_hz, agent.path, agent.inputs
        self.gains: Gains = agent.gains
        self.clips_targets: bool = agent.clips_targets
        self.failures: Counter[str] = agent.failures
        if order is not None:
            back = np.argsort(order)
            pose = np.array(agent.contract.nominal_pose)[back]
            self.contract = dataclasses.replace(agent.contract, nominal_pose=tuple(pose.tolist()))
            self.gains = Gains(agent.gains.stiffness[back], agent.gains.damping[back])
        self.takes_commands = False
        self.last_inputs: Any = None
        self.last_targets = np.zeros((0, agent.robot.num_joints))
        self.last_ids = np.zeros(0, np.int64)

    inputs: Inputs

    def prepare(self, num_robots: int) -> None:
        """Get ready to drive robots 0 to `num_robots` - 1."""
        self.agent.prepare(num_robots)
        commands = np.zeros((num_robots, 3))
        for place, way in enumerate(self.ways):
            commands[place * self.num_each : (place + 1) * self.num_each] = way.command
        ask_for = getattr(self.agent, "ask_for", None)
        self.takes_commands = ask_for is not None and bool(ask_for(commands))

    def reset(self, ids: np.ndarray) -> None:
        """Forget robots `ids` (n,)."""
        self.agent.reset(ids)

    def __call__(self, inputs: Any, ids: np.ndarray) -> Command:
        """Decide one control step of robots `ids` (n,), each in its way."""
        given = quantities(inputs, self.robot)
        changed: dict[str, np.ndarray] = {}
        rows_of = [(way, np.flatnonzero(ids // self.num_each == place)) for place, way in enumerate(self.ways)]
        for way, rows in rows_of:
            names = () if way.order is None else ("joint_position", "joint_velocity")
            for name in (*names, *(name for name in way.negated if name in given)):
                values = changed.setdefault(name, given[name].copy())
                values[rows] = values[rows][:, way.order] if name in names else -values[rows]
        inputs = with_quantities(inputs, self.robot, changed)
        target, torque = _both(self.agent(inputs, ids))
        for way, rows in rows_of:
            if way.order is not None:
                back = np.argsort(way.order)
                target[rows] = target[rows][:, back]
                torque[rows] = torque[rows][:, back]
        self.last_inputs, self.last_targets, self.last_ids = inputs, target, ids
        return Command(target, torque)


def _both(command: Command) -> tuple[np.ndarray, np.ndarray]:
    """Targets and feed-forward torques (n, num_joints), in memory of their own."""
    target = np.array(command[0], float)
    torque = command[1] if len(command) > 1 else None
    return target, np.zeros_like(target) if torque is None else np.array(torque, float)
