from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from conftest import driven_loop
from scipy.spatial.transform import Rotation

from surefoot.agents.load import load_policy
from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation.strategies import HABIT, Step, Strategies, StrategyWatch
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_HZ, TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.task.agent import Agent

FORWARD, BACKWARD, LEFT = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
EVERYONE = np.array([0])
HALF_WEIGHT = 673.0
Alter = Callable[..., StepRecord]


class Story:
    """One robot's ticks, written policy step by policy step: half a second at rest, then what a test makes of it."""

    def __init__(self, robot: Robot, standing: StepRecord, altered: Alter):
        self.standing, self.altered = standing, altered
        soles = standing.sole_position[0, -1]
        self.sole = {"left": soles[0], "right": soles[1]}
        self.watch = StrategyWatch(robot, 1)
        self.watch.reset(EVERYONE, self.ticks())
        for _ in range(13):
            self.goes_on(before=True)

    def ticks(self, **sensors: object) -> StepRecord:
        """Standing ticks with flat feet, each with half of the weight at its centre, but for the given sensors."""
        feet: dict[str, object] = {}
        for side, sole in self.sole.items():
            feet[f"{side}_foot_contact"] = contact(HALF_WEIGHT, sole)
            feet[f"{side}_sole_position"] = sole
            feet[f"{side}_foot_orientation"] = (1.0, 0.0, 0.0, 0.0)
        flat = {"torso_up": (0.0, 0.0, 1.0), "angular_momentum": (0.0, 0.0, 0.0)}
        return self.altered(self.standing, **(feet | flat | sensors))

    def goes_on(self, num_steps: int = 1, before: bool = False, num_before: int = 0, **sensors: object) -> Strategies:
        ticks = self.ticks(**sensors)
        active = np.arange(TICKS_PER_STEP)[None] >= (TICKS_PER_STEP if before else num_before)
        for _ in range(num_steps):
            self.watch.update(EVERYONE, ticks, active)
        return self.watch.strategies(0)


@pytest.fixture
def story(robot: Robot, standing: StepRecord, altered: Alter) -> Story:
    return Story(robot, standing, altered)


def contact(force: object, point: np.ndarray) -> np.ndarray:
    """A foot's contact sensor: found, force (normal last), torque, point; `force` may be one per tick."""
    normal = np.broadcast_to(np.asarray(force, float), (1, TICKS_PER_STEP))
    values = np.zeros((1, TICKS_PER_STEP, 10))
    values[..., 0], values[..., 3], values[..., 7:10] = normal > 0.0, normal, point
    return values


def quaternion(axis: str, degrees: float) -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_quat(scalar_first=True)


def world_up(axis: str, degrees: float) -> np.ndarray:
    """The world's z axis as seen from a body that is turned."""
    return Rotation.from_euler(axis, degrees, degrees=True).inv().apply([0.0, 0.0, 1.0])


def pressure_ahead(story: Story, x: float) -> dict[str, object]:
    """Both feet's pressure `x` ahead of their centres."""
    ahead = np.array([x, 0.0, 0.0])
    return {f"{side}_foot_contact": contact(HALF_WEIGHT, sole + ahead) for side, sole in story.sole.items()}


# Ankle, hip and foot tilt, by hand.


def test_at_rest_there_is_no_strategy(story: Story) -> None:
    assert story.goes_on(20) == Strategies()
    assert str(story.goes_on()) == "none"


def test_pressure_that_moves_within_the_soles_is_an_ankle_strategy(story: Story) -> None:
    # A mean with a time constant of 0.1 s has 1 - exp(-0.12 / 0.1) = 70 % of 0.04 m = 0.028 m after three steps of
    # 0.04 s, and 1 - exp(-0.4) = 33 % = 0.013 m after one; 0.02 m is needed.
    assert not story.goes_on(1, **pressure_ahead(story, 0.04)).ankle
    assert story.goes_on(2, **pressure_ahead(story, 0.04)) == Strategies(ankle=True)
    assert story.goes_on(20) == Strategies(ankle=True)  # a strategy once used stays used


def test_less_than_2_cm_is_none(story: Story) -> None:
    assert story.goes_on(50, **pressure_ahead(story, 0.019)) == Strategies()


def test_load_that_goes_from_foot_to_foot_is_no_ankle_strategy(story: Story) -> None:
    # The CoP moves from between the feet to the left one, but stays in the middle of the soles.
    left, right = contact(1300.0, story.sole["left"]), contact(46.0, story.sole["right"])
    assert story.goes_on(50, left_foot_contact=left, right_foot_contact=right) == Strategies()


