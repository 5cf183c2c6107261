"""Setup: what an outcome depends on beside the agent, and in which part two of them differ."""

from __future__ import annotations

from dataclasses import dataclass

from surefoot.evaluation.protocol import PROTOCOL
from surefoot.physics.mujoco_engine import ENGINE_NAME
from surefoot.robots import Robot, load_robot

UNKNOWN_PROTOCOL = 0
"""Version that stands for all protocols from before versions were counted."""


@dataclass(frozen=True, order=True)
class Setup:
    """What an outcome depends on beside the agent; the columns of this name in results tables.

    Attributes:
        protocol: version of the definition of what is measured.
        robot: its name.
        robot_fingerprint: of its physical facts.
        engine: name and version of the physics engine.
    """

    protocol: int
    robot: str
    robot_fingerprint: str
    engine: str

    @classmethod
    def of(cls, robot: Robot) -> Setup:
        """The setup in which this version of surefoot runs a robot's trials."""
        return cls(PROTOCOL.version, robot.name, robot.fingerprint, ENGINE_NAME)

    @classmethod
    def now(cls, robot_name: str) -> Setup:
        """The setup in which this version of surefoot runs the trials of the robot of this name."""
        return cls.of(load_robot(robot_name))

    @property
    def is_known(self) -> bool:
        """Whether it can be compared with another setup, which older results do not allow."""
        return self.protocol != UNKNOWN_PROTOCOL

    def differences(self, now: Setup) -> list[str]:
        """What is otherwise in the setup `now`, in words; nothing for the same setup."""
        if not self.is_known:
            return ["it was written before results named their setup"]
        pairs = [
            ("protocol", self.protocol, now.protocol),
            ("robot", f"{self.robot} {self.robot_fingerprint}", f"{now.robot} {now.robot_fingerprint}"),
            ("engine", self.engine, now.engine),
        ]
        return [f"its {part} was {old} and is now {new}" for part, old, new in pairs if old != new]
