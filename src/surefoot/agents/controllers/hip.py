"""Hip: where the ankles' means end, the upper body is thrown after the fall and so pushes the CoM back."""

from __future__ import annotations

import numpy as np

from surefoot.agents.controllers.ankle import EDGE, Ankle
from surefoot.agents.controllers.controller import State
from surefoot.agents.controllers.inverse_dynamics import ATTITUDE_GAINS, Motion, clip_to_support

BEFORE = 0.03
"""Distance from the border of the support at which the throw begins [m]: it has to bring the capture point back in, not
to hold it outside."""
GAIN = 3000.0
"""Angular acceleration per metre that the capture point is beyond that [rad/s^2/m]."""
LARGEST = np.array([30.0, 80.0])
"""At most, about x and y [rad/s^2]."""
FARTHEST = np.array([0.25, 0.35])
"""Roll and pitch at which the throw ends [rad]."""
RETURN_GAINS = 8.0, 5.0
"""Spring and damper of the way back [1/s^2, 1/s]: slow, for it pushes the CoM outward again."""
UPPER_BODY = 0.02
"""By so much its turning moves the capture point: I / (m z w), with I of root and torso about 9 kg m^2 [m s]."""
TORSO_SHARE = 1.0


class Hip(Ankle):
    """The ankle's law, and angular momentum about the hips: B. Stephens 2007, J. Pratt et al. 2006 (flywheel).

    At the border of the support the pressure centre can do no more. There root and torso are accelerated towards the
    fall, as hard as the hips can: the ground's force then points further back than the pressure centre alone would let
    it. Once the capture point is inside, they come back slowly.
    """

    def motion(self, state: State, ids: np.ndarray) -> Motion:
        """The motion of a robot that stands, and a throw of its upper body where that is not enough."""
        motion = super().motion(state, ids)
        speed = state.root_angular_velocity[:, :2]
        throw = GAIN * self._beyond(state, state.capture_point)
        throw = np.clip(throw, -LARGEST, LARGEST)
        throw = np.where(state.root_attitude * np.sign(throw) > FARTHEST, 0.0, throw)
        # To stop the upper body moves the capture point out again; until there is room for that it goes on turning.
        stopped = state.capture_point + UPPER_BODY * np.column_stack([speed[:, 1], -speed[:, 0]])
        coasting = (self._beyond(state, stopped) != 0.0) & (np.abs(state.root_attitude) < FARTHEST)
        spring, damper = RETURN_GAINS
        back = np.where(coasting, 0.0, -spring * state.root_attitude - damper * speed)
        # In place of the stiff posture.
        motion.attitude = state.root_attitude
        motion.turn = np.where(throw != 0.0, throw, back) + ATTITUDE_GAINS[1] * speed
        motion.torso_turn = TORSO_SHARE * np.maximum(throw[:, 1], 0.0)
        return motion

    def _beyond(self, state: State, point: np.ndarray) -> np.ndarray:
        """How far a point (n, 2) is beyond the support, as a turn towards it: (n, 2) [m]."""
        half, soles = self.robot.sole_half_size - EDGE - BEFORE, state.sole_position[..., :2]
        beyond = point - clip_to_support(point, soles, np.ones((len(point), 2), bool), half)
        # Falling forward is a positive pitch, to the left a negative roll.
        return np.column_stack([-beyond[:, 1], beyond[:, 0]])
