"""What a model is measured against: the force balance, fitted classical laws, a law with given parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..data.contact import ContactTrial
from ..models import FrictionModel
from ..models.in_motion import InMotion
from ..numerics.paths import InputPath
from ..numerics.simulate import Simulator
from ..numerics.simulation import Simulation
from ..physics import LAWS, System
from ..physics.mechanism import Mechanism
from .force import CoulombFit, CoulombViscousFit, Predictor
from .in_motion import simulate_in_motion
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
    in_motion: InMotion | None = None,
) -> dict[str, Candidate]:
    """The model first, then its yardsticks, by key.

    Args:
        model: trained.
        system: to be simulated.
        train: the model's training trials, to which the classical laws are fitted.
        substeps, integrator: see :func:`simulate_model`.
        in_motion: the model's friction in motion, which is then what is simulated.
    """
    name = model.hparams["name"].upper()

    def as_trained(path: InputPath, y0: Start) -> Simulation:
        return simulate_model(system, model, path, y0, substeps, integrator)

    found = {"model": Candidate(name, online(model), as_trained)}
    if in_motion is not None:
        sharp = in_motion
        found["model"] = Candidate(name, online(model), lambda path, y0: simulate_in_motion(system, sharp, path, y0))
        found["as_trained"] = Candidate(f"{name} without the fit in motion", simulate=as_trained)
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
