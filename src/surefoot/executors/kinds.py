"""Kinds: the executors by the names under which commands know them."""

from __future__ import annotations

from surefoot.errors import UserError
from surefoot.executors.executor import Backend, Executor

EXECUTORS = ("local", "processes", "ray", "dask", "slurm")
_WITHOUT_ADDRESS = ("local", "processes")


def open_executor(kind: str = "local", address: str = "", workers: int | None = None) -> Executor:
    """Return an executor, to be used as a context manager.

    Args:
        kind: "local" (this process), "processes" (of this machine), "ray", "dask" or "slurm".
        address: HOST:PORT of a Ray or Dask cluster; without it, one is begun on this machine. For Slurm, "local" runs
            its jobs on this machine, to try it out.
        workers: processes, or tasks at the same time; as many as there are cores without it.

    Raises:
        UserError: the executor is unknown, its package is missing, or no cluster answers at the address.
    """
    if kind not in EXECUTORS:
        raise UserError(f"unknown executor '{kind}'; valid: {', '.join(EXECUTORS)}")
    if address and kind in _WITHOUT_ADDRESS:
        raise UserError(f"the executor {kind} has no address, not '{address}'")
    if kind == "local":
        if workers:
            raise UserError(f"the executor local has no workers, not {workers}; --executor processes has")
        return Executor()
    return Executor(_backend(kind, address, workers or 0))


def _backend(kind: str, address: str, workers: int) -> Backend:
    """Return the backend of a name; what it stands on is loaded here."""
    if kind == "processes":
        from surefoot.executors.processes import Processes

        return Processes(workers)
    if kind == "ray":
        from surefoot.executors.on_ray import RayCluster

        return RayCluster(address, workers)
    if kind == "dask":
        from surefoot.executors.on_dask import DaskCluster

        return DaskCluster(address, workers)
    from surefoot.executors.on_slurm import SlurmCluster

    return SlurmCluster(address, workers)
