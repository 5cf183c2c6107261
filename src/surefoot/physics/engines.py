"""Engines: the physics engines by the names under which commands and results know them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from surefoot import cores
from surefoot.errors import UserError
from surefoot.physics import mujoco_engine, pybullet_engine
from surefoot.physics.engine import Engine
from surefoot.robots import Robot
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters

DEFAULT_ENGINE = "mujoco"


class _MakeEngine(Protocol):
    def __call__(self, robot: Robot, num_robots: int, num_threads: int, domain: DomainParameters) -> Engine: ...


@dataclass(frozen=True)
class EngineKind:
    """A physics engine that trials can run in.

    Attributes:
        make: an engine with so many robots on so many threads, 0 for all cores, in a domain.
        title: its name and version, as results are kept with it.
        num_slots: robots of a batch of trials; 0 for the usual number.
    """

    make: _MakeEngine
    title: Callable[[], str]
    num_slots: int = 0


ENGINES = {
    DEFAULT_ENGINE: EngineKind(mujoco_engine.MujocoEngine, lambda: mujoco_engine.ENGINE_NAME),
    "pybullet": EngineKind(pybullet_engine.PybulletEngine, pybullet_engine.engine_name, num_slots=8),
}
"""Name -> engine; the name is also the first word of the title."""


def engine_kind(name: str) -> EngineKind:
    """The engine of a name.

    Raises:
        UserError: there is no such engine.
    """
    if name not in ENGINES:
        raise UserError(f"unknown engine '{name}'; valid: {', '.join(ENGINES)}")
    return ENGINES[name]


def make_engine(
    name: str, robot: Robot, num_robots: int, num_threads: int = 0, domain: DomainParameters = NOMINAL_DOMAIN
) -> Engine:
    """`num_robots` copies of a robot in the engine of a name.

    Raises:
        UserError: there is no such engine, it is not installed, or it does not take this robot.
    """
    return engine_kind(name).make(robot, num_robots, num_threads or cores.num_threads(), domain)
