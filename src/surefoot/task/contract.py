"""Contract: what an agent assumes about the robot and the control loop, in a form that a policy file can carry."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from typing import Any

from surefoot.checks import check_fields, check_path, check_text, is_number, parse_json_table, shortened
from surefoot.errors import UserError
from surefoot.physics.signals import CUTOFF_HZ
from surefoot.rates import CONTROL_HZ, POLICY_HZ
from surefoot.robots import Robot, load_robot
from surefoot.task import observation

FORMAT = 1
MEMORY_FORMAT = 2
"""The format of policies that take past observations or actions: versions before cannot run them."""
MOST_PAST = 250
"""Ten seconds: more is a mistake."""
_LARGE = 1e6
"""No angle and no scale is as large."""
_MEMORY = ("past_observations", "past_actions")


@dataclass(frozen=True)
class Contract:
    """All that is needed to use a policy.

    Attributes:
        robot: its name.
        robot_fingerprint: of its physical facts, `Robot.fingerprint`; empty in files of before there were any.
        joints: joint order of the action and of the observation's joint parts.
        nominal_pose: joint angles that an action of zero means [rad].
        action_scale: joint angle [rad] per unit of action, which is clipped to [-1, 1] first.
        observations: names of the observation's components, in order.
        stiffness, damping: impedance gains per joint [Nm/rad, Nms/rad].
        torque_limit, velocity_limit: per joint [Nm, rad/s].
        policy_hz, control_hz: rates of the policy and of the joint control.
        filter_cutoff_hz: of the first-order Butterworth low-pass on the observation at `control_hz`.
        target_path: how joint targets are reached within a policy step.
        past_observations, past_actions: how many of them the network takes behind the present observation, see
            `Memory`; there are none in files of format 1.
        training: where the policy comes from (algorithm, preset, seed, steps, minutes, versions).
    """

    robot: str
    joints: tuple[str, ...]
    nominal_pose: tuple[float, ...]
    action_scale: float
    observations: tuple[str, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    torque_limit: tuple[float, ...]
    velocity_limit: tuple[float, ...]
    policy_hz: int = POLICY_HZ
    control_hz: int = CONTROL_HZ
    filter_cutoff_hz: float = CUTOFF_HZ
    target_path: str = "cubic"
    training: dict[str, Any] = field(default_factory=dict)
    format: int = FORMAT
    robot_fingerprint: str = ""
    past_observations: int = 0
    past_actions: int = 0

    @classmethod
    def of(
        cls,
        robot: Robot,
        pose: str,
        action_scale: float,
        training: dict[str, Any] | None = None,
        past_observations: int = 0,
        past_actions: int = 0,
    ) -> Contract:
        """The contract of a policy for this robot as this version of surefoot runs it."""
        return cls(
            robot=robot.name,
            joints=robot.joint_names,
            nominal_pose=tuple(robot.pose(pose).tolist()),
            action_scale=action_scale,
            observations=observation.component_names(robot),
            stiffness=tuple(robot.stiffness.tolist()),
            damping=tuple(robot.damping.tolist()),
            torque_limit=tuple(robot.torque_limit.tolist()),
            velocity_limit=tuple(robot.velocity_limit.tolist()),
            training=training or {},
            robot_fingerprint=robot.fingerprint,
            format=MEMORY_FORMAT if past_observations or past_actions else FORMAT,
            past_observations=past_observations,
            past_actions=past_actions,
        )

    @property
    def num_inputs(self) -> int:
        """Numbers that the network takes: the present observation, and the past that it is given."""
        past = self.past_observations * len(self.observations) + self.past_actions * len(self.joints)
        return len(self.observations) + past

    def check(self) -> Robot:
        """The robot that the policy is for.

        Raises:
            UserError: this version of surefoot cannot honour the contract.
        """
        if not isinstance(self.robot, str):
            raise UserError(f"policy's robot must be a name, not {shortened(self.robot)}")
        check_path("policy's robot", self.robot)
        check_text("policy's robot_fingerprint", self.robot_fingerprint)
        robot = load_robot(self.robot)
        if self.robot_fingerprint and self.robot_fingerprint != robot.fingerprint:
            raise UserError(
                f"policy is for a {robot.name} with other masses, joints or motors: its robot's fingerprint is "
                f"{self.robot_fingerprint[:12]}, that of this {robot.name} is {robot.fingerprint[:12]}"
            )
        self._check_numbers(robot)
        memory = {name: getattr(self, name) for name in _MEMORY}
        expected = Contract.of(robot, next(iter(robot.poses)), self.action_scale, **memory)
        free = {"nominal_pose", "action_scale", "training", "robot_fingerprint"}
        for name in (f.name for f in dataclasses.fields(self) if f.name not in free):
            if getattr(self, name) != getattr(expected, name):
                raise UserError(
                    f"policy's {name} is {shortened(getattr(self, name), 1000)}, but {robot.name} has "
                    f"{getattr(expected, name)}"
                )
        return robot

    def _check_numbers(self, robot: Robot) -> None:
        pose, scale = self.nominal_pose, self.action_scale
        is_pose = isinstance(pose, tuple) and len(pose) == robot.num_joints
        if not (is_pose and all(is_number(angle) and abs(angle) < _LARGE for angle in pose)):
            raise UserError(f"policy's nominal_pose must be {robot.num_joints} finite angles, not {shortened(pose)}")
        if not (is_number(scale) and 0 < scale < _LARGE):
            raise UserError(f"policy's action_scale must be positive, not {shortened(scale)}")
        for name in _MEMORY:
            if type(number := getattr(self, name)) is not int or not 0 <= number <= MOST_PAST:
                raise UserError(
                    f"policy's {name} must be a whole number from 0 to {MOST_PAST}, not {shortened(number)}"
                )

    def to_json(self) -> str:
        """Write the contract as `from_json` reads it."""
        return json.dumps(self._values())

    def assumptions(self) -> str:
        """The contract as JSON, without the robot's fingerprint: results name their robot by themselves."""
        values = self._values()
        del values["robot_fingerprint"]
        return json.dumps(values)

    def _values(self) -> dict[str, Any]:
        """All clauses; without a memory those of format 1, which versions before know."""
        values = dataclasses.asdict(self)
        return {key: value for key, value in values.items() if key not in _MEMORY or value}

    @classmethod
    def from_json(cls, text: str) -> Contract:
        """Read what `to_json` wrote.

        Raises:
            ValueError, TypeError, KeyError: the text is anything else.
        """
        table = parse_json_table(text, "a contract")
        values: Any = {k: tuple(v) if isinstance(v, list) else v for k, v in table.items()}
        _check_training(values.get("training", {}))
        return cls(**values)


def _check_training(record: Any) -> None:
    """Check the types of what others read of a training record, and of the record of what that run began with."""
    while record is not None:
        if not isinstance(record, dict):
            raise UserError(f"training must be a table, not {shortened(record)}")
        check_fields(_Training, record, "training")
        record = record.get("after")


@dataclass(frozen=True)
class _Training:
    """The types of the entries of a training record that surefoot itself writes."""

    algorithm: str
    preset: str
    seed: int
    policy_steps: int
    minutes: float
    cores: int | None
    machine: str
    surefoot: str
    commit: str | None
    controller: str
    validation: dict[str, Any]
    selection: tuple[dict[str, Any], ...]
