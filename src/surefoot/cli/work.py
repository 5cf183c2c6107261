"""Work: the options of all commands that can distribute their tasks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from surefoot.executors import Executor


@dataclass(frozen=True, kw_only=True)
class Work:
    """Options for the workers that do a command's tasks."""

    executor: str = "local"
    """Executor of the work: local (this process), processes (on this machine), ray or dask (a cluster), or slurm
    (jobs); see surefoot docs scaling."""
    address: str = ""
    """HOST:PORT of the Ray or Dask cluster; without it, a cluster is started on this machine. For slurm, "local"
    runs the jobs on this machine."""
    workers: int | None = None
    """Number of tasks at the same time. The default is one per core of the machine, or as many as the cluster takes."""

    def opened(self) -> Executor:
        """The executor, to be used as a context manager.

        Raises:
            UserError: the executor is unknown, its package is missing, or no cluster answers.
        """
        from surefoot.executors import open_executor

        return open_executor(self.executor, self.address, self.workers)
