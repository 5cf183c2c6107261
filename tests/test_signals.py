import numpy as np
import pytest
from scipy.signal import butter, lfilter, lfilter_zi

from surefoot.physics.signals import Delay, LowPass, Noise, cubic_path

RNG = np.random.default_rng(0)
BLOCK = 20


def scipy_reference(signal: np.ndarray) -> np.ndarray:
    """The same filter, tick by tick, over (num_robots, num_ticks, num_signals), steady at the first value."""
    b, a = butter(1, 10.0, fs=500.0)
    start = lfilter_zi(b, a)[0] * signal[:, :1]
    return lfilter(b, a, signal, axis=1, zi=start)[0]


def test_the_low_pass_equals_scipys_filter_over_many_blocks() -> None:
    signal = RNG.normal(size=(3, 10 * BLOCK, 47)) * 10.0
    low_pass = LowPass(3, 47, sample_hz=500.0)
    low_pass.reset(np.arange(3), signal[:, 0])
    expected = scipy_reference(signal)
    for block in range(10):
        ticks = slice(block * BLOCK, (block + 1) * BLOCK)
        output = low_pass([signal[:, ticks]])
        np.testing.assert_allclose(output, expected[:, ticks.stop - 1], rtol=0, atol=1e-12)
        np.testing.assert_array_equal(output, low_pass.output)


def test_the_low_pass_of_single_ticks_equals_scipys_filter_at_every_tick() -> None:
    signal = RNG.normal(size=(2, 50, 3))
    low_pass = LowPass(2, 3, sample_hz=500.0)
    low_pass.reset(np.arange(2), signal[:, 0])
    outputs = np.stack([low_pass([signal[:, k : k + 1]]).copy() for k in range(50)], axis=1)
    np.testing.assert_allclose(outputs, scipy_reference(signal), rtol=0, atol=1e-12)


def test_the_low_pass_stays_where_a_constant_signal_starts_it() -> None:
    low_pass = LowPass(2, 2, sample_hz=500.0)
    constant = np.array([[3.0, -700.0], [0.1, 1e-3]])
    low_pass.reset(np.arange(2), constant)
    for _ in range(5):
        low_pass([np.repeat(constant[:, None], BLOCK, axis=1)])
        np.testing.assert_allclose(low_pass.output, constant, rtol=1e-13)


@pytest.mark.parametrize(("hz", "gain"), [(10.0, 1 / np.sqrt(2)), (1.0, 0.995), (100.0, 0.08627)])
def test_the_low_pass_passes_3_db_less_at_its_cutoff(hz: float, gain: float) -> None:
    # First-order Butterworth by the bilinear transform: |H| = 1 / sqrt(1 + (tan(pi f / fs) / tan(pi fc / fs))^2);
    # at 1 Hz the ratio is 0.1 -> 0.995; at 100 Hz 0.72654 / 0.062915 = 11.548 -> 0.08627.
    time = np.arange(5000) / 500.0
    low_pass = LowPass(1, 1, sample_hz=500.0)
    low_pass.reset(np.array([0]), np.zeros((1, 1)))
    output = np.array([low_pass([np.full((1, 1, 1), np.sin(2 * np.pi * hz * t))])[0, 0] for t in time])
    settled = output[2500:]  # whole periods of all three
    assert np.sqrt(2.0 * np.mean(settled**2)) == pytest.approx(gain, rel=1e-3)


def test_the_low_pass_of_some_robots_leaves_the_others_alone() -> None:
    start = RNG.normal(size=(4, 3))
    signal = RNG.normal(size=(2, BLOCK, 3))
    low_pass = LowPass(4, 3, sample_hz=500.0)
    low_pass.reset(np.arange(4), start)
    ids = np.array([2, 0])
    output = low_pass([signal], ids)
    np.testing.assert_array_equal(low_pass.output[[1, 3]], start[[1, 3]])
    np.testing.assert_array_equal(low_pass.output[ids], output)
    # As if the two had been alone, in this order.
    alone = LowPass(2, 3, sample_hz=500.0)
    alone.reset(np.arange(2), start[ids])
    np.testing.assert_array_equal(alone([signal]), output)


