"""Compensation by the online estimator's force and by a network's, in the same loop."""

from __future__ import annotations

import numpy as np
import pytest
from axes import DELAY, DRIVE, RESOLUTION, TRUTH, gains, plant

from frictionpinn.control import close, reference
from frictionpinn.control.feedback import EstimatorFeedback, NetworkFeedforward
from frictionpinn.control.record import recorded
from frictionpinn.errors import UserError
from frictionpinn.export.portable import PortableModel
from frictionpinn.online import OnlineEstimator, tune

PATH = reference("sine", 5e-3, 1.0)


@pytest.fixture(scope="module")
def feedback() -> EstimatorFeedback:
    loop = close(plant(), gains(), PATH, 1.0, None, (DRIVE, TRUTH), delay=DELAY)
    tuning = tune(DRIVE, recorded({"1": loop}, DRIVE, DELAY, 1000.0), {"x": 3e-7})
    estimator = OnlineEstimator(DRIVE, TRUTH, tuning, share=1.0)
    return EstimatorFeedback(estimator, delay=DELAY, limit=18.0, resolution=RESOLUTION)


def test_the_online_estimators_force_takes_most_of_the_error_away(feedback):
    alone = close(plant(), gains(), PATH, 1.2, None, (DRIVE, TRUTH), delay=DELAY)
    ours = close(plant(), gains(), PATH, 1.2, feedback, (DRIVE, TRUTH), delay=DELAY)
    assert np.std(ours.error[600:]) < 0.4 * np.std(alone.error[600:])


def test_where_the_reference_rests_its_torque_is_a_constant(feedback):
    close(plant(), gains(), PATH, 0.3, feedback, (DRIVE, TRUTH), delay=DELAY)
    rng = np.random.default_rng(0)
    torques = [feedback.update((0.0, 0.0, 0.0), 1e-6 * rng.normal(), rng.normal()).torque for _ in range(50)]
    assert np.ptp(torques) == 0.0


@pytest.mark.parametrize("name", ["interval", "delay", "limit", "resolution", "smoothing"])
@pytest.mark.parametrize("value", [-1.0, np.nan, "1"])
def test_numbers_that_cannot_be_are_refused(feedback, name, value):
    with pytest.raises(UserError, match=f"impossible value: {name}"):
        EstimatorFeedback(feedback.estimator, **{name: value})


def test_a_smoothing_of_no_time_is_refused(feedback):
    with pytest.raises(UserError, match="smoothing is 0"):
        EstimatorFeedback(feedback.estimator, smoothing=0.0)


@pytest.mark.parametrize("name", ["inertia", "normal", "interval", "limit"])
def test_numbers_that_a_network_cannot_have_are_refused(name):
    with pytest.raises(UserError, match=f"impossible value: {name} is 0.0"):
        NetworkFeedforward(network(), **{"inertia": 1.0, "normal": 1.0} | {name: 0.0})


def network() -> PortableModel:
    """A black box whose force is 3 tanh(1000 v), by hand."""
    layers = ((np.array([[1.0]]), np.zeros(1)), (np.array([[1.0]]), np.zeros(1)))
    return PortableModel(
        "bb1", ("v_slip",), 1e-3, {"v_slip": np.array([[1000.0]])}, np.zeros(1), np.ones(1), -np.ones(1), layers,
        "tanh", False, 3.0, None, {}, {}, "", 1.0, DRIVE.system,
    )  # fmt: skip


def test_a_network_adds_its_force_along_the_reference():
    compensator = NetworkFeedforward(network(), inertia=1.0, normal=1.0, limit=2.5)
    for v in (-1e-3, 0.0, 5e-4):
        assert compensator.update((0.0, v, 0.0), np.nan, 0.0).torque == pytest.approx(3 * np.tanh(1000 * v), abs=1e-9)
    assert compensator.update((0.0, 0.1, 0.0), np.nan, 0.0).torque == 2.5


def test_a_network_of_another_rate_is_refused():
    with pytest.raises(UserError, match="network of another rate"):
        NetworkFeedforward(network(), inertia=1.0, normal=1.0, interval=7e-4)
