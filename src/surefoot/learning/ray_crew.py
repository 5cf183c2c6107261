"""Ray crew: the workers of a training run as actors of a Ray cluster, which are restarted if they die."""

from __future__ import annotations

from typing import Any

import ray

from surefoot.errors import UserError
from surefoot.executors.on_ray import FULL, LOST, connect, full_store
from surefoot.executors.worker import CORES
from surefoot.learning.config import TrainConfig
from surefoot.learning.rollouts import Order, Rollout, RolloutWorker


class RayCrew:
    """Workers on a Ray cluster; see `Crew`. A context manager.

    Args:
        address: HOST:PORT of the cluster's head; without it, one is begun on this machine.
        num_workers: how many.
    """

    def __init__(self, address: str, num_workers: int):
        connect(address, num_workers)
        self.num_workers = num_workers
        self._workers: list[Any] = []
        self._collecting: list[ray.ObjectRef[Rollout]] = []

    def __enter__(self) -> RayCrew:
        return self

    def __exit__(self, *_: object) -> None:
        ray.shutdown()

    def begin(self, config: TrainConfig) -> None:
        """Give every worker its robots; one that dies begins with new ones."""
        for worker in self._workers:
            ray.kill(worker)
        actor: Any = ray.remote(num_cpus=CORES, max_restarts=-1, max_task_retries=-1)(RolloutWorker)
        places = range(self.num_workers)
        self._workers = [actor.remote(config, place, self.num_workers, CORES) for place in places]
        self._collecting = []

    def order(self, order: Order) -> None:
        """Let every worker begin to collect; the policy goes into the object store once."""
        try:
            told = ray.put(order)
            self._collecting = [worker.collect.remote(told) for worker in self._workers]
        except FULL as error:
            raise full_store(error) from error

    def collected(self) -> list[Rollout]:
        """Wait for the rollouts of all workers.

        Raises:
            UserError: a worker cannot be had any more.
        """
        try:
            return list(ray.get(self._collecting))
        except FULL as error:
            raise full_store(error) from error
        except LOST as error:
            raise UserError(f"a worker of the training is lost for good ({type(error).__name__})") from error
