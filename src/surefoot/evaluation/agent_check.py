"""Agent check: trials that show whether a fault is in a policy or its adapter, also with wrong adapters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from surefoot.errors import UserError
from surefoot.evaluation.agent_inputs import quantities, small_change, with_quantities
from surefoot.evaluation.agent_ways import AS_GIVEN, AgentInWays, Way, wrong_ways
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.trials import SETTLE_S, Trial, TrialSource, run_trials
from surefoot.physics.rotations import horizontal
from surefoot.physics.step_record import StepRecord
from surefoot.rates import POLICY_DT
from surefoot.robots import Robot
from surefoot.task.agent import Agent, Command

STAND_S = 20.0
"""For how long an agent has to stand."""
NUM_EACH = 4
"""Robots in each way; their start angles differ."""
COMMANDS = {
    "asked to walk forward": (0.4, 0.0, 0.0),
    "asked to walk to the left": (0.0, 0.3, 0.0),
    "asked to turn left": (0.0, 0.0, 0.4),
}
"""Commands that an agent which takes any has to follow [m/s, m/s, rad/s]."""
FOLLOWS = 0.5
"""An agent follows a command if its mean speed is at least this share of what it was asked for."""


@dataclass
class WayResult:
    """The outcome of robots that were driven in one way.

    Attributes:
        way: how they were driven.
        outcomes: of their trials.
        speed: mean forward, left and turning speed while they walked (3,) [m/s, m/s, rad/s].
    """

    way: Way
    outcomes: list[Outcome] = field(default_factory=list)
    speed: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))

    @property
    def num_stood(self) -> int:
        """How many did not fall."""
        return sum(outcome.reason in ("recovered", "restless", "tilted") for outcome in self.outcomes)

    @property
    def seconds(self) -> float:
        """Median time that they stood, from their start on [s]."""
        return float(np.median([outcome.seconds + SETTLE_S for outcome in self.outcomes]))

    @property
    def follows(self) -> bool:
        """Whether they went where they were asked to go."""
        command = np.array(self.way.command)
        return bool(self.speed @ command >= FOLLOWS * command @ command)


@dataclass(frozen=True)
class Range:
    """The lowest, mean and highest number of an input while the agent stood."""

    low: float
    mean: float
    high: float


@dataclass(frozen=True)
class AgentCheck:
    """The results of an agent check.

    Attributes:
        given: what became of it as it is.
        wrong: what became of it in ways in which adapters are wrong.
        commands: how it followed commands; empty if it takes none.
        ranges: name -> what it was given while it stood.
        reactions: name -> how far its joint targets move by a small change of the input [rad], root mean square.
        target_error: by joint, median distance of the angle from its target while it stood (num_joints,) [rad].
        beyond_share: share of its targets that lie beyond the joint ranges.
    """

    given: WayResult
    wrong: list[WayResult]
    commands: list[WayResult]
    ranges: dict[str, Range]
    reactions: dict[str, float]
    target_error: np.ndarray
    beyond_share: float

    @property
    def stands(self) -> bool:
        """Whether all robots stood still for the whole time, driven as the agent is given."""
        return all(outcome.recovered for outcome in self.given.outcomes)

    @property
    def better_ways(self) -> list[WayResult]:
        """Wrong ways in which more robots stood than as the agent is given."""
        better = [result for result in self.wrong if result.num_stood > self.given.num_stood]
        return sorted(better, key=lambda result: -result.num_stood)

    @property
    def indifferent_ways(self) -> list[WayResult]:
        """Wrong ways in which all robots stood, although the agent is right as it is given."""
        return [result for result in self.wrong if self.stands and result.num_stood == len(result.outcomes)]


def check_agent_by_driving(agent: Agent, seconds: float = STAND_S, num_threads: int = 0) -> AgentCheck:
    """Drive an agent in its own way and in wrong ones, and ask what it reacts to.

    Args:
        agent: the agent.
        seconds: for how long it has to stand.
        num_threads: of the physics; 0 for all cores.

    Raises:
        UserError: it fails before the robots have moved; the message says how.
    """
    ways = [Way(AS_GIVEN), *wrong_ways(agent.robot)]
    commands = [Way(name, command=command) for name, command in COMMANDS.items()]
    driven = AgentInWays(agent, [*ways, *commands], NUM_EACH)
    results, watch = _drive(driven, seconds, num_threads)
    _check_answers(agent, results[0])
    found = AgentCheck(
        given=results[0],
        wrong=results[1 : len(ways)],
        commands=results[len(ways) :] if driven.takes_commands else [],
        ranges=watch.ranges(),
        reactions=_reactions(agent, watch.stream),
        target_error=watch.target_error(),
        beyond_share=watch.beyond_share(),
    )
    if found.stands or found.better_ways:
        return found
    # The whole description of the joints may stand in another order, and not only the observations and the actions.
    for way in ways:
        if way.order is not None:
            whole = Way(f"{way.name}, gains and pose too", way.order)
            found.wrong.extend(_drive(AgentInWays(agent, [whole], NUM_EACH, way.order), seconds, num_threads)[0])
    return found


def _drive(driven: AgentInWays, seconds: float, num_threads: int) -> tuple[list[WayResult], _Watch]:
    """Let an agent stand in each of its ways."""
    watch, source = _Watch(driven), _InOrder(len(driven.ways) * NUM_EACH, seconds)
    results = [WayResult(way) for way in driven.ways]
    run_trials(driven, source, source.num_trials, num_threads, watch)
    for place, outcome in source.outcomes.items():
        results[place // NUM_EACH].outcomes.append(outcome)
    for place, result in enumerate(results):
        result.speed = watch.mean_speed(place)
    return results, watch


def _check_answers(agent: Agent, given: WayResult) -> None:
    failed = [outcome.reason for outcome in given.outcomes if outcome.reason in ("raised", "wrong shape", "not finite")]
    if failed:
        words = next((words for words in agent.failures if words.startswith(failed[0])), failed[0])
        raise UserError(f"{agent.name} fails while the robot stands: {words}")


class _InOrder(TrialSource):
    """Undisturbed trials, one in each slot, which all start at the same time."""

    def __init__(self, num_trials: int, seconds: float):
        self.num_trials, self.seconds = num_trials, seconds
        self._next = 0
        self.outcomes: dict[int, Outcome] = {}

    def next(self) -> Trial | None:
        if self._next == self.num_trials:
            return None
        self._next += 1
        return Trial(seed=self._next - 1, horizon=self.seconds - SETTLE_S, quiet_from=0.5 * self.seconds)

    def report(self, trial: Trial, outcome: Outcome) -> None:
        self.outcomes[trial.seed] = outcome


class _Watch:
    """Sees what the agent is given and answers, and where its robots go; robots of the first way are its own.

    Attributes:
        stream: what the first robot was given at every control step.
    """

    def __init__(self, driven: AgentInWays):
        self.driven = driven
        self.stream: list[Any] = []
        self._inputs: dict[str, list[np.ndarray]] = {}
        self._errors: list[np.ndarray] = []
        self._beyond: list[np.ndarray] = []
        self._speeds: list[list[np.ndarray]] = [[] for _ in driven.ways]
        self._num_steps = 0

    def __call__(self, running: np.ndarray, ticks: StepRecord) -> None:
        """Take in a policy step of the robots that run."""
        self._num_steps += 1
        now, robot = self.driven, self.driven.robot
        own = np.flatnonzero(now.last_ids < now.num_each)
        if len(own):
            named = getattr(now.agent, "observed", {}) or quantities(now.last_inputs, robot)
            for name, values in named.items():
                self._inputs.setdefault(name, []).append(values[own].reshape(len(own), -1))
            targets = now.last_targets[own]
            self._beyond.append((targets < robot.joint_lower) | (targets > robot.joint_upper))
            rows = np.flatnonzero(running < now.num_each)
            if len(rows) == len(own):
                self._errors.append(np.abs(targets - ticks.joint_position[rows, -1]))
        if now.last_ids[0] == 0 and len(self.stream) < 60:
            self.stream.append(now.last_inputs[:1])
        if self._num_steps * POLICY_DT > SETTLE_S + 1.0:  # they walk by now
            self._add_speeds(running, ticks)

    def _add_speeds(self, running: np.ndarray, ticks: StepRecord) -> None:
        forward = ticks.heading[:, -1].conj()
        along = horizontal(ticks["root_velocity"][:, -1]) * forward
        turning = ticks["root_angular_velocity"][:, -1, 2]
        speeds = np.stack([along.real, along.imag, turning], axis=1)
        for place in range(len(self._speeds)):
            rows = running // self.driven.num_each == place
            if rows.any():
                self._speeds[place].append(speeds[rows].mean(axis=0))

    def mean_speed(self, place: int) -> np.ndarray:
        """Mean forward, left and turning speed of the robots of one way (3,) [m/s, m/s, rad/s]."""
        return np.mean(self._speeds[place], axis=0) if self._speeds[place] else np.full(3, np.nan)

    def ranges(self) -> dict[str, Range]:
        """Name -> the range of what the agent was given."""
        joined = {name: np.concatenate(values) for name, values in self._inputs.items()}
        return {name: Range(float(v.min()), float(v.mean()), float(v.max())) for name, v in joined.items() if v.size}

    def target_error(self) -> np.ndarray:
        """By joint, the median distance of the angle from its target (num_joints,) [rad]."""
        none = np.zeros((1, self.driven.robot.num_joints))
        return np.median(np.concatenate([none, *self._errors][bool(self._errors) :]), axis=0)

    def beyond_share(self) -> float:
        """Share of the targets that lie beyond the joint ranges."""
        return float(np.mean(np.concatenate(self._beyond))) if self._beyond else 0.0


def _reactions(agent: Agent, stream: Sequence[Any]) -> dict[str, float]:
    """How far the targets move [rad] by a small change of each input, after what a standing robot has seen.

    Every input has a robot of its own, which sees the same as all others but for the last control step.
    """
    if not stream:
        return {}
    robot = agent.robot
    names = list(quantities(stream[0], robot))
    ids = np.arange(len(names) + 1)
    agent.prepare(len(ids))
    agent.reset(ids)
    targets = np.zeros((len(ids), robot.num_joints))
    for place, inputs in enumerate(stream):
        given = inputs[np.zeros(len(ids), np.int64)]
        if place == len(stream) - 1:
            given = _each_changed(given, robot)
        targets = _as_targets(agent(given, ids), agent)
    moved = np.sqrt(np.mean((targets[1:] - targets[0]) ** 2, axis=1))
    return dict(zip(names, moved.tolist(), strict=True))


def _as_targets(command: Command, agent: Agent) -> np.ndarray:
    """Joint targets, with the feed-forward torque as the angle that gives it."""
    target = np.asarray(command[0], float)
    torque = command[1] if len(command) > 1 else None
    return target if torque is None else target + np.asarray(torque) / agent.gains.stiffness


def _each_changed(given: Any, robot: Robot) -> Any:
    """Inputs of the robots (n + 1,) in which the i-th quantity is a little different for robot i + 1."""
    rng = np.random.default_rng(0)
    changed = {}
    for row, (name, values) in enumerate(quantities(given, robot).items(), start=1):
        values = np.array(values, float)
        values[row] += small_change(name, given) * rng.choice([-1.0, 1.0], np.shape(values[row]))
        changed[name] = values
    return with_quantities(given, robot, changed)
