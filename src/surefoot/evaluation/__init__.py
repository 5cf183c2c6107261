"""Evaluation: trials, the one definition of success, and the search for thresholds."""

from surefoot.evaluation.evaluate import find_thresholds, push_lines, run_scenarios

__all__ = ["find_thresholds", "push_lines", "run_scenarios"]
