"""Robots: descriptions of machines, each a TOML file beside an MJCF file, and `Robot`, the only access to them."""

from surefoot.robots.load import load_robot, shipped_robots
from surefoot.robots.robot import Robot

__all__ = ["Robot", "load_robot", "shipped_robots"]
