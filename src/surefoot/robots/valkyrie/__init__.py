"""Valkyrie: what cannot be read from ``valkyrie.xml``.

Everything else (masses, joint ranges, gains, torque and speed limits, sole size) stands in the MJCF file and is
read from the compiled model, so that no figure is written twice.
"""

# Joint angles [rad] by joint group; groups not named stay at 0.
# "straight" is the paper's nominal pose (CoM at 1.1 m). "bent" leaves the knees room to push and to step, and puts
# the CoM over the middle of the soles once the joints have sagged under the load.
POSES: dict[str, dict[str, float]] = {
    "straight": {},
    "bent": {"hip_pitch": -0.18, "knee_pitch": 0.5, "ankle_pitch": -0.32},
}

ROOT = "pelvis"
"""The floating body."""

# The paper's words for where a push lands -> the body of the MJCF file.
PUSHABLE_BODIES: dict[str, str] = {
    "pelvis": "pelvis",
    "torso": "torso",
    "left_thigh": "left_thigh",
    "right_thigh": "right_thigh",
    "left_shank": "left_shank",
    "right_shank": "right_shank",
}
