"""Wieber 2006b: the reference trajectory is chosen anew, on line, so that it can be followed from where the CoM is."""

from __future__ import annotations

from surefoot.controllers.ankle import Ankle


class ReferenceAdaptation(Ankle):
    """x"""
