"""Agents by name: shipped policies, policy files, run folders, controllers."""

from __future__ import annotations

import importlib.resources
from pathlib import Path

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import SUFFIX
from surefoot.errors import UserError

BEST = {"best": "ddpg"}
"""The shipped policy that rejects most has this name too."""


def shipped_policies() -> tuple[str, ...]:
    """Names of the policies that come with the package."""
    folder = importlib.resources.files("surefoot.agents") / "shipped"
    if not folder.is_dir():
        return ()
    return tuple(sorted(file.name.removesuffix(SUFFIX) for file in folder.iterdir() if file.name.endswith(SUFFIX)))


def load_policy(name: str | Path) -> NetworkAgent:
    """Read a policy that comes with the package, a policy file, or the best policy of a run folder.

    "best" is the shipped policy that rejects most.

    Raises:
        UserError: there is no such policy, or it is not one that this version can run.
    """
    name = BEST.get(str(name), name)
    if str(name) in shipped_policies():
        file = importlib.resources.files("surefoot.agents") / "shipped" / f"{name}{SUFFIX}"
        return NetworkAgent(file.read_bytes(), str(name))
    path = Path(name)
    path_of_file = path / f"best{SUFFIX}" if path.is_dir() else path
    try:
        data = path_of_file.read_bytes()
    except OSError as error:
        shipped = f"; shipped policies: {', '.join(shipped_policies())}" if shipped_policies() else ""
        raise UserError(f"cannot read policy {path_of_file}: {error.strerror or error}{shipped}") from error
    return NetworkAgent(data, name=path.stem, source=str(path_of_file))