def test_a_reset_forgets_one_robots_past_only() -> None:
    signal = RNG.normal(size=(2, BLOCK, 1))
    low_pass = LowPass(2, 1, sample_hz=500.0)
    low_pass([signal])
    kept = low_pass.output[0].copy()
    low_pass.reset(np.array([1]), np.array([[5.0]]))
    np.testing.assert_array_equal(low_pass.output, [kept, [5.0]])
    # The robot that was put back knows nothing of its last input: a constant 5 stays 5.
    output = low_pass([np.full((1, BLOCK, 1), 5.0)], np.array([1]))
    np.testing.assert_allclose(output, [[5.0]], rtol=1e-13)


def test_a_cubic_path_follows_its_polynomial() -> None:
    path = cubic_path(np.array([[1.0, 0.0]]), np.array([[3.0, -1.0]]), 20)
    # s(u) = 3 u^2 - 2 u^3: s(1/20) = 0.0075 - 0.00025, s(5/20) = 0.1875 - 0.03125, s(10/20) = 0.5, s(20/20) = 1
    for tick, share in ((1, 0.00725), (5, 0.15625), (10, 0.5), (20, 1.0)):
        np.testing.assert_allclose(path[0, tick - 1], [1.0 + 2.0 * share, -share], rtol=1e-14)


def test_a_cubic_path_ends_exactly_at_its_goal() -> None:
    start, end = RNG.normal(size=(2, 5, 11))
    np.testing.assert_allclose(cubic_path(start, end, 20)[:, -1], end, rtol=0, atol=1e-15)


def test_a_cubic_path_is_at_rest_at_both_ends() -> None:
    path = cubic_path(np.zeros((1, 1)), np.ones((1, 1)), 1000)[0, :, 0]
    increments = np.diff(path, prepend=0.0)
    # ds/du = 6 u (1 - u): 0 at both ends, 1.5 in the middle, so 1.5e-3 per tick there.
    assert increments[0] == pytest.approx(3e-6, rel=1e-3)
    assert increments[-1] == pytest.approx(3e-6, rel=1e-3)
    assert increments.max() == pytest.approx(1.5e-3, rel=1e-5)
    assert (increments > 0).all()


def test_a_cubic_path_to_where_it_starts_stays_there() -> None:
    here = RNG.normal(size=(3, 11))
    np.testing.assert_array_equal(cubic_path(here, here, 20), np.repeat(here[:, None], 20, axis=1))


def test_a_cubic_path_is_written_where_it_is_asked_to_be() -> None:
    start, end = RNG.normal(size=(2, 5, 11))
    wide = np.full((5, 20, 30), 7.0)  # as in the engine, whose targets are a part of its controls
    path = cubic_path(start, end, 20, out=wide[..., :11])
    assert np.shares_memory(path, wide)
    np.testing.assert_array_equal(wide[..., :11], cubic_path(start, end, 20))
    np.testing.assert_array_equal(wide[..., 11:], 7.0)


# Noise.


def noise_of(std: dict[int, float], seeds: dict[int, int] | None = None) -> Noise:
    noise = Noise(4)
    for robot, deviation in std.items():
        noise.reset(robot, deviation, np.random.default_rng((seeds or {}).get(robot, robot)))
    return noise


