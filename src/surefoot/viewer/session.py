"""Session: the robots that users push, drag, drop and reset, independent of any page."""

from __future__ import annotations

import dataclasses

import numpy as np

from surefoot.errors import UserError
from surefoot.evaluation.strategies import StrategyWatch
from surefoot.evaluation.suites import NOISE
from surefoot.evaluation.trials import JOINT_NOISE
from surefoot.physics.pushes import NEVER, Push, Pushes
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_HZ, TICKS_PER_STEP
from surefoot.rendering.words import push_words
from surefoot.task.agent import Agent
from surefoot.task.control_loop import ControlLoop
from surefoot.task.guard import NOT_FINITE, RAISED, TOO_LATE, WRONG_SHAPE
from surefoot.task.imperfections import Imperfections
from surefoot.viewer.deeds import Deeds
from surefoot.viewer.verdict import State, Verdicts

MAX_ROBOTS = 64
LIFT_PER_MASS = 3.642
"""The paper lifts its robot by 500 Ns, then pushes it in the air (section V): so much per mass [Ns/kg]."""
AIRBORNE_S = 0.2
"""From the end of the lift to the push [s]: the robot is in the air then."""
PAPER_NOISE = NOISE["noise_both"].imperfections
"""Noise at 100 % on the panel."""
DOWN_S = 2.0
"""A fallen robot that stands up again by itself does so after that time [s]."""
HAND, PUSH = 0, 1
"""Slots of what hands and lifts do to a robot, and of pushes."""

_FAILURES = {
    RAISED: "raised an error",
    NOT_FINITE: "returned numbers that are not finite",
    WRONG_SHAPE: "returned an array of another shape than (robots, joints)",
    TOO_LATE: "took too long",
}
"""Failures of a policy, in words."""


