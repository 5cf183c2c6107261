"""Dask: tasks on the workers of a Dask cluster, which may be started on this machine."""

from __future__ import annotations

import logging
from concurrent.futures import CancelledError, Future
from typing import Any

import dask
from distributed import Client, KilledWorker, LocalCluster
from distributed.comm.core import CommClosedError

from surefoot.cores import num_cores
from surefoot.errors import UserError
from surefoot.executors.address import check_reachable
from surefoot.executors.envelope import Answer, make_opener
from surefoot.executors.executor import WorkerLostError

UNLIMITED = 10**6
_QUIET = {"distributed.logging.distributed": "critical"}


class DaskCluster:
    """A Dask cluster; see `Backend`.

    Args:
        address: HOST:PORT of its scheduler; without it, one is begun on this machine.
        workers: tasks at the same time at most; 0 for as many as the cluster has threads for.
    """

    def __init__(self, address: str = "", workers: int = 0):
        self.at_once = workers or UNLIMITED
        self._open = make_opener()
        dask.config.set(_QUIET)
        self._cluster: LocalCluster | None = None
        if address:
            check_reachable("Dask", address)
        else:
            count = workers or num_cores()
            self._cluster = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
        try:
            self._client = Client(self._cluster or address, timeout=10)
        except (OSError, TimeoutError, ValueError) as error:
            raise UserError(f"there is no Dask cluster at {address}: {error}") from error
        self._executor = self._client.get_executor(pure=False)

    def submit(self, sealed: bytes) -> Future[Any]:
        """Begin a sealed task."""
        future: Future[Any] = self._executor.submit(self._open, sealed)
        return future

    def collect(self, future: Future[Any]) -> Answer:
        """Return a task's answer."""
        try:
            answer: Answer = future.result()
        except KilledWorker as error:
            raise WorkerLostError("KilledWorker") from error
        except (CancelledError, CommClosedError) as error:
            raise UserError(f"the Dask cluster's scheduler is gone ({type(error).__name__})") from error
        return answer

    def close(self) -> None:
        """Stop what has not begun, and leave the cluster; one of our own ends."""
        self._executor.shutdown(wait=False)
        self._client.close()
        if self._cluster:
            self._cluster.close()
