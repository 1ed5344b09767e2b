"""What a training through the motion takes of the trials: where it cuts them, and whether there is a motion at all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.signal import find_peaks

from ..data.contact import ContactTrial
from ..errors import UserError, choose
from ..physics import System

GATE = 3.0  # noises of the slip velocity above which a contact surely slides, and is corrected by what is measured
THROUGH = ("motion", "balance")
COMPARED = ("velocity", "position")
TRIAL, SEGMENT = 1.0, 2.0  # marks of the samples at which a trial and a segment within it start


def segments(trial: ContactTrial, noise: float) -> np.ndarray:
    """Samples at which a trial is started anew: its first, and where it slides fastest between two slower stretches."""
    speed = np.abs(trial.offline["v_slip"])
    peaks, _ = find_peaks(speed, height=2 * GATE * noise, prominence=2 * GATE * noise)
    return np.array([0, *peaks])


def curved(x: np.ndarray) -> np.ndarray:
    """Samples that have, joined by straight lines, the integral of a smooth curve through x."""
    return x - np.pad(np.diff(x, 2), 1, mode="edge") / 12


def lengths(trials: Sequence[ContactTrial], noise: float) -> list[list[int]]:
    """Samples of every segment, by trial."""
    return [np.diff([*segments(trial, noise), len(trial)]).tolist() for trial in trials]


def through(wanted: Any, moving: bool, scales: dict[str, float]) -> str:
    """What a training goes through: where nothing is said, the motion if the model moves the contact online too."""
    possible = min(scales["mobility"], scales["slip_noise"]) > 0
    if wanted is None:
        return "motion" if moving and possible and scales["force_noise"] > 0 else "balance"
    choose(wanted, dict.fromkeys(THROUGH), "model.loss.through")
    if wanted == "motion" and not possible:
        raise UserError("no motion to train through", where="model.loss.through", received="motion",
                        allowed="balance here: motion wants a contact that friction moves by a constant mobility",
                        fix="leave model.loss.through=null")  # fmt: skip
    return wanted


def compares_position(wanted: Any, trials: Sequence[ContactTrial], system: System) -> bool:
    """Whether a simulated motion is compared with the measured slip position, and not with the slip velocity: where
    nothing is said, if that was derived from it. Then its error is that of a position, differentiated: a step by the
    play of an encoder at a reversal, which hardly moves the position, becomes the largest error of the velocity, and
    looks like friction that rises towards rest."""
    choose("velocity" if wanted is None else wanted, dict.fromkeys(COMPARED), "model.loss.compare")
    told = any(c.signals[0] in trials[0].measured for c in system.free)
    if wanted == "position" and not told:
        raise UserError("no measured position to compare a motion with", where="model.loss.compare",
                        received="position", allowed="velocity where no position is recorded",
                        fix="leave model.loss.compare=null")  # fmt: skip
    return told and trials[0].derived if wanted is None else bool(wanted == "position")
