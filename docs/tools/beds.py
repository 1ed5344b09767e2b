"""Where the gallery shows effects: systems in motion, and how a declared model is fitted to what they record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import least_squares

import frictionpinn as fp
from frictionpinn.data.recording import Recording
from frictionpinn.data.simulated import simulate_trials
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics.friction import CONTACT_LAWS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.scan import data_scales

LAWS_IN_ORDER = (
    "coulomb_viscous",
    "coulomb",
    "stribeck",
    "dahl",
    *CONTACT_LAWS,
)  # the simplest in which an effect can act
NOISE = 0.01  # of the signal shown, standard deviation over its own


@dataclass(frozen=True)
class Bed:
    """A system in motion: its trials, their rate, the law's parameters there, and the signal that is looked at."""

    system: str
    imposed: bool
    trials: tuple[Mapping[str, object], ...]
    rate_hz: float
    values: Mapping[str, float]
    shown: str

    def mechanism(self, law: str, effects: tuple[str, ...] = ()) -> Mechanism:
        """The mechanism with a law and effects."""
        return _made(self.system, self.imposed, law, effects)

    def truth(self, law: str) -> dict[str, float]:
        """The law's parameters that have no default."""
        return {par.name: self.values[par.name] for par in CONTACT_LAWS[law].parameters if par.value is None}

    def record(self, mechanism: Mechanism, values: Mapping[str, float]) -> Recording:
        """What the sensors of the mechanism show, without noise."""
        return simulate_trials(mechanism, values, self.trials, self.rate_hz)


def trials(duration: float, *each: Mapping[str, object]) -> tuple[Mapping[str, object], ...]:
    """Trials of the same length."""
    return tuple({"duration": duration, **trial} for trial in each)


DRY = {"mu_c": 3.0, "mu_s": 4.5, "v_s": 0.05, "sigma_0": 3e3, "sigma_1": 10.0, "sigma_2": 4.0}
SMALL = DRY | {"mu_c": 0.3, "mu_s": 0.45, "sigma_2": 0.4}
STROKES = ("0.05*sin(4*t)", "0.05*sin(7*t)", "0.03*sin(3*t) + 0.02*sin(9*t)")
SWINGS = ("0.9*sin(4*t)", "1.1*sin(6*t)", "0.6*sin(3*t) + 0.5*sin(8*t)")
# The motion of the first two is imposed: what is predicted, and shown, is then the force ("0": nothing else acts).
BEDS = (
    Bed("drive", True, trials(3.0, *({"x": path, "force": "0"} for path in STROKES)), 200.0, DRY, "force"),
    Bed("pendulum", True, trials(3.0, *({"theta": path, "tau": "0"} for path in SWINGS)), 200.0, SMALL, "tau"),
    Bed("drive", False, trials(3.0, {"force": "9*sin(5*t)"}, {"force": "12*sin(7*t)"}, {"force": "10*sin(4*t)"}), 200.0,
        DRY, "a"),
    Bed("sdob", False,
        trials(3, *({"y": f"0.2346 + 0.025*sin(12.2*t + {k})", "force": f"{9 + k}*sin({4 + k}*t)"} for k in range(3))),
        200.0, SMALL, "a"),
)  # fmt: skip


@cache
def _made(system: str, imposed: bool, law: str, effects: tuple[str, ...]) -> Mechanism:
    return Mechanism(fp.system(system, imposed=imposed), CONTACT_LAWS[law](), effects)


@cache
def simulator(mechanism: Mechanism) -> Simulator:
    """The compiled mechanism."""
    return Simulator(mechanism)


def inputs(mechanism: Mechanism, signals: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Of a trial's signals those that a simulation is given."""
    return {name: signals[name] for name in mechanism.input_signals if name in signals}


def fitted(
    mechanism: Mechanism, recording: Recording, start: Mapping[str, float], known: Mapping[str, float], shown: str
) -> list[np.ndarray]:
    """Residuals of the shown signal by trial, model minus measurement, after the law's parameters were fitted."""
    known = {name: value for name, value in known.items() if name in simulator(mechanism).parameter_names}
    names, scale = list(start), np.array(list(start.values()))

    def residuals(x: np.ndarray) -> list[np.ndarray]:
        return predicted_less(mechanism, recording, known | dict(zip(names, x * scale, strict=True)), shown)

    if not names:
        return residuals(scale)
    best = least_squares(lambda x: np.concatenate(residuals(x)), np.ones(len(names)), bounds=(1e-3, 1e3),
                         diff_step=1e-3, max_nfev=40)  # fmt: skip
    return residuals(best.x)


def predicted_less(
    mechanism: Mechanism, recording: Recording, values: Mapping[str, float], shown: str
) -> list[np.ndarray]:
    """Model minus measurement of the shown signal, by trial."""
    found = []
    for trial in recording.trials:
        run = simulator(mechanism).simulate(trial.t, inputs(mechanism, trial.signals), values)
        found.append(run.signals[shown] - trial.signals[shown])
    return found


def scales_of(recording: Recording) -> dict[str, tuple[float, float]]:
    """What the hidden parameters of effects are measured by."""
    told = [trial.truth | trial.signals for trial in recording.trials]
    position = [np.asarray(next(iter(trial.signals.values()))) for trial in recording.trials]
    return data_scales([trial.t for trial in recording.trials], position, [t["v_slip"] for t in told],
                       [np.broadcast_to(t["normal_force"], t["v_slip"].shape) for t in told])  # fmt: skip
