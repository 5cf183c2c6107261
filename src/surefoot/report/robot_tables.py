"""Robot tables: a robot's description as read, for `surefoot robot check`."""

from __future__ import annotations

import numpy as np

from surefoot.evaluation.protocol import protocol_for
from surefoot.evaluation.robot_check import RobotCheck
from surefoot.rates import CONTROL_DT
from surefoot.report.table import Table


def robot_tables(check: RobotCheck) -> list[Table]:
    """Every table of a robot check, in the order in which they are printed."""
    return [facts_table(check), joint_table(check), held_table(check), findings_table(check)]


def facts_table(check: RobotCheck) -> Table:
    """Mass, places, feet, scales, speed and whether it stands."""
    robot, facts = check.robot, check.facts
    protocol = protocol_for(robot)
    length, width = 200.0 * robot.sole_half_size
    offset = 100.0 * facts.com[:2]
    stood = [outcome for outcome in check.outcomes if outcome.recovered]
    delivered, trimmed, described = check.speeds
    rows = [
        ("mass", f"{robot.mass:.2f} kg, {robot.mass_scale:.3f} of the paper's robot"),
        ("legs", f"{robot.leg_length:.3f} m from the hip to the sole, {robot.length_scale:.3f} of the paper's robot"),
        ("time", f"{robot.time_scale:.3f} of the paper's robot for the same motion"),
        ("root, torso", f"{robot.root}, {robot.torso}"),
        ("feet", f"{robot.feet[0]}, {robot.feet[1]}; soles of {length:.1f} cm x {width:.1f} cm"),
        ("friction of the feet", f"{robot.friction:g}"),
        ("pose", f"{check.pose} of {', '.join(robot.poses)}"),
        ("CoM", f"{facts.com[2]:.3f} m above the soles, {offset[0]:+.1f} cm and {offset[1]:+.1f} cm from their middle"),
        ("toppling stiffness", f"m g z = {robot.weight * facts.com[2]:.0f} Nm/rad{_held(check)}"),
        ("may be pushed", ", ".join(f"{word} ({robot.pushable[word]})" for word in robot.body_words)),
        ("grid of impulses", f"{protocol.impulse_step:g} Ns up to {protocol.impulse_end:g} Ns"),
        ("a step", f"a foot that moves by {100 * protocol.step_length:.1f} cm"),
        ("stands 10 s", f"{len(stood)} of {len(check.outcomes)} trials, {_worst_speed(check)}"),
        ("physics", f"{described:,.0f} ticks/s on one core, {described / delivered:.2f} times the model as delivered"),
        ("", f"as delivered {delivered:,.0f}; trimmed to the legs and the floor {trimmed:,.0f} ticks/s"),
        ("fingerprint", robot.fingerprint),
    ]
    return Table(f"{robot.title} ({robot.name})", ("", "understood"), rows)


def _held(check: RobotCheck) -> str:
    left, right = check.facts.ankles
    if left is None or right is None:
        return ""
    return f"; the ankles hold {check.robot.stiffness[left] + check.robot.stiffness[right]:.0f}"


def _worst_speed(check: RobotCheck) -> str:
    speeds = [outcome.com_speed for outcome in check.outcomes if outcome.recovered]
    return f"CoM slower than {1000 * max(speeds):.1f} mm/s at the end" if speeds else check.outcomes[0].reason


def joint_table(check: RobotCheck) -> Table:
    """Every controlled joint with its limits, gains and time constants."""
    robot, facts = check.robot, check.facts
    rows = []
    for j, name in enumerate(robot.joint_names):
        image = int(robot.mirror_source[j])
        mirror = "itself" if image == j else robot.joint_names[image]
        stiffness, damping, inertia = robot.stiffness[j], robot.damping[j], facts.inertia[j]
        rows.append(
            (
                name,
                f"{'-' if robot.mirror_sign[j] < 0 else ''}{mirror}" if robot.is_symmetric else "",
                f"{robot.joint_lower[j]:.2f} to {robot.joint_upper[j]:.2f}",
                f"{robot.poses[check.pose][j]:g}",
                f"{1000 * check.sag[j]:+.0f}",
                f"{stiffness:g}",
                f"{damping:g}",
                f"{robot.torque_limit[j]:g}",
                f"{robot.velocity_limit[j]:g}",
                f"{check.torque[j]:.0f}",
                f"{1000 * damping / stiffness:.0f}" if stiffness else "",
                f"{np.sqrt(stiffness / inertia) / (2 * np.pi):.1f}",
                f"{damping * CONTROL_DT / inertia:.2f}",
            )
        )
    columns = (
        "joint", "mirror image", "range [rad]", "pose", "sag [mrad]", "K [Nm/rad]", "D [Nms/rad]", "torque [Nm]",
        "speed [rad/s]", "standing [Nm]", "D/K [ms]", "f [Hz]", "D dt/I",
    )  # fmt: skip
    note = "I is the inertia that a motor feels while the robot is free in space, f = sqrt(K / I) / (2 pi), dt = 2 ms."
    return Table("Controlled joints", columns, rows, note)


def held_table(check: RobotCheck) -> Table:
    """Joints that are not controlled, and where they are held."""
    rows = [(name, f"{angle:g}") for name, angle in check.robot.held_joints.items()]
    return Table("Held joints", ("joint", "angle [rad]"), rows)


def findings_table(check: RobotCheck) -> Table:
    """The faults and suspicious values."""
    rows = [("wrong" if found.is_wrong else "suspicious", found.key, found.text) for found in check.findings]
    return Table("To look at", ("", "key", "what"), rows)
