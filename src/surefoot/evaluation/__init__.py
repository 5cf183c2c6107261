"""Evaluation: trials, the one definition of success, and the search for thresholds."""
