"""Averaged actor: the moving average of the learning weights, which is validated and kept."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

AVERAGED_SHARE = 0.2
"""The average reaches over at most this share of the steps so far, so that the first ones are soon forgotten."""


class AveragedActor:
    """Exponential moving average of an actor's weights, whose time constant is counted in policy steps.

    Args:
        actor: the network that learns.
        num_steps: time constant [policy steps]; 0 for the newest weights.
    """

    def __init__(self, actor: nn.Module, num_steps: float):
        self._actor = actor
        self._num_steps = num_steps
        self._updated_at = 0
        self._newest_share = 1.0
        self._model = AveragedModel(actor, avg_fn=self._mix)

    @property
    def averaged(self) -> nn.Module:
        """The network with the averaged weights; those of the last `restart`, if nothing is averaged."""
        return self._model.module

    @property
    def kept(self) -> nn.Module:
        """The network that is validated and kept: the averaged one, or the newest if nothing is averaged."""
        return self.averaged if self._num_steps else self._actor

    def restart(self, at: int) -> None:
        """Begin with the actor's weights as they are, after `at` policy steps."""
        self.averaged.load_state_dict(self._actor.state_dict())
        self._updated_at = at

    def update(self, at: int) -> None:
        """Add the actor's weights after `at` policy steps."""
        over = min(self._num_steps, AVERAGED_SHARE * at)
        self._newest_share = 1.0 - float(np.exp(-(at - self._updated_at) / max(over, 1.0)))
        self._model.n_averaged.fill_(1)  # the first weights would be copied otherwise, instead of averaged
        self._model.update_parameters(self._actor)
        self._updated_at = at

    def state(self) -> dict[str, torch.Tensor]:
        """Return the averaged weights, for a checkpoint."""
        return self.averaged.state_dict()

    def restore(self, weights: Mapping[str, Any], at: int) -> None:
        """Take averaged weights from a checkpoint that was written after `at` policy steps."""
        self.averaged.load_state_dict(weights)
        self._updated_at = at

    def _mix(self, averaged: torch.Tensor, newest: torch.Tensor, _: torch.Tensor | int) -> torch.Tensor:
        return averaged + self._newest_share * (newest - averaged)
