"""Clip: the last seconds of the watched robot as a film, drawn without the browser."""

from __future__ import annotations

import dataclasses
import tempfile
from collections import deque
from pathlib import Path

import numpy as np

from surefoot.disturbance import Push
from surefoot.policy import Policy
from surefoot.robot import Robot
from surefoot.scene import Moment
from surefoot.simulation import POLICY_HZ, TICKS_PER_STEP
from surefoot.trials import Outcome, Trial
from surefoot.video import Recording, save_video
from surefoot.viewer.session import Session
from surefoot.viewer.verdict import State

SECONDS = 8.0
_FPS = 50
