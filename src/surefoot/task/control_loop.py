"""Control loop: the steps between an agent's decisions and the joints at 500 Hz, for a batch of robots.

Decisions become joint targets along a path, pushes become wrenches, ticks become what the agent is given next. The
environment and the evaluation differ only in what they make of the ticks.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from surefoot.errors import UserError
from surefoot.physics.engine import WHOLE_STEP, Engine
from surefoot.physics.engines import DEFAULT_ENGINE, make_engine
from surefoot.physics.pushes import Pushes
from surefoot.physics.signals import Delay, LowPass, Noise, cubic_path
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, CONTROL_HZ, TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.task import observation
from surefoot.task.agent import Agent, Command, as_numbers
from surefoot.task.guard import NOT_FINITE, Guard, prepare
from surefoot.task.imperfections import PERFECT, Imperfections
from surefoot.task.state import state_of

NUM_PUSHES = 2
"""How many pushes a robot may await or feel at the same time."""
CUBIC, LINE, HOLD = "cubic", "line", "hold"


class ControlLoop:
    """Policy steps of `num_robots` robots, under actions (`step`) or under an agent (`prepare`, then `drive`).

    Args:
        nominal: joint angles that an action of zero means, (num_joints,) [rad].
        action_scale: joint angle [rad] per unit of action.
        num_threads: of the engine; 0 for all cores.
        domain: what the robots stand on and are made of.
        engine: name of the physics engine.

    Attributes:
        engine: the physics of the robots.
        pushes: what pushes the robots, `NUM_PUSHES` slots each; the caller schedules them.
        tick: ticks since each robot's reset, (num_robots,).
        imperfect: which robots have imperfections, bool (num_robots,).
        nominal_com_height: height of the CoM above the soles in the nominal pose [m].
    """

    def __init__(
        self,
        robot: Robot,
        num_robots: int,
        nominal: np.ndarray,
        action_scale: float = 1.0,
        num_threads: int = 0,
        domain: DomainParameters = NOMINAL_DOMAIN,
        engine: str = DEFAULT_ENGINE,
    ):
        self.robot = robot
        self.nominal = nominal
        self.action_scale = action_scale
        self.engine: Engine = make_engine(engine, robot, num_robots, num_threads, domain)
        self.pushes = Pushes(robot, num_robots, NUM_PUSHES)
        self.tick = np.zeros(num_robots, np.int64)
        self.imperfect = np.zeros(num_robots, bool)
        self._everyone = np.arange(num_robots)
        self._pushed = np.zeros(0, np.int64)
        self._target = np.tile(nominal, (num_robots, 1))
        self._scales = observation.scales(robot)
        self._filter = LowPass(num_robots, len(self._scales), CONTROL_HZ)
        self._errors = LowPass(num_robots, len(self._scales), CONTROL_HZ)
        self._observation_noise = Noise(num_robots)
        self._action_noise = Noise(num_robots)
        self._bias = np.zeros((num_robots, len(self._scales)))
        self._delay = Delay(num_robots, TICKS_PER_STEP, robot.num_joints)
        self._guard: Guard | None = None
        self._path, self._parts = CUBIC, [WHOLE_STEP]
        self._stiffness, self._clips_targets = robot.stiffness, True
        self._seen: StepRecord | None = None
        self.nominal_com_height = float(self.engine.reset(np.array([0]), nominal[None], height=1.0).com_height[0, 0])
        self.reset(self._everyone, self._target)

    def prepare(self, agent: Agent) -> None:
        """Let an agent drive the robots from now on; its rate, path, inputs and gains are asked for here only.

        Raises:
            UserError: the agent wants a rate, a path, inputs or gains that there are not, or raises an error.
        """
        prepare(agent, len(self._everyone))
        self._guard = Guard(agent, len(self._everyone), self.robot.num_joints)
        self.nominal = np.array(agent.contract.nominal_pose)
        self.engine.set_gains(*agent.gains)
        self._stiffness, self._clips_targets = agent.gains.stiffness, agent.clips_targets
        self._path, num_ticks = agent.path, CONTROL_HZ // agent.rate_hz
        self._parts = [slice(first, first + num_ticks) for first in range(0, TICKS_PER_STEP, num_ticks)]
        now = self.engine.read(self._everyone)
        if self._seen is not None:
            self._filter.reset(self._everyone, _vectors(now))
        self._seen = now if agent.inputs == "state" else None

    @property
    def failed(self) -> dict[int, str]:
        """Robot -> reason, of the robots that the agent has failed since their reset; they hold their last targets."""
        return self._guard.failed if self._guard else {}

    @property
    def error(self) -> str:
        """The last exception that the agent raised, in words."""
        return self._guard.error if self._guard else ""

    @property
    def observation(self) -> np.ndarray:
        """The filtered observation at the end of each robot's last policy step: (num_robots, 47) float64."""
        return self.observe(slice(None))

    def observe(self, rows: np.ndarray | slice, with_errors: bool = True) -> np.ndarray:
        """The same of some robots only, or as they would observe it without their sensors' errors."""
        vector = observation.from_blocks(self._filter.output[rows], self.robot)
        return vector + self._errors.output[rows] if with_errors and self.imperfect.any() else vector

    def reset(self, ids: np.ndarray, joint_position: np.ndarray, **stance: np.ndarray | float) -> StepRecord:
        """Put perfect robots `ids` (n,) at rest and without a push, and let the agent forget them.

        The motors hold the start pose, from which the path to the first joint targets begins, and the filter is in the
        steady state of what is felt then.

        Args:
            ids: the robots' numbers.
            joint_position: (n, num_joints) [rad].
            stance: as for `Engine.reset`.

        Returns:
            One tick: the state that they start from.
        """
        return self._begin(ids, self.engine.reset(ids, joint_position, **stance), joint_position)

    def starts(self) -> tuple[np.ndarray, np.ndarray]:
        """Where all robots are right after their reset, for `restart`: states of the engine, joint targets."""
        return self.engine.rest_states(self._everyone), self._target.copy()

    def restart(self, ids: np.ndarray, states: np.ndarray, joint_targets: np.ndarray) -> StepRecord:
        """Reset robots `ids` (n,) to rows of `starts`, without the time that it takes a robot to stand up."""
        return self._begin(ids, self.engine.restart(ids, states), joint_targets)

    def _begin(self, ids: np.ndarray, start: StepRecord, joint_targets: np.ndarray) -> StepRecord:
        self._filter.reset(ids, _vectors(start))
        self._target[ids] = joint_targets
        self.tick[ids] = 0
        self.pushes.cancel(ids)
        if self.imperfect.any():
            self._errors.reset(ids, np.zeros((len(ids), len(self._scales))))
            self.imperfect[ids] = False
        if self._seen is not None:
            self._seen.record[ids] = start.record
        if self._guard:
            self._guard.reset(ids)
        return start

    def set_imperfections(self, robot: int, imperfections: Imperfections, seed: int) -> None:
        """Give one robot imperfections, right after its reset; `seed` draws its noise and its bias."""
        bias, observation_noise, action_noise = np.random.default_rng(seed).spawn(3)
        self._bias[robot] = imperfections.sensor_bias * self._scales * bias.standard_normal(len(self._scales))
        self._observation_noise.reset(robot, imperfections.observation_noise, observation_noise)
        self._action_noise.reset(robot, imperfections.action_noise, action_noise)
        self._delay.reset(robot, round(imperfections.latency * CONTROL_HZ), self._target[robot])
        self.imperfect[robot] = imperfections != PERFECT
        self._errors.reset(np.array([robot]), self._bias[None, robot])

    def step(self, actions: np.ndarray, ids: np.ndarray | None = None) -> StepRecord:
        """Advance robots by one policy step under actions.

        Args:
            actions: (n, num_joints); clipped to [-1, 1], scaled, added to the nominal pose, clipped to the joint
                ranges, and reached along a cubic within the step.
            ids: the robots (n,); all of them without it.

        Returns:
            The step's ticks of these robots, in a buffer that the next step overwrites.

        Raises:
            UserError: the actions are no numbers, or have the wrong shape.
        """
        num_actions = (len(self._everyone if ids is None else ids), self.robot.num_joints)
        try:
            asked = as_numbers(actions)
        except UserError as error:
            raise UserError(f"actions must have shape {num_actions}: {error}") from error
        if asked.shape != num_actions:
            raise UserError(f"actions must have shape {num_actions}, not {asked.shape}")
        goal = self.nominal + self.action_scale * np.clip(asked, -1.0, 1.0)
        self._write_pushes()
        goal = self._motor_targets(Command(goal), self._shake(ids), CUBIC)
        return self._advance(ids, WHOLE_STEP, goal, CUBIC)

    def drive(self, ids: np.ndarray | None = None) -> StepRecord:
        """Advance robots by one policy step under the agent, in as many control steps as its rate asks for.

        Args:
            ids: the robots (n,); all of them without it.

        Returns:
            The step's ticks of these robots; those of an agent at 25 Hz lie in a buffer that the next step overwrites.
        """
        assert self._guard, "no agent was given by `prepare`"
        self._guard.meet(self._everyone if ids is None else ids)
        self._write_pushes()
        shake = self._shake(ids)
        records = []
        for ticks in self._parts:
            goal = self._decide(ids, ticks, shake)
            records.append(self._advance(ids, ticks, goal, self._path, shake))
        return records[0] if len(records) == 1 else StepRecord.join(records)

    def _decide(self, ids: np.ndarray | None, ticks: slice, shake: np.ndarray | None) -> np.ndarray:
        """Ask the agent for the motor targets (n, num_joints) of a control step; robots that it fails keep theirs."""
        assert self._guard
        robots = self._everyone if ids is None else ids
        goal = self._target[robots]
        lost = self.engine.diverged[robots] if ticks.start else np.zeros(len(robots), bool)
        if self._guard.failed:
            lost |= np.isin(robots, list(self._guard.failed))
        asked = np.flatnonzero(~lost)
        if not len(asked):
            return goal
        for rows, command in self._guard.ask(self.inputs(robots[asked]), robots[asked]):
            rows = asked[rows]
            targets = self._motor_targets(command, None if shake is None else shake[rows], self._path)
            good = np.isfinite(targets).all(axis=1)
            goal[rows[good]] = targets[good]
            self._guard.fail(robots[rows[~good]], NOT_FINITE)
        return goal

    def inputs(self, ids: np.ndarray) -> Any:
        """Return the agent's input for robots `ids` (n,): their observations, or their `State`."""
        if self._seen is None:
            return self.observe(ids)
        ticks = self._seen[ids]
        vector = observation.observe(ticks)[:, 0]
        if self.imperfect[ids].any():
            vector = vector + self._errors.output[ids]
        return state_of(ticks, vector, self.tick[ids] * CONTROL_DT)

    def _motor_targets(self, command: Command, shake: np.ndarray | None, path: str) -> np.ndarray:
        """Motor targets (n, num_joints) [rad] of an agent's answer.

        A feed-forward torque is a target moved by torque / stiffness: the impedance then adds just that torque, and
        the motor's limits hold for the sum. Only the joint target proper is clipped to the joint's range, and only for
        an agent that lets it.

        The noise of the joint targets (n, num_joints) [rad] is part of what a cubic path leads to; `_advance` adds it
        to the other paths, which jump anyway.
        """
        target = command.joint_target
        if path == CUBIC and shake is not None:
            target = target + shake
        if self._clips_targets:
            target = np.clip(target, self.robot.joint_lower, self.robot.joint_upper)
        return target if command.joint_torque is None else target + command.joint_torque / self._stiffness

    def _shake(self, ids: np.ndarray | None) -> np.ndarray | None:
        """Noise of the joint targets for one policy step (n, num_joints) [rad]; None if nobody has any."""
        robots = self._everyone if ids is None else ids
        imperfect = np.flatnonzero(self.imperfect[robots])
        if not len(imperfect):
            return None
        shake = np.zeros((len(robots), self.robot.num_joints))
        # A robot that is perfect again since its reset still has the generator of its last noise.
        shake[imperfect] = self._action_noise.add(robots[imperfect], shake[imperfect])
        return shake

    def _advance(
        self, ids: np.ndarray | None, ticks: slice, goal: np.ndarray, path: str, shake: np.ndarray | None = None
    ) -> StepRecord:
        """Advance robots to motor targets (n, num_joints) within some ticks of a policy step, and observe them."""
        rows = slice(None) if ids is None else ids
        buffer = self.engine.joint_targets
        num_ticks = ticks.stop - ticks.start
        imperfect = np.flatnonzero(self.imperfect[rows])
        if path == CUBIC:  # for all robots and a whole step straight into the buffer
            straight = ids is None and ticks == WHOLE_STEP
            targets = cubic_path(self._target[rows], goal, num_ticks, buffer if straight else None)
        else:
            targets = _straight_path(self._target[rows], goal, num_ticks, path)
            targets = targets if shake is None else targets + shake[:, None]
        if len(imperfect):
            targets[imperfect] = self._delay(self._ids(rows, imperfect), targets[imperfect])
        if targets is not buffer:
            buffer[rows, ticks] = targets
        self._target[rows] = goal
        record = self.engine.step(ids, ticks)
        self._observe(record, rows)
        if len(imperfect):
            self._filter_errors(self._ids(rows, imperfect), num_ticks)
        self.tick[rows] += num_ticks
        return record

    def _observe(self, record: StepRecord, rows: np.ndarray | slice) -> None:
        if self._seen is None:
            self._filter(observation.blocks(record), rows)
        else:
            self._seen.record[rows] = record.record[:, -1:]

    def _write_pushes(self) -> None:
        self.engine.wrench[self._pushed] = 0.0
        self._pushed = self.pushes.write(self.engine.wrench, self.tick)

    def _filter_errors(self, ids: np.ndarray, num_ticks: int) -> None:
        """Advance what is wrong with the observations of robots `ids` (n,) by some ticks.

        It passes a filter of its own: the filter is linear, and so no robot's numbers depend on whether another one has
        errors.
        """
        bias = np.repeat(self._bias[ids, None], num_ticks, axis=1)
        self._errors([self._observation_noise.add(ids, bias)], ids)

    def _ids(self, rows: np.ndarray | slice, some: np.ndarray) -> np.ndarray:
        return some if isinstance(rows, slice) else rows[some]


def _vectors(ticks: StepRecord) -> np.ndarray:
    """The unfiltered observation of a single tick in the filter's order (n, num_observations)."""
    return np.concatenate(observation.blocks(ticks), axis=-1)[:, 0]


def _straight_path(start: np.ndarray, goal: np.ndarray, num_ticks: int, path: str) -> np.ndarray:
    """Targets (n, num_ticks, k) from `start` to `goal` (n, k): at once ("hold"), or along a line ("line")."""
    if path == HOLD:
        return np.repeat(goal[:, None], num_ticks, axis=1)
    share = (np.arange(1, num_ticks + 1) / num_ticks)[:, None]
    return start[:, None] + share * (goal - start)[:, None]