class Session:
    """N robots under one policy, one policy step at a time.

    Args:
        policy: what moves them.
        num_robots: 1 to `MAX_ROBOTS`.
        seed: of start angles and noise.

    Attributes:
        verdicts: states and counts.
        deeds: what was done to the robots last.
        noise: share of the paper's noise on observation and joint targets.
        friction: coefficient of sliding friction between feet and floor.
        stands_up: do fallen robots stand up again after `DOWN_S`?
        message: what went wrong last, for the user; the reader empties it.
        num_steps: policy steps so far.
        ticks: of the last policy step; one tick only before the first.

    Raises:
        UserError: another number of robots.
    """

    def __init__(self, policy: Agent, num_robots: int = 1, seed: int = 0, num_threads: int = 0):
        if not 1 <= num_robots <= MAX_ROBOTS:
            raise UserError(f"the number of robots must be 1 to {MAX_ROBOTS}, not {num_robots}")
        self.policy = policy
        self.robot = policy.robot
        self.num_robots = num_robots
        self.loop = ControlLoop(self.robot, num_robots, np.array(policy.contract.nominal_pose), num_threads=num_threads)
        self.loop.prepare(policy)
        self.verdicts = Verdicts(num_robots)
        self.deeds = Deeds()
        self.noise = 0.0
        self.friction = self.robot.friction
        self.stands_up = True
        self.message = ""
        self.num_steps = 0
        self.everyone = np.arange(num_robots)
        self._watch = StrategyWatch(self.robot, num_robots)
        self._begin = np.full(num_robots, NEVER)
        self._told = [""] * num_robots
        self._failed: set[int] = set()
        self._rng = np.random.default_rng(seed)
        self._pulls: dict[int, tuple[int, np.ndarray]] = {}
        self.ticks = self.reset()

    # What a user does.

    def reset(self, ids: np.ndarray | None = None, height: float = 0.0) -> StepRecord:
        """Put robots `ids` (all without it) back to their place, `height` [m] above the floor; returns one tick."""
        ids = self.everyone if ids is None else ids
        noise = self._rng.uniform(-JOINT_NOISE, JOINT_NOISE, (len(ids), self.robot.num_joints))
        joints = np.clip(self.loop.nominal + noise, self.robot.joint_lower, self.robot.joint_upper)
        start = self.loop.reset(ids, joints, height=height)
        self._set_imperfections(ids)
        self.verdicts.reset(ids)
        self._watch.reset(ids, start)
        self._begin[ids] = NEVER
        self._failed -= set(ids.tolist())
        for robot in ids.tolist():
            self._pulls.pop(robot, None)
            self._told[robot] = ""
        return start

    def push(self, push: Push, ids: np.ndarray | None = None) -> None:
        """Push robots `ids` (all without it) `push.start` seconds from now, instead of what pushes them then."""
        self.deeds.begin(f"{push_words(push)}, {push.impulse / push.duration:.0f} N")
        self._schedule(PUSH, self.everyone if ids is None else ids, push)

    def lift_and_push(self, push: Push) -> None:
        """Lift all robots off the ground, and push them while they are in the air."""
        lift = Push("root", (0.0, 0.0, 1.0), impulse=float(round(LIFT_PER_MASS * self.robot.mass)))
        self._schedule(HAND, self.everyone, lift)
        after = lift.start + lift.duration + AIRBORNE_S
        self.deeds.begin(f"lifted by {push_words(lift)}, then {push_words(push)}")
        self._schedule(PUSH, self.everyone, dataclasses.replace(push, start=after))

    def drop(self, height: float) -> None:
        """Let all robots fall from `height` [m] above the floor."""
        self.deeds.begin(f"drop from {height:g} m")
        self.reset(height=height)
        self._disturb(self.everyone, self.loop.tick, self.loop.tick)

    def pull(self, robot: int, body: int, force: np.ndarray) -> None:
        """Hold a body (MuJoCo id) of one robot by a force (3,) [N] at its CoM until `release`."""
        self._pulls[robot] = body, np.asarray(force, float)
        self.deeds.pull(float(np.linalg.norm(force)))

    def release(self, robot: int) -> None:
        """Let go of a robot."""
        self._pulls.pop(robot, None)

    def set_noise(self, share: float) -> None:
        """A share of the paper's noise from now on."""
        self.noise = share
        self._set_imperfections(self.everyone)

    def set_policy(self, policy: Agent) -> None:
        """Go on with another policy for the same robot, in the middle of whatever is happening.

        Raises:
            UserError: it is for another robot.
        """
        if policy.robot.fingerprint != self.robot.fingerprint:
            raise UserError(f"{policy.name} is for {policy.contract.robot}, not {self.robot.name}")
        self.policy = policy
        self.loop.prepare(policy)
        self.verdicts.clear_counts()

    def set_friction(self, friction: float) -> None:
        """Sliding friction coefficient between every two bodies."""
        self.friction = friction
        self.loop.engine.set_friction(friction)

    # What time does.

    def step(self) -> StepRecord:
        """One policy step of all robots: their ticks, in a buffer that the next step overwrites."""
        self._hold()
        self.ticks = self.loop.drive()
        self._tell_failures()
        self.num_steps += 1
        diverged = self.loop.engine.diverged
        self._recognise(diverged)
        if diverged.any():
            self.message = f"the simulation of {int(diverged.sum())} robots became unstable; they start anew"
            self.reset(np.flatnonzero(diverged))
        elif self.stands_up:
            down = (self.verdicts.state == State.FELL) & (self.verdicts.since > DOWN_S)
            if down.any():
                self.reset(np.flatnonzero(down))
        return self.ticks

    @property
    def pushes(self) -> Pushes:
        """The forces on the robots: hands and lifts in slot `HAND`, pushes in slot `PUSH`."""
        return self.loop.pushes

    def since(self, tick: int) -> np.ndarray:
        """Time from the end of each push to a tick of the last step (num_robots, num_slots) [s].

        It is negative while the push lasts, and infinite before it and without one.
        """
        now = (self.loop.tick - len(self.ticks) + tick % len(self.ticks))[:, None]
        return np.where(now >= self.pushes.start, (now - self.pushes.end) / CONTROL_HZ, np.inf)

    @property
    def is_held(self) -> np.ndarray:
        """Whether a hand holds a robot, bool (num_robots,)."""
        return np.isin(self.everyone, list(self._pulls))

    def hand_force(self, robot: int) -> float:
        """The force of the hand that holds a robot [N]; 0 if none does."""
        return float(np.linalg.norm(self._pulls[robot][1])) if robot in self._pulls else 0.0

    def strategies(self, robot: int) -> str:
        """How a robot keeps its balance since its disturbance began, or did at the last one, in words."""
        if self.verdicts.state[robot] in (State.RECOVERING, State.FELL):
            return strategy_words(self._watch, robot)
        return self._told[robot]

    def is_pushed(self) -> bool:
        """Is any push under way or to come?"""
        end = self.pushes.end
        return bool(((self.loop.tick[:, None] < end) & (end < NEVER)).any())

    def _disturb(self, ids: np.ndarray, begin: np.ndarray, over: np.ndarray) -> None:
        """Robots `ids` (n,) are disturbed between these ticks (n,) since their reset."""
        self._begin[ids] = np.minimum(self._begin[ids], begin)
        self.verdicts.disturb(ids, over)

    def _recognise(self, diverged: np.ndarray) -> None:
        """Strategies and verdicts of the last step."""
        numbers = self.loop.tick[:, None] - TICKS_PER_STEP + np.arange(TICKS_PER_STEP)
        self._watch.update(self.everyone, self.ticks, numbers >= self._begin[:, None])
        before = self.verdicts.state.copy()
        self.verdicts.update(self.ticks, self.loop.tick, diverged)
        recovered = np.flatnonzero((self.verdicts.state == State.RECOVERED) & (before != State.RECOVERED))
        fell = np.flatnonzero((self.verdicts.state == State.FELL) & (before != State.FELL))
        how = strategy_words(self._watch, int([*fell, *recovered][-1])) if len(fell) + len(recovered) else ""
        self.deeds.count(len(recovered), len(fell), how)
        if len(recovered):
            for robot in recovered.tolist():
                self._told[robot] = strategy_words(self._watch, robot) or "without any strategy worth a name"
            self._watch.reset(recovered, self.ticks[recovered].ticks(slice(-1, None)))
            self._begin[recovered] = NEVER

    def _hold(self) -> None:
        """Set the forces of hands in the next step."""
        seconds = TICKS_PER_STEP / CONTROL_HZ
        for robot, (body, force) in self._pulls.items():
            ids, now = np.array([robot]), self.loop.tick[[robot]]
            self.pushes.schedule(ids, HAND, body, force * seconds, now, seconds)
            self.deeds.add_impulse(force * seconds)
            self._disturb(ids, now, now + TICKS_PER_STEP)

    def _schedule(self, slot: int, ids: np.ndarray, push: Push) -> None:
        body = self.robot.body_id(push.body)
        begin = self.loop.tick[ids] + round(push.start * CONTROL_HZ)
        self.pushes.schedule(ids, slot, body, push.impulse * np.array(push.direction), begin, push.duration)
        self._disturb(ids, begin, begin + round(push.duration * CONTROL_HZ))

    def _set_imperfections(self, ids: np.ndarray) -> None:
        imperfections = Imperfections(self.noise * PAPER_NOISE.observation_noise, self.noise * PAPER_NOISE.action_noise)
        for robot in ids.tolist():
            self.loop.set_imperfections(robot, imperfections, int(self._rng.integers(2**31)))

    def _tell_failures(self) -> None:
        """Tell once of every robot that the policy has failed; its joints hold their last targets until its reset."""
        failed = self.loop.failed
        new = [reason for robot, reason in failed.items() if robot not in self._failed]
        self._failed = set(failed)
        if new:
            words = _FAILURES[new[0]] + (f" ({self.loop.error})" if new[0] == RAISED else "")
            self.message = f"policy {self.policy.name} {words}; the joints hold their last targets"


def strategy_words(watch: StrategyWatch, robot: int) -> str:
    """The strategies that a robot has used since its disturbance began; empty without any."""
    words = str(watch.strategies(robot))
    return "" if words == "none" else words
