"""Run a surefoot policy at 500 Hz with numpy and onnxruntime alone, after docs/policy-file.md.

``python runtime.py POLICY.onnx VECTORS.csv`` drives the loop with the states of a golden run in the place of a robot's,
compares every number with the run's, and prints the loop's latency and jitter. Both files are written by
``surefoot export``. On a robot, `Loop.start` and `Loop.tick` get the estimator's state instead.
"""

import csv
import json
import sys
import time

import numpy as np
import onnxruntime

TOLERANCE = {"observation": 1e-9, "filtered": 1e-9, "action": 2e-4, "target": 2e-4, "torque": 0.4}
"""Largest differences: the network computes in float32, and a torque is up to 3000 Nm/rad times a target's."""


class Policy:
    """A policy file: its contract, its terms and its network."""

    def __init__(self, path):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self.session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
        metadata = self.session.get_modelmeta().custom_metadata_map
        if "surefoot_terms" not in metadata:
            sys.exit(f"{path} has no terms; surefoot export POLICY --onnx FILE writes a file with them")
        self.contract, self.terms = json.loads(metadata["surefoot"]), json.loads(metadata["surefoot_terms"])
        for name in ("nominal_pose", "stiffness", "damping", "torque_limit", "velocity_limit"):
            setattr(self, name, np.array(self.contract[name]))
        self.lower = np.array([joint["lower"] for joint in self.terms["joints"]])
        self.upper = np.array([joint["upper"] for joint in self.terms["joints"]])
        self.past = self.contract.get("past_observations", 0), self.contract.get("past_actions", 0)
        self.observed, self.acted = None, None

    def goal(self, filtered):
        """The action (num_joints,) for a filtered observation, and the joint targets [rad] that it means."""
        if self.observed is None:
            self.observed = [filtered] * self.past[0]
            self.acted = [np.zeros(len(self.nominal_pose))] * self.past[1]
        inputs = np.concatenate([filtered, *self.observed, *self.acted]).astype(np.float32)
        (actions,) = self.session.run(None, {self.terms["network"]["input"]["name"]: inputs[None]})
        action = actions[0].astype(np.float64)
        clipped = np.clip(action, -1.0, 1.0)
        self.observed = [filtered, *self.observed][: self.past[0]]
        self.acted = [clipped, *self.acted][: self.past[1]]
        targets = self.nominal_pose + self.contract["action_scale"] * clipped
        return action, np.clip(targets, self.lower, self.upper)


