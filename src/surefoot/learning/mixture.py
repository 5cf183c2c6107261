"""Mixture: a network that tells what its sensors hide and which of two teachers fits, with both teachers inside.

A trunk takes the noisy observation with its memory. It gives an estimate of the clear observation, and a gate between
the two teachers' networks, which act on that estimate. So the student answers a push as the teacher does that fits, to
the last digit while the observation is clear, where a network that imitates both only comes near.

As a policy file the mixture is what every policy is, a chain of linear layers and tanh: tanh(e x) / e hands a number on
for a small e, and (tanh(z + e x) - tanh(z - e x)) / 2e is x times sech(z) squared, which is a gate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from surefoot.learning.networks import linear_modules, mlp

Layers = list[tuple[np.ndarray, np.ndarray]]
"""(weight (out, in), bias (out,)) of every linear layer of a network with tanh between them."""

CLOSED = 4.0
"""A gate's z runs from 0, where it is open, to twice this, where it is closed: sech(8) squared is 4e-7."""
MIDDLE = 1.045
"""The gate is half open where its tanh has this argument: sech(4 - 4 tanh(1.045)) squared is 0.5."""
_PASS, _GATE = 1e-3, 1e-2
"""Small numbers by which values are handed on, and gated."""


class MixtureNetwork(nn.Module):
    """The trunk, and behind it two frozen networks.

    Args:
        num_inputs: observation and memory, normalised.
        num_observed: components of the observation, which are the first inputs.
        hidden: sizes of the trunk's two hidden layers.
        first, second: layers of the teachers' networks on the normalised observation, in the student's actions.
    """

    def __init__(self, num_inputs: int, num_observed: int, hidden: Sequence[int], first: Layers, second: Layers):
        super().__init__()
        self.trunk = mlp(num_inputs, hidden, num_observed + 2, nn.Tanh)
        self.num_observed = num_observed
        self._teachers = [[(_tensor(weight), _tensor(bias)) for weight, bias in each] for each in (first, second)]
        last = linear_modules(self.trunk)[-1]
        with torch.no_grad():  # the estimate begins as the observation, and its gate open enough to learn
            last.weight *= 0.01
            last.bias.zero_()
            last.bias[num_observed] = MIDDLE

    def parts(self, inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return actions (n, num_joints), the clear observation (n, num_observed), and the logit of the first teacher.

        The logit (n,) is above 0 where the first teacher has more than half of the say.
        """
        told = self.trunk(inputs)
        correction, noisy, choice = told[:, : self.num_observed], told[:, -2:-1], told[:, -1:]
        clear = inputs[:, : self.num_observed] + _gate(noisy) * correction
        first, second = (_through(layers, clear) for layers in self._teachers)
        return second + _gate(choice) * (first - second), clear, 4.0 * (choice[:, 0] - MIDDLE)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the actions."""
        return self.parts(inputs)[0]

    def layers(self) -> Layers:
        """Return the same as one chain of linear layers with tanh between them."""
        observed = self.num_observed
        (w1, b1), (w2, b2), (w3, b3) = ((_array(m.weight), _array(m.bias)) for m in linear_modules(self.trunk))
        first, second = ([(_array(w), _array(b)) for w, b in each] for each in self._teachers)
        eye, one = np.eye(observed), np.ones((1, 1))
        see = np.eye(observed, w1.shape[1])
        chain = [
            _stack((w1, b1), (_PASS * see, None)),
            _blocks((w2, b2), (eye, None)),
            # The correction, the two choices, and the observation.
            _blocks(
                _stack((_PASS * w3[:observed], _PASS * b3[:observed]), (w3[observed:], b3[observed:])), (eye, None)
            ),
        ]
        # Values now: correction * PASS, tanh(noisy), tanh(choice), observation * PASS.
        size = 2 * observed + 2
        correction = np.zeros((observed, size))
        correction[:, :observed] = eye / _PASS
        closing = np.zeros((observed, size))
        closing[:, observed] = -CLOSED
        passed = np.zeros((1 + observed, size))
        passed[0, observed + 1] = _PASS
        passed[1:, observed + 2 :] = eye
        chain.append(_stack(*_halves(closing, correction, np.zeros(observed)), (passed, None)))
        # Values now: both halves of the gated correction, tanh(choice) * PASS, observation * PASS.
        clear = np.hstack([_of_halves(observed), np.zeros((observed, 1)), eye / _PASS])
        choice = np.zeros((1, clear.shape[1]))
        choice[0, 2 * observed] = 1.0
        (f1, c1), (s1, d1) = first[0], second[0]
        chain.append(_stack((f1 @ clear, c1), (s1 @ clear, d1), (choice, None)))
        for ours, theirs in zip(first[1:-1], second[1:-1], strict=True):
            chain.append(_blocks(ours, theirs, (one, None)))
        return chain + _last(first[-1], second[-1])


def _last(first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray]) -> Layers:
    """The gate between both teachers' actions, and its output."""
    (f, c), (s, d) = first, second
    joints = len(c)
    difference = np.hstack([f, -s, np.zeros((joints, 1))])
    closing = np.zeros_like(difference)
    closing[:, -1] = -CLOSED / _PASS
    theirs = np.hstack([np.zeros_like(f), s, np.zeros((joints, 1))])
    gates = _stack(*_halves(closing, difference, c - d), (_PASS * theirs, _PASS * d))
    return [gates, (np.hstack([_of_halves(joints), np.eye(joints) / _PASS]), np.zeros(joints))]


def _halves(closing: np.ndarray, weight: np.ndarray, bias: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Both halves z + e x and z - e x of gates, where z = CLOSED + closing and x = weight and bias (n,)."""
    return [(closing + sign * _GATE * weight, CLOSED + sign * _GATE * bias) for sign in (1.0, -1.0)]


def _of_halves(number: int) -> np.ndarray:
    """What so many gates let through, of tanh of both their halves: (number, 2 number)."""
    eye = np.eye(number) / (2.0 * _GATE)
    return np.hstack([eye, -eye])


def _gate(argument: torch.Tensor) -> torch.Tensor:
    """sech(z) squared with z = CLOSED (1 - tanh(argument)): from 0, closed, to 1, open."""
    return torch.cosh(CLOSED * (1.0 - torch.tanh(argument))).square().reciprocal()


def _through(layers: Sequence[tuple[torch.Tensor, torch.Tensor]], values: torch.Tensor) -> torch.Tensor:
    for weight, bias in layers[:-1]:
        values = torch.tanh(nn.functional.linear(values, weight, bias))
    return nn.functional.linear(values, *layers[-1])


def _stack(*parts: tuple[np.ndarray, np.ndarray | None]) -> tuple[np.ndarray, np.ndarray]:
    """One layer of several on the same inputs; a bias of None is zero."""
    biases = [np.zeros(len(weight)) if bias is None else bias for weight, bias in parts]
    return np.vstack([weight for weight, _ in parts]), np.concatenate(biases)


def _blocks(*parts: tuple[np.ndarray, np.ndarray | None]) -> tuple[np.ndarray, np.ndarray]:
    """One layer of several, each on inputs of its own, one after the other."""
    weight = np.zeros((sum(len(w) for w, _ in parts), sum(w.shape[1] for w, _ in parts)))
    row = column = 0
    for w, _ in parts:
        weight[row : row + len(w), column : column + w.shape[1]] = w
        row, column = row + len(w), column + w.shape[1]
    return weight, np.concatenate([np.zeros(len(w)) if bias is None else bias for w, bias in parts])


def _tensor(array: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, np.float32))


def _array(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().numpy().astype(np.float64)
