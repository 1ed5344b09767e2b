"""What a closed loop logged, as a recording that friction can be identified from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..data.recording import Recording, Trial
from ..errors import UserError
from ..online.check import finite
from ..physics.mechanism import Mechanism
from .compensator import actuator, check_axis
from .loop import Loop


def recorded(loops: Mapping[str, Loop], mechanism: Mechanism, delay: float = 0.0, rate_hz: float = 250.0) -> Recording:
    """The encoder's positions and the torques that acted, averaged to a lower rate, a trial for every loop.

    A torque acts ``delay`` after it was commanded and is then held for a cycle; positions and torques are averaged over
    the same stretches of time, so that the equation of motion holds between their means.

    Args:
        loops: by the name that the trial is to have.
        mechanism: the axis, which names the signals.
        delay: from a command to its effect, s.
        rate_hz: of the recording; the nearest to it at which a sample is a whole number of cycles.

    Raises:
        UserError: no axis, or a rate above that of the loop or without two samples of it.
    """
    check_axis(mechanism)
    (coordinate,), trials = mechanism.free, []
    units = mechanism.system.signal_units
    for name, loop in loops.items():
        h = float(loop.t[1] - loop.t[0])
        least = 2 / (len(loop.t) * h)  # two samples
        if not (finite(rate_hz) and least <= rate_hz <= 1.001 / h):
            raise UserError("impossible rate", where="rate_hz", received=rate_hz,
                            allowed=f"{least:.3g} to {1 / h:g} Hz")  # fmt: skip
        step = min(round(1 / (rate_hz * h)), len(loop.t) // 2)
        n = len(loop.t) // step
        whole = int(delay / h)
        part = delay / h - whole  # during a cycle, so much of it the command of one more cycle ago acts
        earlier = [np.concatenate([np.zeros(back), loop.torque])[: len(loop.torque)] for back in (whole, whole + 1)]
        acted = (1 - part) * earlier[0] + part * earlier[1]
        middle = np.append(
            (loop.reading[1:] + loop.reading[:-1]) / 2, loop.reading[-1]
        )  # of the cycle, as the torque's
        signals = {coordinate.signals[0]: middle, actuator(mechanism): acted}
        means = {key: values[: n * step].reshape(n, step).mean(axis=1) for key, values in signals.items()}
        trials.append(Trial(name, (np.arange(n) + 0.5) * step * h, means))
    return Recording(tuple(trials), {key: units[key] for key in signals})
