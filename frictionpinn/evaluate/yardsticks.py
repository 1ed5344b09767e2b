"""What a model is measured against: the force balance, fitted classical laws, a law with given parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..data.contact import ContactTrial
from ..models import FrictionModel
from ..numerics.paths import InputPath
from ..numerics.simulate import Simulator
from ..numerics.simulation import Simulation
from ..physics import LAWS, System
from ..physics.mechanism import Mechanism
from .force import CoulombFit, CoulombViscousFit, Predictor
from .in_simulation import simulate_model

Online = Callable[[ContactTrial], np.ndarray]
Interval = Callable[[ContactTrial], tuple[np.ndarray, np.ndarray]]
Start = Mapping[str, float]
InSimulation = Callable[[InputPath, Start], Simulation]


@dataclass(frozen=True)
class Candidate:
    """One way to a friction force.

    Attributes:
        label: what people call it.
        online: force, shape (n,), from the causal signals of a trial; None where it has no online form.
        simulate: simulation with this friction in the equation of motion; None where it cannot be simulated.
        interval: lower and upper end of the online force's 95 % interval, shape (n,) each; None where it has none.
    """

    label: str
    online: Online | None = None
    simulate: InSimulation | None = None
    interval: Interval | None = None


def candidates(
    model: FrictionModel,
    system: System,
    train: Sequence[ContactTrial],
    substeps: int,
    integrator: str | None = None,
) -> dict[str, Candidate]:
    """The model first, then its yardsticks, by key.

    Args:
        model: trained.
        system: to be simulated.
        train: the model's training trials, to which the classical laws are fitted.
        substeps, integrator: see :func:`simulate_model`.
    """
    name = model.hparams["name"].upper()
    found = {
        "model": Candidate(
            name,
            online(model),
            lambda path, y0: simulate_model(system, model, path, y0, substeps, integrator),
        )
    }
    if model.physical():
        law = model.hparams["law"]["name"]
        label = f"{LAWS[law].__name__} with {name}'s parameters"
        found["law"] = Candidate(label, simulate=simulated_law(system, law, model.physical()))
    found["force_balance"] = Candidate("force balance", lambda trial: trial.online["friction_force"])
    for fit in (CoulombFit(train), CoulombViscousFit(train)):
        found[fit.law] = Candidate(fit.label, online(fit), simulated_law(system, fit.law, fit.parameters))
    return found


def online(predictor: Predictor) -> Online:
    """The force of anything that predicts a trial."""
    return lambda trial: predictor.predict_trial(trial)["force"]


def simulated_law(system: System, law: str, parameters: Mapping[str, float]) -> InSimulation:
    """Simulation of a law by the compiled simulator."""
    simulator = Simulator(Mechanism(system, LAWS[law]()))
    return lambda path, y0: simulator.simulate(path.t, path, dict(parameters), dict(y0), z0="steady")