class Loop:
    """The control loop about a policy: observation, filter, path and joint law."""

    def __init__(self, policy):
        self.policy, contract = policy, policy.contract
        self.ticks_per_step = policy.terms["loop"]["target_ticks"]
        # First-order Butterworth low-pass by the bilinear transform: y = b (x + x') - a y'.
        warped = np.tan(np.pi * contract["filter_cutoff_hz"] / contract["control_hz"])
        self.b, self.a = warped / (1.0 + warped), (warped - 1.0) / (warped + 1.0)
        self.observation = self.filtered = self.action = self.target = None

    def start(self, state, held):
        """Begin with a robot that stands at rest while its motors hold these angles (num_joints,) [rad]."""
        self.observation = self.filtered = self.observe(state)
        self.target = self.before = self.goal = np.array(held)
        self.number = 0

    def tick(self, state):
        """One tick: returns the motors' torques (num_joints,) [Nm] for a state."""
        place = self.number % self.ticks_per_step
        if place == 0:
            self.before = self.goal
            self.action, self.goal = self.policy.goal(self.filtered)
        u = (place + 1) / self.ticks_per_step
        self.target = self.before + (3.0 * u * u - 2.0 * u**3) * (self.goal - self.before)
        observation = self.observe(state)
        self.filtered = self.b * (observation + self.observation) - self.a * self.filtered
        self.observation = observation
        self.number += 1
        return self.torque(state["joint_position"], state["joint_velocity"])

    def torque(self, position, velocity):
        """The joint law, to be computed at 1 kHz at least where nothing makes its damping implicit."""
        p = self.policy
        wanted = p.stiffness * (self.target - position) - p.damping * velocity
        stall = p.terms["motors"]["stall_torque_ratio"] * p.torque_limit
        within_voltage = np.clip(
            wanted, stall * (-1.0 - velocity / p.velocity_limit), stall * (1.0 - velocity / p.velocity_limit)
        )
        return np.clip(within_voltage, -p.torque_limit, p.torque_limit)

    def observe(self, state):
        """The observation in the contract's order and units."""
        w, x, y, z = state["root_orientation"]
        forward = np.array([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)])
        cos, sin = forward / np.linalg.norm(forward)
        to_heading = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        units, root = self.policy.terms["units"], self.policy.terms["root"]
        roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
        parts = {
            "joint_position": state["joint_position"],
            "joint_velocity": state["joint_velocity"] / np.array(units["joint_velocity"]),
            f"{root}_attitude": (roll, pitch),
            "foot_force": state["foot_force"] / units["foot_force"],
        }
        for name, quantity in (
            (f"{root}_velocity", "root_velocity"),
            (f"{root}_angular_velocity", "root_angular_velocity"),
            ("com_velocity", "com_velocity"),
        ):
            parts[name] = to_heading @ state[quantity]
        for name, quantity in (
            ("com_position", "com_position"),
            ("torso_position", "torso_position"),
            ("left_foot_position", "left_sole_position"),
            ("right_foot_position", "right_sole_position"),
        ):
            parts[name] = to_heading @ (state[quantity] - state["root_position"])
        order = dict.fromkeys(name.split(".")[0] for name in self.policy.contract["observations"])
        return np.concatenate([parts[name] for name in order])


def read_vectors(path):
    """The columns of a golden run by the first word of their names: (num_ticks, size) each."""
    with open(path, newline="") as stream:
        header, *rows = csv.reader(stream)
    values, found = np.array(rows, float), {}
    for column, name in enumerate(header):
        found.setdefault(name.split(".")[0], []).append(column)
    return {word: values[:, columns] for word, columns in found.items()}


def run(policy, vectors, period):
    """Drive the loop with a golden run's states; returns the largest differences, latencies and wake-up delays [s]."""
    loop, worst, latency, late = Loop(policy), dict.fromkeys(TOLERANCE, 0.0), [], []
    states = [{word: part[row] for word, part in vectors.items()} for row in range(len(vectors["tick"]))]
    loop.start(states[0], vectors["target"][0])
    due = time.perf_counter()
    for row, state in enumerate(states[1:], start=1):
        due += period
        while period and time.perf_counter() < due:
            time.sleep(max(0.0, due - time.perf_counter() - 1e-4))
        began = time.perf_counter()
        torque = loop.tick(state)
        latency.append(time.perf_counter() - began)
        late.append(began - due if period else 0.0)
        for word in worst:
            value = torque if word == "torque" else getattr(loop, word)
            worst[word] = max(worst[word], float(np.abs(value - vectors[word][row]).max()))
    return worst, np.array(latency), np.array(late)


def main():
    """Run, compare and print; exit code 1 if a number is off."""
    if len(sys.argv) not in (3, 4):
        sys.exit("usage: python runtime.py POLICY.onnx VECTORS.csv [--fast]")
    policy, vectors = Policy(sys.argv[1]), read_vectors(sys.argv[2])
    period = 0.0 if sys.argv[3:] == ["--fast"] else 1.0 / policy.contract["control_hz"]
    worst, latency, late = run(policy, vectors, period)
    for word, difference in worst.items():
        print(f"{word}: largest difference {difference:.1e}, allowed {TOLERANCE[word]:.0e}")
    for word, values in (("latency", latency), ("jitter", late)):
        median, high, most = 1e6 * np.percentile(values, [50, 99, 100])
        print(f"{word} of a tick: median {median:.0f} us, 99 % {high:.0f} us, largest {most:.0f} us")
    sys.exit(any(worst[word] > allowed for word, allowed in TOLERANCE.items()))


if __name__ == "__main__":
    main()
