"""Agents: who moves the robots, learned policies and classical controllers."""

from surefoot.agents.load import load_agent, load_policy, shipped_policies

__all__ = ["load_agent", "load_policy", "shipped_policies"]
