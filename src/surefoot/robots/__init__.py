"""Robots: a machine is a TOML description beside an MJCF file, and `Robot` is all that the rest knows of it."""

from surefoot.robots.load import load_robot, shipped_robots
from surefoot.robots.robot import Robot

__all__ = ["Robot", "load_robot", "shipped_robots"]
