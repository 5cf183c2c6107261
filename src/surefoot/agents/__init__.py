"""Agents: the learned policies and classical controllers that move the robots."""

from surefoot.agents.load import load_agent, load_policy, shipped_policies

__all__ = ["load_agent", "load_policy", "shipped_policies"]
