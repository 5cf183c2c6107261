"""Measure a graded policy with few trials: measure.py [--trials N] [--parts standing,strong,...] POLICY...

standing: the largest impulse below which every trial recovers without a step, 16 directions, at the root
torso:    the same at the torso, with a lever of 0.32 m, 8 directions
strong:   share of pushes that are recovered, and within the joints' speed limits, 60 to 456 Ns in 16 directions, and
          the largest impulse below which nothing failed
noise:    whole trials that recover without noise, with 0.5 on the observation, and with 0.1 rad on the targets
quiet:    unpushed and after 30, 102 and 150 Ns: drift, power and steps from 5 s after the push on
border:   60 to 138 Ns within 22.5 degrees of forward and backward, where two teachers' labels meet
table2:   steps, tilted feet and recoveries at 72 Ns forward and backward and at 78 Ns to both sides

Seeds count from 2,000,000, which no training uses. One thread.
"""

import argparse
from dataclasses import replace

import numpy as np

from surefoot.agents.load import load_policy
from surefoot.evaluation.evaluate import push_lines
from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.trials import NUM_SLOTS, run_list
from surefoot.learning.standing import share_held
from surefoot.task.imperfections import Imperfections

SEED = 2_000_000


def outcomes_of(policy, trials):
    """Return the trials' outcomes in order."""
    found = run_list(policy, trials, num_slots=min(NUM_SLOTS, len(trials)), num_threads=1)
    return [found[trial] for trial in trials]


def standing(policy, num, scenario=None):
    """Print what is answered without a step."""
    lines = (scenario or Scenario("standing", directions=16)).lines()
    found, alive = np.zeros(len(lines)), np.ones(len(lines), bool)
    for cell in range(2, 21):
        tried = np.flatnonzero(alive)
        share = share_held(policy, [lines[i] for i in tried], [cell], num, 1, SEED)[:, 0]
        alive[tried] = share == 1.0
        found[alive] = 6 * cell
        if not alive.any():
            break
    named = {line.name: int(impulse) for line, impulse in zip(lines, found, strict=True)}
    print("  without a step [Ns]:", named, "worst", int(found.min()))


def torso(policy, num):
    """Print what is answered without a step at the torso."""
    standing(policy, num, Scenario("torso", directions=8, body="torso", lever=0.32))


def strong(policy, num, cells=range(10, 77, 6)):
    """Print what is recovered, and within limits."""
    lines = push_lines(16)
    keys = [(i, cell, k) for i in range(16) for cell in cells for k in range(num)]
    found = outcomes_of(policy, [lines[i].trial(cell, SEED + k, False) for i, cell, k in keys])
    ok, within = np.zeros((16, len(cells))), np.zeros((16, len(cells)))
    for (i, cell, _), outcome in zip(keys, found, strict=True):
        j = cells.index(cell)
        ok[i, j] += outcome.recovered / num
        within[i, j] += (outcome.recovered and outcome.is_within_limits(PROTOCOL.speed_share)) / num
    print(f"  recovered {ok.mean():.3f}, within limits {within.mean():.3f}")
    print(
        "  by impulse", {6 * c: f"{a:.2f}/{b:.2f}" for c, a, b in zip(cells, ok.mean(0), within.mean(0), strict=True)}
    )
    for name, share in (("any", ok), ("within limits", within)):
        unbroken = np.cumprod(share > 0.999, axis=1).sum(axis=1)
        largest = [6 * cells[n - 1] if n else 0 for n in unbroken]
        print(f"  {name}: nothing failed up to [Ns]", largest, "worst", min(largest), "best", max(largest))


def noise(policy, num, cells=(1, 5, 9, 13, 17, 21, 25, 29, 33, 37, 41, 45)):
    """Print what is recovered under noise."""
    lines = push_lines(4)
    plain = [line.trial(cell, SEED + k, True) for line in lines for cell in cells for k in range(num)]
    for name, imperfections in (
        ("none", Imperfections()),
        ("0.5 on the observation", Imperfections(observation_noise=0.5)),
        ("0.1 rad on the targets", Imperfections(action_noise=0.1)),
    ):
        found = outcomes_of(policy, [replace(trial, imperfections=imperfections) for trial in plain])
        reasons = [outcome.reason for outcome in found if not outcome.recovered]
        told = {reason: reasons.count(reason) for reason in set(reasons)}
        print(f"  noise {name}: {sum(o.recovered for o in found)} of {len(found)} recover; {told}")


def quiet(policy, num):
    """Print how still it stands."""
    lines = push_lines(8)
    for cell in (0, 5, 17, 25):
        some = lines if cell else lines[:1]
        found = outcomes_of(
            policy, [line.trial(cell, SEED + k, True) for line in some for k in range(num if cell else 8)]
        )
        ok = [outcome for outcome in found if outcome.recovered]
        told = {
            name: (round(float(np.median(values)), 4), round(float(np.max(values)), 4))
            for name in ("quiet_drift", "quiet_power", "quiet_steps")
            if (values := [getattr(outcome, name) for outcome in ok])
        }
        print(f"  {6 * cell} Ns: recovered {len(ok)} of {len(found)}; median, largest: {told}")


def border(policy, num):
    """Print what fails just beyond what is answered without a step."""
    lines = push_lines(16)
    keys = [(i, cell, k) for i in (15, 0, 1, 7, 8, 9) for cell in range(10, 24, 2) for k in range(num)]
    found = outcomes_of(policy, [lines[i].trial(cell, SEED + k, False) for i, cell, k in keys])
    failed = [(lines[i].name, 6 * cell) for (i, cell, _), o in zip(keys, found, strict=True) if not o.recovered]
    print(f"  border: {len(failed)} of {len(found)} fail", failed)


def table2(policy, num):
    """Print how the pushes of Table II are answered."""
    lines = push_lines(4)
    for line, cell in ((lines[0], 12), (lines[2], 12), (lines[1], 13), (lines[3], 13)):
        found = outcomes_of(policy, [line.trial(cell, SEED + k, False) for k in range(num)])
        steps = sum(not outcome.is_without_step(PROTOCOL.step_length) for outcome in found)
        tilted = sum(outcome.foot_tilt for outcome in found)
        recovered = sum(outcome.recovered for outcome in found)
        told = f"steps or falls in {steps} of {num}, tilted feet in {tilted}, recovered {recovered}"
        print(f"  {6 * cell} Ns {line.name}: {told}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--parts", default="standing,strong,noise,quiet,table2")
    parser.add_argument("--trials", type=int, default=4)
    parser.add_argument("policies", nargs="+")
    args = parser.parse_args()
    for name in args.policies:
        print(name, flush=True)
        for part in args.parts.split(","):
            globals()[part](load_policy(name), args.trials)