def test_a_tilted_sole_that_carries_load_is_a_foot_tilt(story: Story) -> None:
    assert not story.goes_on(50, right_foot_orientation=quaternion("y", 1.4)).foot_tilt
    assert story.goes_on(50, right_foot_orientation=quaternion("y", 1.6)) == Strategies(foot_tilt=True)


def test_a_tilted_sole_in_the_air_is_none(story: Story) -> None:
    light = contact(0.0, story.sole["right"])
    lifted = story.goes_on(50, right_foot_orientation=quaternion("x", 20.0), right_foot_contact=light)
    assert lifted == Strategies()


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_trunk_that_turns_with_momentum_is_a_hip_strategy(story: Story, axis: str) -> None:
    momentum, other = np.roll([[5.0, 0.0, 0.0], [0.0, 5.0, 0.0]], "xy".index(axis), axis=0)
    turned = world_up(axis, 4.0)
    assert not story.goes_on(50, torso_up=turned).hip
    assert not story.goes_on(50, angular_momentum=other, torso_up=turned).hip
    assert story.goes_on(50, angular_momentum=momentum, torso_up=turned) == Strategies(hip=True)


def test_a_body_that_topples_as_one_piece_uses_no_hip(story: Story) -> None:
    # Trunk and CoM turn together by 10 degrees about the point between the soles.
    pivot = 0.5 * (story.sole["left"] + story.sole["right"])
    turn = Rotation.from_euler("y", 10.0, degrees=True)
    com = pivot + turn.apply(story.standing.com_position[0, -1] - pivot)
    sensors = {"torso_up": world_up("y", 10.0), "com_position": com, "angular_momentum": (0.0, 20.0, 0.0)}
    assert story.goes_on(50, **sensors) == Strategies()


def test_a_fall_adds_nothing(story: Story) -> None:
    fallen = {"torso_up": world_up("y", 60.0), "angular_momentum": (0.0, 50.0, 0.0)}
    assert story.goes_on(50, **fallen, left_foot_orientation=quaternion("y", 60.0)) == Strategies()


def test_what_a_robot_does_anyway_is_measured_before_the_disturbance(story: Story) -> None:
    # It rocks by +-4 degrees about flat, 0.2 s each way: a running mean of 0.1 s sees 76 % of that at most.
    for degrees in (4.0, -4.0) * 4:
        story.goes_on(5, before=True, left_foot_orientation=quaternion("y", degrees))
    for degrees in (4.0, -4.0) * 4:
        assert not story.goes_on(5, left_foot_orientation=quaternion("y", degrees)).foot_tilt
    assert story.goes_on(50, left_foot_orientation=quaternion("y", HABIT * 4.0 + 0.1)).foot_tilt


# Steps.


def lift(story: Story, side: str = "right", **when: int) -> None:
    story.goes_on(**when, **{f"{side}_foot_contact": contact(0.0, story.sole[side])})


def test_a_foot_that_lifts_and_lands_ahead_has_stepped(story: Story) -> None:
    story.goes_on(num_before=12)  # 8 ticks
    lift(story, num_steps=2)  # 40 ticks
    place = story.sole["right"].copy()
    story.sole["right"] = place + np.array([0.3, 0.04, 0.0])
    forces = np.where(np.arange(TICKS_PER_STEP) < 5, 0.0, HALF_WEIGHT)
    story.goes_on(right_foot_contact=contact(forces, story.sole["right"]))  # lands after 5 ticks
    strategies = story.goes_on(10)
    (step,) = strategies.steps
    assert (step.foot, step.place) == ("right", tuple(story.sole["right"][:2]))
    assert step.length == pytest.approx(np.hypot(0.3, 0.04))
    assert step.time == pytest.approx((8 + 40 + 5) * 0.002)
    assert strategies.num_steps == 1
    assert not strategies.slid
    assert str(strategies) == "1 step"


def test_a_foot_put_down_within_3_cm_has_not_stepped(story: Story) -> None:
    lift(story)
    story.sole["right"] = story.sole["right"] + np.array([0.029, 0.0, 0.0])
    assert story.goes_on(10) == Strategies()


def test_small_hops_add_up_to_a_foot_that_slid(story: Story) -> None:
    for _ in range(2):
        lift(story)
        story.sole["right"] = story.sole["right"] + np.array([0.02, 0.0, 0.0])
        strategies = story.goes_on(10)
    assert (strategies.num_steps, strategies.slid) == (0, True)


def test_a_loaded_foot_that_moves_has_slid_not_stepped(story: Story) -> None:
    for _ in range(4):
        story.sole["left"] = story.sole["left"] + np.array([0.01, 0.0, 0.0])
        strategies = story.goes_on()
    assert (strategies.num_steps, strategies.slid) == (0, True)


