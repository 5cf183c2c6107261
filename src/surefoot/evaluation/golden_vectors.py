"""Golden vectors: every number of a short run of a policy, as a reference for other implementations."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import butter, lfilter

from surefoot.agents.network import NetworkAgent
from surefoot.physics.pushes import horizontal_push
from surefoot.physics.signals import CUTOFF_HZ
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_HZ, TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.task import observation
from surefoot.task.control_loop import ControlLoop
from surefoot.whole_file import write_whole

NUM_STEPS = 50
"""Policy steps of the run: two seconds."""
PUSHES = ((5, 90.0, 60.0), (30, 700.0, 200.0))
"""Pushes at the root: the policy step at which one begins, its impulse [Ns] for the paper's robot, in proportion to the
mass for others, and its direction [deg]. The second one takes joints to their speed limits and actions past theirs."""
_START = 0.02
"""Start angles differ from the nominal pose by up to this [rad], so that the first path has a way to go."""
_STATE = {
    "joint_position": 0, "joint_velocity": 0, "root_position": 3, "root_orientation": 4, "root_velocity": 3,
    "root_angular_velocity": 3, "com_position": 3, "com_velocity": 3, "torso_position": 3, "left_sole_position": 3,
    "right_sole_position": 3,
}  # fmt: skip
"""Parts of the state and their sizes, 0 for one number a joint; world frame and SI units."""
_AXES = {3: ("x", "y", "z"), 4: ("w", "x", "y", "z")}


@dataclass(frozen=True)
class GoldenVectors:
    """A run, one row a tick; every tick is told at its start.

    Attributes:
        columns: names of the columns; those of one kind begin with the same word.
        rows: (num_ticks, num_columns).
    """

    columns: tuple[str, ...]
    rows: np.ndarray

    def write(self, path: str | Path) -> None:
        """Write the run as .csv, every number to the last bit.

        Raises:
            UserError: the file cannot be written.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([[repr(value) for value in row] for row in self.rows.tolist()])
        write_whole(Path(path), text.getvalue().encode())


def golden_vectors(policy: NetworkAgent) -> GoldenVectors:
    """Run a policy for two seconds in its nominal pose, with two pushes, and keep every number on its way.

    The columns are `tick`, the state, `foot_force.*` [N], `observation.*` and `filtered.*` in the order and the units
    of the contract, `action.*` (of the policy step, not clipped), `target.*` of the motors [rad] and `torque.*` [Nm].
    The first row is tick -1: the robot at rest before the loop begins, when no action has been taken.
    """
    robot = policy.robot
    loop = ControlLoop(robot, 1, np.array(policy.contract.nominal_pose), num_threads=1)
    loop.prepare(policy)
    offset = np.random.default_rng(0).uniform(-_START, _START, robot.num_joints)
    held = np.clip(loop.nominal + offset, robot.joint_lower, robot.joint_upper)
    seen, targets = [], [held[None]]
    records = [loop.reset(np.array([0]), held[None]).copy()]
    _push(loop, robot)
    for _ in range(NUM_STEPS):
        seen.append(loop.observe(np.array([0]))[0])
        records.append(loop.drive().copy())
        targets.append(loop.engine.joint_targets[0].copy())
    actions = np.repeat(_actions(policy, np.array(seen)), TICKS_PER_STEP, axis=0)
    actions = np.concatenate([np.full((1, robot.num_joints), np.nan), actions])
    return _table(robot, StepRecord.join(records), np.array(seen), actions, np.concatenate(targets))


def _push(loop: ControlLoop, robot: Robot) -> None:
    for slot, (step, impulse, angle) in enumerate(PUSHES):
        push, tick = horizontal_push("root", angle, impulse * robot.mass_scale), step * TICKS_PER_STEP
        wrench = push.impulse * np.array(push.direction)
        loop.pushes.schedule(np.array([0]), slot, robot.body_id(push.body), wrench, tick, push.duration)


def _actions(policy: NetworkAgent, seen: np.ndarray) -> np.ndarray:
    """Ask the policy once more, for its actions instead of its targets (num_steps, num_joints)."""
    memory = policy.new_memory()
    memory.prepare(1)
    actions = []
    for filtered in seen:
        inputs = memory.inputs(filtered[None], np.array([0]))
        actions.append(policy.actions(inputs)[0].astype(np.float64))
        memory.add(filtered[None], np.clip(actions[-1][None], -1.0, 1.0), np.array([0]))
    return np.array(actions)


def _table(
    robot: Robot, record: StepRecord, seen: np.ndarray, actions: np.ndarray, targets: np.ndarray
) -> GoldenVectors:
    joints, components = robot.joint_names, observation.component_names(robot)
    columns, parts = ["tick"], [np.arange(-1.0, len(record) - 1.0)[:, None]]
    for quantity, size in _STATE.items():
        columns += [f"{quantity}.{part}" for part in (_AXES.get(size) or joints)]
        parts.append(record[quantity][0])
    observed = observation.observe(record)[0]
    filtered = _filtered(observed)
    # What the policy was given is the filter's output at the last tick before its step.
    assert np.allclose(filtered[:-1:TICKS_PER_STEP], seen, rtol=0.0, atol=1e-9)
    for kind, names, values in (
        ("foot_force", ("left", "right"), record.foot_force[0]),
        ("observation", components, observed),
        ("filtered", components, filtered),
        ("action", joints, actions),
        ("target", joints, targets),
        ("torque", joints, record.joint_torque[0]),
    ):
        columns += [f"{kind}.{name}" for name in names]
        parts.append(values)
    return GoldenVectors(tuple(columns), np.concatenate(parts, axis=1))


def _filtered(observed: np.ndarray) -> np.ndarray:
    """The low-pass of a run (num_ticks, n), tick by tick, from the steady state of its first vector."""
    b, a = butter(1, CUTOFF_HZ, fs=CONTROL_HZ)
    state = (b[1] - a[1]) * observed[:1]
    return lfilter(b, a, observed, axis=0, zi=state)[0]
