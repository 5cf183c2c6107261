"""Slurm: tasks as jobs of submitit, in a folder that all machines must share."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import submitit
from submitit.core.utils import FailedSubmissionError, UncompletedJobError

from surefoot.errors import UserError
from surefoot.executors.envelope import Answer, make_opener
from surefoot.executors.executor import WorkerLostError
from surefoot.executors.worker import CORES

FOLDER = Path("runs/slurm")
"""Of what submitit writes: jobs, answers and logs."""
MINUTES = 24 * 60
"""That a job may take, unless SBATCH_TIMELIMIT says something else."""
LOOK_S = 1.0
"""Time from one look at the jobs to the next."""
UNLIMITED = 1000
_CLUSTERS = ("", "slurm", "local")


class SlurmCluster:
    """A Slurm cluster, from one of its machines; see `Backend`.

    Args:
        address: "local" runs the jobs on this machine.
        workers: jobs at the same time at most; 0 for as many as Slurm is usually given at once.

    Raises:
        UserError: this is no machine of a Slurm cluster.
    """

    def __init__(self, address: str = "", workers: int = 0):
        if address not in _CLUSTERS:
            raise UserError(f"the address of the executor slurm is nothing or 'local', not '{address}'")
        self.at_once = workers or UNLIMITED
        self._open = make_opener()
        self._jobs: dict[Future[Any], submitit.Job[Any]] = {}
        self._closed = threading.Event()
        try:
            self._executor = submitit.AutoExecutor(FOLDER, cluster=address or "slurm")
        except RuntimeError as error:
            raise UserError(f"this machine cannot give Slurm jobs: {error}") from error
        self._executor.update_parameters(name="surefoot", cpus_per_task=CORES, timeout_min=MINUTES)
        threading.Thread(target=self._look, daemon=True).start()

    def submit(self, sealed: bytes) -> Future[Any]:
        """Give Slurm a job."""
        future: Future[Any] = Future()
        try:
            self._jobs[future] = self._executor.submit(self._open, sealed)
        except FailedSubmissionError as error:
            raise UserError(f"Slurm does not take a job: {error}") from error
        return future

    def collect(self, future: Future[Any]) -> Answer:
        """Return a job's answer."""
        job = self._jobs.pop(future)
        try:
            answer: Answer = job.result()
        except UncompletedJobError as error:
            raise WorkerLostError(f"job {job.job_id} has ended without an answer; see {job.paths.stderr}") from error
        return answer

    def close(self) -> None:
        """Cancel the jobs that are left."""
        self._closed.set()
        for job in self._jobs.values():
            job.cancel(check=False)

    def _look(self) -> None:
        """Tell the futures of jobs that have ended."""
        while not self._closed.wait(LOOK_S):
            for future, job in list(self._jobs.items()):
                if not future.done() and job.done():
                    future.set_result(None)
