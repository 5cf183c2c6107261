"""Agents: who moves the robots, learned policies and classical controllers."""
