"""Rates: 25 Hz for the policy, 500 Hz for the joints, and the ticks of a policy step."""

from __future__ import annotations

POLICY_HZ = 25
"""Policy steps per second."""

CONTROL_HZ = 500
"""Ticks of the joint control per second."""

TICKS_PER_STEP = CONTROL_HZ // POLICY_HZ
"""Ticks of a policy step."""

POLICY_DT = 1.0 / POLICY_HZ
"""Length of a policy step [s]."""

CONTROL_DT = 1.0 / CONTROL_HZ
"""Length of a tick [s]."""
