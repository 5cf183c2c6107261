"""Interface: the inputs and outputs of a foreign network, with all that is needed to drive it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surefoot.errors import UserError


@dataclass(frozen=True)
class Term:
    """One observation of a foreign network.

    The network is given clip(value) * scale, for several control steps of the past if it has a history.

    Attributes:
        name: what is observed, one of `surefoot.agents.foreign.observations.OBSERVATIONS`.
        scale: one factor, or one for each of its numbers.
        clip: lowest and highest value, before it is scaled.
        history: control steps that are given, the oldest first; until there are so many, the first one is repeated.
        period: of the gait, for observations of its phase [s].
    """

    name: str
    scale: float | tuple[float, ...] = 1.0
    clip: tuple[float, float] = (-np.inf, np.inf)
    history: int = 1
    period: float | None = None


@dataclass(frozen=True, eq=False)
class Interface:
    """The inputs and outputs of a foreign network.

    The joint targets are ``default_pose + action_scale * action``. Arrays over joints are in the network's own order.

    Attributes:
        source: the file, by which errors name it.
        joints: names of the joints in the network's order.
        stiffness, damping: of the joint impedance (num_joints,) [Nm/rad, Nms/rad].
        default_pose: joint angles that an action of zero means (num_joints,) [rad].
        action_scale: joint angle per unit of action, one number or (num_joints,) [rad].
        terms: the observations in the order in which the network takes them.
        rate_hz: control steps per second.
        action_clip: lowest and highest action.
        files: other files than the network that it was read from.

    Raises:
        UserError: an array has not as many numbers as there are joints.
    """

    source: str
    joints: tuple[str, ...]
    stiffness: np.ndarray
    damping: np.ndarray
    default_pose: np.ndarray
    action_scale: np.ndarray | float
    terms: tuple[Term, ...]
    rate_hz: int = 50
    action_clip: tuple[float, float] = (-np.inf, np.inf)
    files: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        """Check the lengths."""
        for key in ("stiffness", "damping", "default_pose", "action_scale"):
            value = np.asarray(getattr(self, key), float)
            is_one_for_all = key == "action_scale" and value.size == 1
            if not is_one_for_all and value.shape != (len(self.joints),):
                raise UserError(
                    f"{self.source}: {key} must be {len(self.joints)} numbers, one for each joint, not {value.size}"
                )
            if not np.isfinite(value).all():
                raise UserError(f"{self.source}: {key} must be finite numbers")
            object.__setattr__(self, key, value.reshape(-1) if is_one_for_all else value)