def test_chatter_is_no_step(story: Story) -> None:
    chatter = np.where(np.arange(TICKS_PER_STEP) % 10 < 8, 0.0, HALF_WEIGHT)  # 16 ms without, 4 ms with load
    story.sole["right"] = story.sole["right"] + np.array([0.1, 0.0, 0.0])
    assert story.goes_on(10, right_foot_contact=contact(chatter, story.sole["right"])).num_steps == 0
    # Nor does it land a foot that has lifted, until it stays down.
    lift(story)
    story.sole["right"] = story.sole["right"] + np.array([0.1, 0.0, 0.0])
    assert story.goes_on(10, right_foot_contact=contact(chatter, story.sole["right"])).num_steps == 0
    assert story.goes_on(10).num_steps == 1


def test_steps_before_the_disturbance_do_not_count(story: Story) -> None:
    story.goes_on(before=True, right_foot_contact=contact(0.0, story.sole["right"]))
    story.sole["right"] = story.sole["right"] + np.array([0.1, 0.0, 0.0])
    story.goes_on(10, before=True)
    assert story.goes_on(10) == Strategies()


def test_reset_forgets_one_robot_and_leaves_the_other(robot: Robot, story: Story) -> None:
    watch, both = StrategyWatch(robot, 2), np.array([0, 1])
    ticks = story.ticks()
    pair = ticks[np.array([0, 0])]
    watch.reset(both, pair)
    ahead = story.ticks(**pressure_ahead(story, 0.05))
    watch.update(np.array([1]), ahead, np.ones((1, TICKS_PER_STEP), bool))
    for _ in range(5):
        watch.update(np.array([1]), ahead, np.ones((1, TICKS_PER_STEP), bool))
    assert (watch.strategies(0), watch.strategies(1)) == (Strategies(), Strategies(ankle=True))
    watch.reset(np.array([1]), ticks)
    assert watch.strategies(1) == Strategies()


def test_strategies_in_words() -> None:
    step = Step("left", 0.3, (0.1, 0.2), 0.1)
    assert str(Strategies(ankle=True, hip=True, foot_tilt=True, steps=(step, step))) == "ankle, hip, foot tilt, 2 steps"


# Real robots.


def watch_pushes(policy: Agent, robot: Robot, pushes: list[tuple[tuple[float, float, float], float]]) -> StrategyWatch:
    """Pushes (direction, impulse [Ns]) at the root after one second, watched for five more, one robot each."""
    num_robots, ids = len(pushes), np.arange(len(pushes))
    loop = driven_loop(policy, num_robots)
    watch = StrategyWatch(robot, num_robots)
    watch.reset(ids, loop.engine.read(ids))
    impulses = np.array([impulse * np.array(direction) for direction, impulse in pushes])
    start = np.full(num_robots, CONTROL_HZ + 7)
    loop.pushes.schedule(ids, 0, np.full(num_robots, robot.body_id("root")), impulses, start, 0.12)
    for _ in range(6 * CONTROL_HZ // TICKS_PER_STEP):
        first = loop.tick[:, None].copy()
        ticks = loop.drive()
        watch.update(ids, ticks, first + np.arange(TICKS_PER_STEP) >= start[:, None])
    return watch


def test_the_stiff_nominal_pose_uses_ankles_and_then_its_soles_edges(robot: Robot) -> None:
    pushes = [(FORWARD, 0.0), (FORWARD, 24.0), (BACKWARD, 24.0), (LEFT, 24.0), (FORWARD, 60.0), (LEFT, 60.0)]
    watch = watch_pushes(NominalAgent(robot), robot, pushes)
    rest, *small, hard_forward, hard_left = [watch.strategies(i) for i in range(len(pushes))]
    assert rest == Strategies()
    assert small == [Strategies(ankle=True)] * 3
    assert hard_forward == hard_left == Strategies(ankle=True, foot_tilt=True)


def test_trpo_steps_ahead_of_a_hard_push(robot: Robot) -> None:
    watch = watch_pushes(load_policy("trpo"), robot, [(FORWARD, 240.0), (BACKWARD, 240.0), (FORWARD, 0.0)])
    for slot, way in ((0, 1.0), (1, -1.0)):
        strategies = watch.strategies(slot)
        assert strategies.hip
        first = [step for step in strategies.steps if step.time < 1.0]
        assert {step.foot for step in first} == {"left", "right"}
        assert max(step.length for step in first) > 0.2
        # Steps go where the push went, one after the other.
        places = [way * step.place[0] for step in first if step.length > 0.1]
        assert places[-1] > places[0] + 0.2
        assert [step.time for step in first] == sorted(step.time for step in first)
    assert watch.strategies(2).num_steps < watch.strategies(0).num_steps
