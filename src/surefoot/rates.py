"""Rates: 25 Hz for the policy, 500 Hz for the joints, and the ticks of a policy step."""

from __future__ import annotations

POLICY_HZ = 25

CONTROL_HZ = 500

TICKS_PER_STEP = CONTROL_HZ // POLICY_HZ

POLICY_DT = 1.0 / POLICY_HZ

CONTROL_DT = 1.0 / CONTROL_HZ
