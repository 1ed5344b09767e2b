"""Force errors of a model, and of a fitted baseline, on trials that it never saw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ..data.contact import ContactTrial
from ..numerics.torch_functions import numpy_function
from ..physics import CONTACT, LAWS


class Predictor(Protocol):
    """Anything that predicts the friction force along a trial."""

    def predict_trial(self, trial: ContactTrial, source: str = "online") -> dict[str, np.ndarray]: ...


def reference_force(trial: ContactTrial) -> tuple[np.ndarray, str]:
    """The force to compare with: the true one of simulated data, else the one that the equation of motion implies."""
    if "friction_force" in trial.truth:
        return trial.truth["friction_force"], "true friction force"
    return trial.offline["friction_force"], "friction force implied by the equation of motion"


def force_errors(model: Predictor, trials: Sequence[ContactTrial], source: str = "online") -> dict[str, object]:
    """Mean square and root mean square error of the force over all samples of the trials, and by trial.

    Returns:
        ``mse`` (N^2 or (N m)^2), ``rmse`` and ``reference_rms`` (N or N m), ``relative`` (root mean square error over
        that of the reference), ``reference`` (what was compared with), ``by_trial`` (name -> rmse).
    """
    errors, references, by_trial = [], [], {}
    for trial in trials:
        reference, label = reference_force(trial)
        error = model.predict_trial(trial, source)["force"] - reference
        errors.append(error)
        references.append(reference)
        by_trial[trial.name] = float(np.sqrt(np.mean(error**2)))
    mse = float(np.mean(np.concatenate(errors) ** 2))
    scale = float(np.sqrt(np.mean(np.concatenate(references) ** 2)))
    return {
        "mse": mse,
        "rmse": mse**0.5,
        "relative": mse**0.5 / scale if scale > 0 else float("inf"),
        "reference_rms": scale,
        "reference": label,
        "by_trial": by_trial,
    }


class LawFit:
    """A law that is linear in all parameters but its transition velocity v_t, fitted by least squares.

    Fitted to the implied force of the training trials; v_t is the best of a grid from the slowest to the typical
    slip velocities. Subclasses name the law and its linear parameters.
    """

    law: str
    label: str
    linear: tuple[str, ...]

    def __init__(self, trials: Sequence[ContactTrial]):
        law = LAWS[self.law]()
        symbols = [CONTACT.v, CONTACT.N, *(par.symbol for par in law.parameters)]
        self._force = numpy_function(symbols, law.force(CONTACT, law.symbols))
        v, N, F = (
            np.concatenate([trial.offline[key] for trial in trials])
            for key in ("v_slip", "normal_force", "friction_force")
        )
        speed = float(np.sqrt(np.mean(v**2))) or 1.0
        units = np.eye(len(self.linear))
        best = (np.inf, np.zeros(len(self.linear)), speed)
        for v_t in speed * np.logspace(-4, 0, 25):
            design = np.stack([self._force(v, np.abs(N), *unit, v_t) for unit in units], axis=1)
            values, *_ = np.linalg.lstsq(design, F, rcond=None)
            misfit = float(np.mean((design @ values - F) ** 2))
            if misfit < best[0]:
                best = (misfit, values, float(v_t))
        self.parameters = dict(zip(self.linear, best[1].tolist(), strict=True)) | {"v_t": best[2]}

    def predict_trial(self, trial: ContactTrial, source: str = "online") -> dict[str, np.ndarray]:
        """Force along a trial from its (online) slip velocity and normal force."""
        signals = getattr(trial, source)
        return {"force": self._force(signals["v_slip"], np.abs(signals["normal_force"]), *self.parameters.values())}


class CoulombFit(LawFit):
    """F = mu_c N tanh(v / v_t): what most simulators offer."""

    law, label, linear = "coulomb", "Coulomb fit", ("mu_c",)


class CoulombViscousFit(LawFit):
    """F = mu_c N tanh(v / v_t) + sigma_2 v: the customary first model, and the yardstick beside every network."""

    law, label, linear = "coulomb_viscous", "Coulomb + viscous fit", ("mu_c", "sigma_2")
