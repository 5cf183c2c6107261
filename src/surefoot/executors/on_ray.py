"""Ray: tasks on the workers of a Ray cluster, which may be started on this machine."""

from __future__ import annotations

import logging
import os
from concurrent.futures import Future
from typing import Any

os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is sent anywhere

import ray
from ray import exceptions

from surefoot.cores import num_cores
from surefoot.errors import UserError
from surefoot.executors.address import check_reachable
from surefoot.executors.envelope import Answer, make_opener
from surefoot.executors.executor import WorkerLostError
from surefoot.executors.worker import CORES

LOST = (
    exceptions.WorkerCrashedError,
    exceptions.NodeDiedError,
    exceptions.LocalRayletDiedError,
    exceptions.OutOfMemoryError,
    exceptions.ObjectLostError,
    exceptions.ActorDiedError,
)
FULL = (exceptions.ObjectStoreFullError, exceptions.OutOfDiskError)
UNLIMITED = 10**6


def connect(address: str, workers: int) -> None:
    """Connect to a Ray cluster, or begin one on this machine.

    Args:
        address: HOST:PORT of the cluster's head; one of this process's own without it.
        workers: of a cluster that is begun; 0 for one per core.

    Raises:
        UserError: no cluster answers at the address, or it refuses the connection.
    """
    if address:
        check_reachable("Ray", address)
    mine: dict[str, Any] = {"num_cpus": workers or num_cores(), "include_dashboard": False}
    here = {} if address else {**mine, "_node_ip_address": "127.0.0.1"}
    try:
        ray.init(address or "local", log_to_driver=False, logging_level=logging.ERROR, **here)
    except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
        raise UserError(f"cannot use the Ray cluster at {address or 'this machine'}: {error}") from error


class RayCluster:
    """A Ray cluster; see `Backend`.

    Args:
        address: HOST:PORT of its head; without it, one is begun on this machine.
        workers: tasks at the same time at most; 0 for as many as the cluster has cores for.
    """

    def __init__(self, address: str = "", workers: int = 0):
        connect(address, workers)
        self.at_once = workers or UNLIMITED
        # Tasks of workers that die are begun again by the executor, which counts how often.
        self._task = ray.remote(num_cpus=CORES, max_retries=0)(make_opener())
        self._refs: dict[Future[Any], ray.ObjectRef[Answer]] = {}

    def submit(self, sealed: bytes) -> Future[Any]:
        """Begin a sealed task."""
        try:
            ref = self._task.remote(sealed)
        except FULL as error:
            raise full_store(error) from error
        future: Future[Any] = ref.future()
        self._refs[future] = ref
        return future

    def collect(self, future: Future[Any]) -> Answer:
        """Return a task's answer."""
        del self._refs[future]
        try:
            answer: Answer = future.result()
        except LOST as error:
            raise WorkerLostError(type(error).__name__) from error
        except FULL as error:
            raise full_store(error) from error
        return answer

    def close(self) -> None:
        """Stop what still runs, and leave the cluster."""
        for ref in self._refs.values():
            ray.cancel(ref, force=True)
        ray.shutdown()


def full_store(error: Exception) -> UserError:
    """Return what a user is told of a full object store."""
    return UserError(f"the Ray cluster's object store is full ({type(error).__name__}); free some of it, or enlarge it")
