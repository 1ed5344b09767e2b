"""A closed loop's log as a recording: the equation of motion holds between what it says."""

from __future__ import annotations

import numpy as np
import pytest
from axes import DELAY, DRIVE, TRUTH, gains, plant

from frictionpinn.control import close, reference
from frictionpinn.control.record import recorded
from frictionpinn.errors import UserError


def test_positions_and_torques_of_the_same_time_obey_the_equation_of_motion():
    loop = close(plant(), gains(), reference("sine", 5e-3, 1.0), 2.0, None, (DRIVE, TRUTH), delay=DELAY)
    (trial,) = recorded({"run": loop}, DRIVE, DELAY, 100.0).trials
    friction = np.interp(trial.t, loop.t, loop.friction)
    a = np.gradient(np.gradient(trial.signals["x"], trial.t), trial.t)
    left = trial.signals["force"] - friction - TRUTH["M"] * a
    smooth = np.abs(np.gradient(friction, trial.t)) < 20
    assert trial.name == "run" and len(trial.t) == 200
    assert np.std(left[smooth][5:-5]) < 0.05 * np.std(friction)


@pytest.mark.parametrize("rate", [0.0, 5000.0, 15.0, None])
def test_an_impossible_rate_is_refused(rate):
    loop = close(plant(), gains(), reference("sine", 5e-3, 1.0), 0.1, None, (DRIVE, TRUTH), delay=DELAY)
    with pytest.raises(UserError, match="rate_hz"):
        recorded({"1": loop}, DRIVE, DELAY, rate)