def test_noise_has_its_deviation_and_no_mean() -> None:
    noise = noise_of({0: 0.5, 1: 0.0, 2: 3.0})
    signal = np.full((3, 20_000, 2), 10.0)
    noisy = noise.add(np.array([0, 1, 2]), signal) - 10.0
    np.testing.assert_array_equal(noisy[1], 0.0)
    for row, std in ((0, 0.5), (2, 3.0)):
        # 40 000 draws: the mean deviates by std / 200, the deviation by std / 283.
        assert abs(noisy[row].mean()) < 4 * std / 200
        assert noisy[row].std() == pytest.approx(std, rel=4 / 283)
        # New at every tick and in every column.
        assert abs(np.corrcoef(noisy[row, 1:, 0], noisy[row, :-1, 0])[0, 1]) < 4 / np.sqrt(20_000)
        assert abs(np.corrcoef(noisy[row].T)[0, 1]) < 4 / np.sqrt(20_000)
    np.testing.assert_array_equal(signal, 10.0)  # which is somebody else's


def test_noise_of_a_robot_is_its_seeds_whoever_else_is_there() -> None:
    signal = np.zeros((1, 20, 3))
    alone = [noise_of({2: 0.5}).add(np.array([2]), signal)[0]]
    noise = noise_of({0: 1.0, 2: 0.5, 3: 2.0})
    together = noise.add(np.array([0, 2, 3]), np.zeros((3, 20, 3)))
    np.testing.assert_array_equal(together[1], alone[0])
    other = noise_of({2: 0.5}, seeds={2: 9}).add(np.array([2]), signal)[0]
    assert (other != alone[0]).all()
    # The next ones are new, and also do not depend on who was asked meanwhile.
    reference = noise_of({2: 0.5})
    reference.add(np.array([2]), signal)
    noise.add(np.array([0, 3]), np.zeros((2, 20, 3)))
    following = noise.add(np.array([2]), signal)[0]
    np.testing.assert_array_equal(following, reference.add(np.array([2]), signal)[0])
    assert (following != alone[0]).all()


def test_a_robot_without_noise_any_more_has_none() -> None:
    noise = noise_of({1: 0.5})
    noise.reset(1, 0.0, np.random.default_rng(0))
    signal = RNG.normal(size=(2, 20, 3))
    np.testing.assert_array_equal(noise.add(np.array([0, 1]), signal), signal)


# Delay.


def test_a_delay_by_hand() -> None:
    delay = Delay(3, block=4, size=1)
    delay.reset(0, 0, np.array([-1.0]))
    delay.reset(1, 1, np.array([-2.0]))
    delay.reset(2, 4, np.array([-3.0]))
    first, second = np.arange(1.0, 9.0).reshape(2, 1, 4, 1).repeat(3, axis=1)  # 1 2 3 4, then 5 6 7 8
    everyone = np.arange(3)
    np.testing.assert_array_equal(delay(everyone, first)[..., 0], [[1, 2, 3, 4], [-2, 1, 2, 3], [-3, -3, -3, -3]])
    np.testing.assert_array_equal(delay(everyone, second)[..., 0], [[5, 6, 7, 8], [4, 5, 6, 7], [1, 2, 3, 4]])


def test_a_delay_of_some_robots_leaves_what_the_others_wait_for() -> None:
    delay = Delay(2, block=4, size=1)
    for robot in (0, 1):
        delay.reset(robot, 2, np.array([0.0]))
    delay(np.array([0, 1]), np.array([[1.0, 2, 3, 4], [5, 6, 7, 8]])[..., None])
    np.testing.assert_array_equal(delay(np.array([1]), np.full((1, 4, 1), 9.0))[0, :, 0], [7, 8, 9, 9])
    np.testing.assert_array_equal(delay(np.array([0]), np.full((1, 4, 1), 9.0))[0, :, 0], [3, 4, 9, 9])
    # And a reset forgets what was under way.
    delay.reset(0, 3, np.array([-1.0]))
    np.testing.assert_array_equal(delay(np.array([0]), np.full((1, 4, 1), 5.0))[0, :, 0], [-1, -1, -1, 5])


def test_no_delay_is_no_change() -> None:
    delay = Delay(2, block=20, size=11)
    signal = RNG.normal(size=(2, 20, 11))
    np.testing.assert_array_equal(delay(np.arange(2), signal), signal)
