"""Setup: the conditions of an outcome beside the agent, and the part in which two setups differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from surefoot.evaluation.protocol import PROTOCOL
from surefoot.physics.engines import DEFAULT_ENGINE, ENGINES, engine_kind
from surefoot.robots import Robot, load_robot

UNKNOWN_PROTOCOL = 0
"""Version that stands for all protocols from before versions were counted."""


class Measured(NamedTuple):
    """What thresholds were measured of: the key of tables with several policies, robots and engines.

    Attributes:
        name: of the policy or controller.
        robot: its name.
        engine: name of the physics engine, without its version.
    """

    name: str
    robot: str
    engine: str = DEFAULT_ENGINE

    @property
    def shown(self) -> str:
        """The name in tables, with the engine that is not the default one."""
        return self.name if self.engine == DEFAULT_ENGINE else f"{self.name} in {self.engine}"


@dataclass(frozen=True, order=True)
class Setup:
    """The conditions of an outcome beside the agent; the columns of this name in results tables.

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
    def of(cls, robot: Robot, engine: str = DEFAULT_ENGINE) -> Setup:
        """The setup in which this version of surefoot runs a robot's trials in the engine of this name.

        Raises:
            UserError: there is no such engine, or it is not installed.
        """
        return cls(PROTOCOL.version, robot.name, robot.fingerprint, engine_kind(engine).title())

    @classmethod
    def now(cls, robot_name: str, engine: str = DEFAULT_ENGINE) -> Setup:
        """The setup in which this version of surefoot runs the trials of the robot of this name."""
        return cls.of(load_robot(robot_name), engine)

    @property
    def engine_word(self) -> str:
        """Name of the engine without its version; the default engine's for results of before there were others."""
        word = self.engine.split(" ")[0]
        return word if word in ENGINES else DEFAULT_ENGINE

    def shown(self, name: str) -> str:
        """The name of a policy or controller in tables, with the engine that is not the default one."""
        return Measured(name, self.robot, self.engine_word).shown

    @property
    def is_known(self) -> bool:
        """Whether it can be compared with another setup, which older results do not allow."""
        return self.protocol != UNKNOWN_PROTOCOL

    def differences(self, now: Setup) -> list[str]:
        """Name the parts that differ in the setup `now`; nothing for the same setup."""
        if not self.is_known:
            return ["it was written before results named their setup"]
        pairs = [
            ("protocol", self.protocol, now.protocol),
            ("robot", f"{self.robot} {self.robot_fingerprint}", f"{now.robot} {now.robot_fingerprint}"),
            ("engine", self.engine, now.engine),
        ]
        return [f"its {part} was {old} and is now {new}" for part, old, new in pairs if old != new]
