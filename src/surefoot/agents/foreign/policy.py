"""ForeignPolicy: a network that was trained elsewhere, as a controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from surefoot.agents.foreign.interface import Interface, Term
from surefoot.agents.foreign.network import Network
from surefoot.agents.foreign.observations import OBSERVATIONS, Moment, Observation
from surefoot.errors import UserError
from surefoot.robots import Robot
from surefoot.task.agent import Command
from surefoot.task.state import State


class ForeignPolicy:
    """Drives robots by a foreign network, with the gains, the rate and the observations that it was learned with.

    Joints of the robot that the network does not know hold the robot's default pose by the robot's own gains. Targets
    go out at once and are held; they may lie beyond the joint ranges.

    Args:
        robot: the robot that it drives.
        num_robots: how many of it.
        network: what answers.
        interface: what it takes and answers.

    Attributes:
        observations: name of an observation -> how it is made; a class of yours may know more.
        command: forward, left and turning speed that each robot is asked for (num_robots, 3) [m/s, m/s, rad/s].
        observed: what the network was given of each observation in the last control step (n, history * size).

    Raises:
        UserError: the network is for other joints, takes an observation that is not known, or has other sizes.
    """

    observations: ClassVar[Mapping[str, Observation]] = OBSERVATIONS
    path = "hold"
    clips_targets = False

    def __init__(self, robot: Robot, num_robots: int, network: Network, interface: Interface):
        self.network, self.interface = network, interface
        self.rate_hz = interface.rate_hz
        self.files = (*network.files, *interface.files)
        self.command = np.zeros((num_robots, 3))
        self.observed: dict[str, np.ndarray] = {}
        self._joints = _places(robot, interface)
        self.stiffness, self.damping, self.pose = robot.stiffness.copy(), robot.damping.copy(), robot.pose().copy()
        self.stiffness[self._joints], self.damping[self._joints] = interface.stiffness, interface.damping
        self.pose[self._joints] = interface.default_pose
        sizes = [self._size(term) for term in interface.terms]
        _check_sizes(interface, network, sizes)
        self._action = np.zeros((num_robots, len(interface.joints)))
        self._history = [
            np.zeros((num_robots, term.history, size)) for term, size in zip(interface.terms, sizes, strict=True)
        ]
        self._is_new = np.ones(num_robots, bool)

    def reset(self, ids: np.ndarray) -> None:
        """Forget the last actions and the histories of robots `ids` (n,)."""
        self._action[ids] = 0.0
        self._is_new[ids] = True

    def __call__(self, state: State, ids: np.ndarray) -> Command:
        """Ask the network for one control step of robots `ids` (n,)."""
        action = self.network(self.observe(state, ids))
        action = np.clip(action, *self.interface.action_clip)
        self._action[ids] = action
        target = np.tile(self.pose, (len(ids), 1))
        target[:, self._joints] += self.interface.action_scale * action
        return Command(target)

    def observe(self, state: State, ids: np.ndarray) -> np.ndarray:
        """Return the network's inputs for robots `ids` (n,), and remember them: (n, num_inputs) float64."""
        now = self._moment(state, ids)
        new = self._is_new[ids]
        self._is_new[ids] = False
        for term, history in zip(self.interface.terms, self._history, strict=True):
            value = self.observations[term.name].observe(now._replace(period=term.period or np.nan))
            value = np.clip(value, *term.clip) * np.asarray(term.scale)
            history[ids, :-1] = history[ids, 1:]
            history[ids, -1] = value
            history[ids[new]] = value[new, None]
            self.observed[term.name] = history[ids].reshape(len(ids), -1)
        return np.concatenate([self.observed[term.name] for term in self.interface.terms], axis=1)

    def _moment(self, state: State, ids: np.ndarray) -> Moment:
        return Moment(
            state,
            state.joint_position[:, self._joints],
            state.joint_velocity[:, self._joints],
            self.interface.default_pose,
            self._action[ids],
            self.command[ids],
            np.nan,
        )

    def _size(self, term: Term) -> int:
        """How many numbers a term has at one control step."""
        source = self.interface.source
        if term.name not in self.observations:
            known = ", ".join(self.observations)
            raise UserError(f"{source}: observation_names: unknown observation '{term.name}'; known: {known}")
        size = self.observations[term.name].size
        size = len(self.interface.joints) if size is None else size
        if np.size(term.scale) not in (1, size):
            raise UserError(
                f"{source}: the scale of {term.name} must be 1 or {size} numbers, not {np.size(term.scale)}"
            )
        return size


def _places(robot: Robot, interface: Interface) -> np.ndarray:
    """Where the network's joints are among the robot's (len(joints),)."""
    unknown = [joint for joint in interface.joints if joint not in robot.joint_names]
    if unknown:
        share = f"{len(unknown)} of its {len(interface.joints)} joints, '{unknown[0]}' the first"
        raise UserError(
            f"{interface.source}: joint_names: {robot.name} does not control {share}; "
            f"its controlled joints: {', '.join(robot.joint_names)}"
        )
    if len(set(interface.joints)) < len(interface.joints):
        raise UserError(f"{interface.source}: joint_names: a joint is named twice")
    return np.array([robot.joint_names.index(joint) for joint in interface.joints])


def _check_sizes(interface: Interface, network: Network, sizes: list[int]) -> None:
    parts = [
        (f"{term.name} {size}" + (f" x {term.history}" if term.history > 1 else ""), term.history * size)
        for term, size in zip(interface.terms, sizes, strict=True)
    ]
    total = sum(size for _, size in parts)
    if total != network.num_inputs:
        words = ", ".join(part for part, _ in parts)
        raise UserError(
            f"{interface.source}: the network takes {network.num_inputs} inputs, but observation_names add up to "
            f"{total}: {words}"
        )
    if network.num_outputs != len(interface.joints):
        raise UserError(
            f"{interface.source}: the network answers {network.num_outputs} numbers, but joint_names are "
            f"{len(interface.joints)}"
        )
