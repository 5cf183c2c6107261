"""Executors: the ways to run a list of tasks, in this process, in processes of this machine, or on a cluster.

A task is a call of a function of ours with arguments that can be pickled, and takes seconds to hours: the lines of a
scenario that share their trials, a training run, a candidate. Results come as they are done, to the one process that
asked, which alone writes files of results.
"""

from __future__ import annotations

from surefoot.executors.executor import Executor
from surefoot.executors.kinds import EXECUTORS, open_executor

__all__ = ["EXECUTORS", "Executor", "open_executor"]
