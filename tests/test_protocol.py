"""The protocol: its numbers belong to its version, and a setup says which part of it differs from another."""

from __future__ import annotations

import dataclasses

from surefoot.evaluation.protocol import PROTOCOL, Protocol
from surefoot.evaluation.setup import Setup
from surefoot.physics.mujoco_engine import ENGINE_NAME
from surefoot.robots import Robot

FINGERPRINTS = {1: "8e02620aeb8e", 2: "f85b2d1b7cb4"}
"""Version -> fingerprint of its numbers. Whoever changes a number adds a line; the old ones stay."""


def test_a_changed_number_raises_the_version() -> None:
    assert FINGERPRINTS[PROTOCOL.version] == PROTOCOL.fingerprint
    assert max(FINGERPRINTS) == PROTOCOL.version


def test_every_number_counts_and_the_version_does_not() -> None:
    names = [field.name for field in dataclasses.fields(Protocol) if field.name != "version"]
    changed = [dataclasses.replace(PROTOCOL, **{name: 2 * getattr(PROTOCOL, name)}) for name in names]
    assert len({protocol.fingerprint for protocol in (PROTOCOL, *changed)}) == len(names) + 1
    assert dataclasses.replace(PROTOCOL, version=99).fingerprint == PROTOCOL.fingerprint


def test_a_setup_names_protocol_robot_and_engine(robot: Robot) -> None:
    assert Setup.of(robot) == Setup(PROTOCOL.version, robot.name, robot.fingerprint, ENGINE_NAME)
    assert Setup.now(robot.name) == Setup.of(robot)
    name, version = ENGINE_NAME.split(" ")
    assert name == "mujoco"
    assert version[0].isdigit()


def test_a_setup_says_in_words_what_is_otherwise(robot: Robot) -> None:
    now = Setup.of(robot)
    assert now.differences(now) == []
    old = Setup(PROTOCOL.version + 1, robot.name, "0" * 12, "mujoco 3.0")
    assert old.differences(now) == [
        f"its protocol was {PROTOCOL.version + 1} and is now {PROTOCOL.version}",
        f"its robot was {robot.name} {'0' * 12} and is now {robot.name} {robot.fingerprint}",
        f"its engine was mujoco 3.0 and is now {ENGINE_NAME}",
    ]
