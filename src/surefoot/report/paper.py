"""Paper: the numbers of Yang et al. 2018 to which ours are compared, and published figures of other studies."""

from __future__ import annotations

from typing import NamedTuple


class AlgorithmRow(NamedTuple):
    """A row of Table I [Ns]. It names no sides; its text calls only the 240 Ns a push with steps."""

    sagittal: float
    lateral: float


NO_STEP_BOUND = "no-step bound"
"""The tables' name for equation (6) of the paper: a point mass over fixed feet."""

TABLE_1 = {
    "trpo": AlgorithmRow(240.0, 78.0),
    "ddpg": AlgorithmRow(75.0, 160.0),
    "ppo": AlgorithmRow(192.0, 36.0),
    NO_STEP_BOUND: AlgorithmRow(53.0, 78.0),
}
"""Largest rejected impulses. Captioned "without taking steps", yet the text counts eight steps for the 240 Ns."""


def algorithm_row(name: str) -> AlgorithmRow | None:
    """The paper's row for a policy whose name begins with its algorithm, such as "trpo" or "trpo-0"."""
    return TABLE_1.get(name.split("-")[0].split(".")[0])


class StrategyRow(NamedTuple):
    """A column of Table II: which strategies a push brought out."""

    ankle: bool
    hip: bool
    foot_tilt: bool
    step: bool


TABLE_2 = {
    "sagittal_24": StrategyRow(True, True, False, False),
    "sagittal_72": StrategyRow(True, True, True, False),
    "sagittal_240": StrategyRow(True, True, True, True),
    "lateral_78": StrategyRow(True, True, True, False),
}
"""By the name of our scenario."""


class SegmentRow(NamedTuple):
    """A row of Table III: impulse [Ns], lever from the CoM [m], torque about it [Nm], steps."""

    impulse: float
    lever: float
    torque: float
    steps: int


TABLE_3 = {
    "torso_push": SegmentRow(120.0, 0.32, 320.0, 6),
    "thigh_push": SegmentRow(108.0, 0.50, 450.0, 4),
    "shank_push": SegmentRow(108.0, 0.70, 630.0, 6),
}
"""By the name of our scenario."""


class StudyColumn(NamedTuple):
    """A column of Table IV; None where the paper has no figure.

    Attributes:
        printed: the normalised impulse that the paper prints [Ns/kg]; `normalised` is what its own impulse and mass
            give.
    """

    study: str
    robot: str
    height: float | None
    com_height: float | None
    mass: float
    force: float | None
    interval: float | None
    impulse: float
    printed: float
    stepping: bool
    simulated: bool

    @property
    def normalised(self) -> float:
        """The study's impulse over its robot's mass [Ns/kg]."""
        return self.impulse / self.mass


TABLE_4 = {
    "A": StudyColumn("Wieber 2006a", "HRP-2", 1.539, None, 58.0, 1500.0, 0.025, 37.5, 0.60, False, True),
    "B": StudyColumn("Wieber 2006b", "biped model", 1.425, None, 40.0, 750.0, 0.025, 18.8, 0.52, False, True),
    "C": StudyColumn("Stephens 2010", "Sarcos Primus", 1.575, None, 92.0, None, None, 42.0, 0.52, True, False),
    "D": StudyColumn("Urata 2011", "HRP3L-JSK", None, 0.803, 53.0, 597.0, 0.05, 29.9, 0.60, True, False),
    "E": StudyColumn("Yang 2018, sagittal", "Valkyrie", 1.8, 1.1, 137.0, 600.0, 0.12, 72.0, 0.57, False, True),
    "F": StudyColumn("Yang 2018, sagittal", "Valkyrie", 1.8, 1.1, 137.0, 2000.0, 0.12, 240.0, 1.73, True, True),
    "G": StudyColumn("Yang 2018, lateral", "Valkyrie", 1.8, 1.1, 137.0, 650.0, 0.12, 78.0, 0.56, False, True),
}

REBUILT = {
    "A": "controllers/wieber2006a",
    "B": "controllers/wieber2006b",
    "C": "controllers/stephens2010",
    "D": "controllers/urata2011",
}
"""Columns of Table IV whose idea is rebuilt here, and the controller's name."""

PEAK_GROUPS = ("torso_pitch", "hip_pitch", "hip_roll", "knee_pitch", "ankle_pitch", "ankle_roll")
"""Columns of Table V."""


class PeakRow(NamedTuple):
    """A row of Table V by joint group, in the order of `PEAK_GROUPS`: torques [Nm] and speeds [rad/s]."""

    torque: tuple[float, ...]
    speed: tuple[float, ...]


TABLE_5_LIMITS = PeakRow((150.0, 350.0, 350.0, 350.0, 205.0, 205.0), (9.0, 6.11, 6.11, 11.0, 11.0, 11.0))
TABLE_5 = {
    "standing": PeakRow((68.4, 39.5, 57.1, 122.0, 44.9, 46.2), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    "drop_055": PeakRow((150.0, 221.0, 350.0, 350.0, 205.0, 205.0), (4.69, 2.01, 6.11, 9.95, 11.0, 11.0)),
    "lateral_78": PeakRow((104.0, 147.0, 103.0, 264.0, 117.0, 106.0), (0.15, 0.58, 0.46, 1.09, 0.96, 11.0)),
    "sagittal_240": PeakRow((150.0, 187.0, 350.0, 350.0, 205.0, 205.0), (6.49, 1.47, 6.11, 5.69, 11.0, 11.0)),
}
"""By the name of our scenario."""

LANDING_HEIGHT = 0.55
LANDING_TILT = 5.0
COMBINED = (500.0, 70.0)
"""Section V-C: largest drop [m]; pelvis angle from 0.4 m [deg]; vertical and horizontal impulse [Ns]."""
WITHOUT_STEP = AlgorithmRow(72.0, 78.0)
"""The largest pushes of Table II without a step [Ns]."""


class PublishedPush(NamedTuple):
    """A push figure of another publication."""

    source: str
    robot: str
    push: str
    impulse: str
    steps: str


PUBLISHED = (
    PublishedPush(
        "Ferigo 2021, trained range", "iCub, 33 kg", "200 N x 0.2 s, any direction", "40 (1.21)", "not separated"
    ),
    PublishedPush(
        "Ferigo 2021, out of sample", "iCub, 33 kg", "300-400 N x 0.2 s", "60-80 (1.8-2.4), rate not seen", ""
    ),
    PublishedPush("Yang 2018", "Valkyrie, 137 kg", "sagittal, pelvis", "240 (1.75)", "8 steps"),
    PublishedPush("Yang 2018, DDPG", "Valkyrie, 137 kg", "lateral, pelvis", "160 (1.17)", 'caption: "without steps"'),
    PublishedPush("Weng 2023, hardware", "Digit", "frontal impactor", "26.4", "in place"),
    PublishedPush("Shafiee 2019", "iCub, 33 kg", "150 N x 0.05 s, walking", "7.5 (0.23)", "yes"),
)
"""Impulses in Ns, in brackets Ns/kg."""
