"""Load: the making of an agent from a foreign policy's file."""

from __future__ import annotations

import hashlib
from pathlib import Path

from surefoot.agents.controllers.controller import ControllerAgent
from surefoot.agents.foreign.metadata import read_interface
from surefoot.agents.foreign.network import Network, read_metadata
from surefoot.agents.foreign.policy import ForeignPolicy
from surefoot.agents.policy_file import METADATA_KEY, SUFFIX
from surefoot.robots import Robot

VERSION = 1
"""Part of every foreign policy's digest; raise it when how they are driven changes what they do."""


def is_foreign(name: str) -> bool:
    """Tell whether a name is that of a readable ONNX file that is no policy of surefoot's."""
    path = Path(name)
    if path.suffix != SUFFIX or not path.is_file():
        return False
    metadata = read_metadata(path)
    return metadata is not None and METADATA_KEY not in metadata


def load_foreign(name: str, robot: Robot) -> ControllerAgent:
    """Make an agent of a foreign policy that says how it is driven, by its metadata or a `deploy.yaml`.

    Args:
        name: the ONNX file.
        robot: the robot that it is to drive.

    Raises:
        UserError: something about it is missing or wrong; the message names file and key.
    """
    network = Network(name)
    interface = read_interface(network, robot)

    def make(robot: Robot, num_robots: int) -> ForeignPolicy:
        return ForeignPolicy(robot, num_robots, network, interface)

    return ControllerAgent(name, make, hashlib.sha256(f"foreign {VERSION}".encode()).hexdigest(), robot)
