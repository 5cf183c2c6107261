"""Work: the options of all commands whose tasks others can do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from surefoot.executors import Executor


@dataclass(frozen=True, kw_only=True)
class Work:
    """Who does a command's tasks."""

    executor: str = "local"
    """Who does the work: local (this process), processes (of this machine), ray or dask (a cluster), or slurm (jobs)
    (surefoot docs scaling)."""
    address: str = ""
    """HOST:PORT of the Ray or Dask cluster; without it, one is begun on this machine. For slurm, "local" runs the jobs
    on this machine."""
    workers: int | None = None
    """Tasks that are done at the same time; one per core of the machine, or all that the cluster takes, without it."""

    def opened(self) -> Executor:
        """The executor, to be used as a context manager.

        Raises:
            UserError: the executor is unknown, its package is missing, or no cluster answers.
        """
        from surefoot.executors import open_executor

        return open_executor(self.executor, self.address, self.workers)
