"""Behaviour of the smoothers and of the Kalman filter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.errors import UserError
from frictionpinn.numerics.kalman import KalmanFilter, KalmanSmoother
from frictionpinn.numerics.smoothing import NoSmoothing, SavitzkyGolay, SmoothingSpline, difference_sigma

OFFLINE = [NoSmoothing(), SavitzkyGolay(), SmoothingSpline(), KalmanSmoother(3), KalmanSmoother(4), KalmanSmoother(5)]
label = lambda s: f"{type(s).__name__}{getattr(s, 'order', '')}"  # noqa: E731
every = pytest.mark.parametrize("smoother", OFFLINE, ids=label)
fitting = pytest.mark.parametrize("smoother", OFFLINE[2:], ids=label)
few = settings(max_examples=8, deadline=None, derandomize=True)


def times(n: int = 400, rate: float = 400.0, uneven: float = 0.0, seed: int = 0) -> np.ndarray:
    steps = 1 + uneven * np.random.default_rng(seed).uniform(-1, 1, n - 1)
    return np.concatenate([[0.0], np.cumsum(steps)]) / rate


def swing(t: np.ndarray):
    w = 2 * np.pi
    return 0.9 * np.sin(w * t), 0.9 * w * np.cos(w * t), -0.9 * w**2 * np.sin(w * t), -0.9 * w**3 * np.cos(w * t)


def stick_slip(t: np.ndarray):
    """At rest, then driven by a step of the acceleration, then at rest again, once per second."""
    phase = np.mod(t, 1.0) - 0.3
    a = np.where((phase > 0) & (phase < 0.4), np.where(phase < 0.2, 5.0, -5.0), 0.0)
    v = np.where((phase > 0) & (phase < 0.4), 5 * (0.2 - np.abs(phase - 0.2)), 0.0)
    rise = np.where(phase < 0.2, 2.5 * phase**2, 0.2 - 2.5 * (0.4 - phase) ** 2)
    return np.floor(t) * 0.2 + np.where(phase <= 0, 0.0, np.where(phase < 0.4, rise, 0.2)), v, a


def noisy(signals, seed: int = 0, level: float = 0.05):
    draw = np.random.default_rng(seed).standard_normal
    return [s + level * np.std(s) * draw(len(s)) for s in signals[:3]]


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


@every
@given(coefficients=st.lists(st.floats(-2, 2), min_size=3, max_size=3), seed=st.integers(0, 99))
@few
def test_parabolas_without_noise_pass_unchanged_at_uneven_sampling(smoother, coefficients, seed):
    t = times(80, 100.0, 0.5, seed)
    p = np.polynomial.Polynomial([*coefficients[:2], 1 + abs(coefficients[2])])
    exact = [p.deriv(k)(t) if k else p(t) for k in range(4)]
    for result, truth in zip(smoother(t, *exact[:3]), exact, strict=True):
        assert np.abs(result - truth).max() < 1e-5 * max(1.0, np.abs(exact[0]).max())


@pytest.mark.parametrize(
    ("smoother", "degree"),
    [(SavitzkyGolay(order=4), 3), (SmoothingSpline(), 5), (KalmanSmoother(4), 3), (KalmanSmoother(5), 4)],
    ids=label,
)
@given(coefficients=st.lists(st.floats(0.5, 2), min_size=6, max_size=6), seed=st.integers(0, 99))
@few
def test_polynomials_up_to_the_smoothers_degree_pass_unchanged(smoother, degree, coefficients, seed):
    t = times(120, 100.0, 0.5, seed)
    p = np.polynomial.Polynomial(coefficients[: degree + 1])
    exact = [p(t), *(p.deriv(k)(t) for k in (1, 2, 3))]
    for result, truth in zip(smoother(t, *exact[:3]), exact, strict=True):
        assert np.abs(result - truth).max() < 1e-5 * np.abs(truth).max()


@every
@pytest.mark.parametrize("missing", [(1,), (2,), (1, 2)], ids=["velocity", "acceleration", "both"])
def test_missing_derivatives_are_made_up_from_the_rest(smoother, missing):
    t = times(uneven=0.3)
    truth = swing(t)
    given = [None if k in missing else truth[k] for k in range(3)]
    results = smoother(t, *given)
    inner = slice(20, -20)
    for k in range(3):
        assert rms((results[k] - truth[k])[inner]) < 0.02 * np.std(truth[k])


@every
def test_missing_position_is_the_integral_of_velocity_from_zero(smoother):
    t = times()
    q, v, a, _ = swing(t)
    result = smoother(t, None, v, a)
    assert np.abs(result[0] - (q - q[0])).max() < 0.01


@fitting
def test_acceleration_alone_is_integrated_twice_from_rest(smoother):
    t = times()
    q, v, a, _ = swing(t)
    result = smoother(t, None, None, a)
    assert np.abs(result[1] - (v - v[0])).max() < 0.05
    assert np.abs(result[0] - (q - q[0] - v[0] * t)).max() < 0.05


@fitting
def test_missing_samples_are_bridged(smoother):
    t = times()
    truth = swing(t)
    y = noisy(truth)
    y[0][50:70], y[2][200:230] = np.nan, np.nan
    result = smoother.fit([(t, *y)])(t, *y)
    assert all(np.isfinite(r).all() for r in result)
    assert rms(result[0] - truth[0]) < 0.02 * np.std(truth[0])


@pytest.mark.parametrize(
    ("smoother", "least"),
    [(SmoothingSpline(), (8, 8, 4)), (KalmanSmoother(4), (8, 8, 3.5)), (KalmanSmoother(5), (8, 8, 4.5))],
    ids=label,
)
@pytest.mark.parametrize("uneven", [0.0, 0.4])
def test_noise_on_a_swing_falls_by_the_stated_factors(smoother, least, uneven):
    ts = [times(960, uneven=uneven, seed=k) for k in range(4)]
    data = [(t, *noisy(swing(t), seed=k)) for k, t in enumerate(ts)]
    fitted = smoother.fit(data)
    for k in range(3):
        before = np.concatenate([trial[k + 1] - swing(trial[0])[k] for trial in data])
        after = np.concatenate([fitted(*trial)[k] - swing(trial[0])[k] for trial in data])
        assert rms(before) / rms(after) > least[k]


@pytest.mark.parametrize("order", [3, 4, 5])
def test_kalman_smoother_keeps_the_jumps_of_stick_slip(order):
    t = times(1200)
    truth, data = stick_slip(t), []
    data = [(t, *noisy(truth, seed=k)) for k in range(3)]
    fitted = KalmanSmoother(order).fit(data)
    results = [fitted(*trial) for trial in data]
    errors = np.concatenate([result[2] - truth[2] for result in results])
    assert rms(errors) < np.std(truth[2]) * 0.05
    jumps = np.flatnonzero(np.abs(np.diff(truth[2])) > 1)
    for result in results:
        for k in jumps:
            assert abs(result[2][k - 2] - truth[2][k - 2]) < 1 and abs(result[2][k + 3] - truth[2][k + 3]) < 1


def test_seeking_jumps_smooths_stick_slip_more_and_a_swing_no_less():
    t = times(1200)
    for truth, factor in ((stick_slip(t), 0.8), (swing(t), 1.02)):
        data = [(t, *noisy(truth, seed=k)) for k in range(3)]
        errors = []
        for threshold in (4.5, None):
            fitted = KalmanSmoother(4, jump_threshold=threshold).fit(data)
            errors.append(rms(np.concatenate([fitted(*trial)[2] - truth[2] for trial in data])))
        assert errors[0] < factor * errors[1]


@pytest.mark.parametrize("make", [KalmanSmoother, KalmanFilter])
def test_fit_finds_the_noise_levels(make):
    ts = [times(960, uneven=0.2, seed=k) for k in range(4)]
    data = [(t, *noisy(swing(t), seed=k)) for k, t in enumerate(ts)]
    fitted = make().fit(data)
    for sigma, signal in zip(fitted.sigmas, swing(ts[0]), strict=False):
        assert sigma == pytest.approx(0.05 * np.std(signal), rel=0.06)


def test_given_noise_levels_are_kept():
    t = times()
    fitted = KalmanSmoother(4).fit([(t, *noisy(swing(t)))], sigmas=(0.1, None, 3.0))
    assert fitted.sigmas[0] == 0.1 and fitted.sigmas[2] == 3.0 and fitted.sigmas[1] != 0


def test_smoothed_signals_are_consistent_with_each_other():
    t = times(960)
    data = (t, *noisy(swing(t)))
    q, v, a, jerk = KalmanSmoother(5).fit([data])(*data)
    for lower, upper in ((q, v), (v, a), (a, jerk)):
        assert rms(np.gradient(lower, t) - upper) < 0.02 * rms(upper)


def test_difference_sigma_ignores_jumps_and_cubics():
    t = times(4000, uneven=0.4)
    smooth = t**3 - 4 * t + np.where(t > 3, 50.0, 0.0)
    y = smooth + 0.01 * np.random.default_rng(0).standard_normal(len(t))
    assert difference_sigma([(t, y)]) == pytest.approx(0.01, rel=0.06)


@pytest.mark.parametrize("order", [3, 4, 5])
@given(cut=st.integers(1, 118), seed=st.integers(0, 9), missing=st.sampled_from([None, 0, 1, 2]))
@few
def test_causal_filter_never_looks_ahead(order, cut, seed, missing):
    t = times(120, uneven=0.5, seed=seed)
    y = [None if k == missing else s for k, s in enumerate(noisy(swing(t), seed))]
    fitted = KalmanFilter(order).fit([(t, *y)])
    later = [None if s is None else np.where(np.arange(len(t)) < cut, s, 7.0) for s in y]
    for first, second in zip(fitted(t, *y), fitted(t, *later), strict=True):
        assert np.array_equal(first[:cut], second[:cut])


@pytest.mark.parametrize("order", [3, 4, 5])
def test_one_sample_updates_equal_the_batch(order):
    t = times(150, uneven=0.4)
    y = noisy(swing(t))
    y[1][20:30] = np.nan
    fitted = KalmanFilter(order).fit([(t, *y)])
    for _ in range(2):
        online = [fitted.update(*(float(s) for s in sample)) for sample in zip(t, *y, strict=True)]
        assert np.allclose(np.transpose(online), fitted(t, *y), rtol=1e-9, atol=1e-9)
        fitted.reset()


def test_only_the_filter_and_backward_differences_are_causal():
    assert not any(smoother.causal for smoother in OFFLINE)
    assert KalmanFilter().causal and NoSmoothing(causal=True).causal
    t = times(50)
    q = np.sin(t)
    whole, part = NoSmoothing(causal=True)(t, q, None, None), NoSmoothing(causal=True)(t[:20], q[:20], None, None)
    assert all(np.array_equal(x[:20], y) for x, y in zip(whole, part, strict=True))


@pytest.mark.parametrize(
    "make",
    [
        lambda t, q: NoSmoothing()(t, None, None, None),
        lambda t, q: NoSmoothing()(t[::-1], q, None, None),
        lambda t, q: SavitzkyGolay()(t, q[:-1], None, None),
        lambda t, q: SavitzkyGolay(window_s=0.0),
        lambda t, q: SavitzkyGolay(order=0),
        lambda t, q: SmoothingSpline(spacing=0),
        lambda t, q: SmoothingSpline()(t[:5], q[:5], None, None),
        lambda t, q: KalmanSmoother(2),
        lambda t, q: KalmanSmoother(jump_threshold=0.0),
        lambda t, q: KalmanSmoother(density=-1.0),
        lambda t, q: KalmanSmoother().fit([(t, q, None, None)], sigmas=(-1.0, None, None)),
        lambda t, q: KalmanSmoother().fit([(t, q, None, None)], sigmas=(1.0,)),
        lambda t, q: KalmanFilter()(t, q, None, None),
        lambda t, q: KalmanFilter().update(0.0, 1.0),
    ],
)
def test_mistakes_are_told_in_one_line(make):
    t = times(50)
    with pytest.raises(UserError) as caught:
        make(t, np.sin(t))
    assert "\n" not in str(caught.value)


def test_update_refuses_a_time_that_does_not_increase():
    t = times(50)
    fitted = KalmanFilter().fit([(t, *noisy(swing(t)))])
    fitted.update(0.0, 1.0)
    with pytest.raises(UserError, match="does not increase"):
        fitted.update(0.0, 1.0)
