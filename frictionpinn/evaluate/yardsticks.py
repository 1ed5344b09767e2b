"""What a model is measured against: the force balance, fitted classical laws, a law with given parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..data.contact import ContactTrial
from ..errors import choose
from ..models import FrictionModel, StateEnsemble, StateModel
from ..models.in_motion import InMotion
from ..numerics.paths import InputPath
from ..numerics.simulate import Simulator
from ..numerics.simulation import ContactLost, Simulation, SimulationFailed
from ..physics import LAWS, System
from ..physics.base import at_contact
from ..physics.contacts import law_named
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
    if isinstance(model, StateModel | StateEnsemble):
        choose(integrator or "bdf2", {"bdf2": "the only one for a network with memory"}, "integrator")
        numbers = model.friction()
        found["model"] = Candidate(name, online(model), lambda path, y0: simulate_in_motion(system, numbers, path, y0))
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


def simulated_law(system: System, law: str | Mapping[str, str], parameters: Mapping[str, float]) -> InSimulation:
    """Simulation of a law, or of one for each contact, by the compiled simulator."""
    simulator = Simulator(Mechanism(system, law_named(law, "friction")))  # type: ignore[arg-type]
    return lambda path, y0: simulator.simulate(path.t, path, dict(parameters), dict(y0), z0="steady")


class Joint:
    """A simulation with the friction of all contacts, made once for each trajectory: every contact takes its part."""

    def __init__(self, simulate: InSimulation):
        self.simulate = simulate
        self._made: dict[int, tuple[InputPath, Simulation | Exception]] = {}

    def _of(self, path: InputPath, y0: Start) -> Simulation:
        if id(path) not in self._made:
            try:
                self._made[id(path)] = path, self.simulate(path, y0)
            except (ContactLost, SimulationFailed) as error:
                self._made[id(path)] = path, error
        found = self._made[id(path)][1]
        if isinstance(found, Exception):
            raise found
        return found

    def at(self, contact: str) -> InSimulation:
        """The simulation as one contact sees it."""
        return lambda path, y0: self._of(path, y0).at(contact)


def candidates_at_contacts(
    model: FrictionModel, system: System, train: Sequence[ContactTrial]
) -> dict[str, dict[str, Candidate]]:
    """Contact -> the model's map first, then its yardsticks, by key; in simulation the frictions of all contacts act.

    Args:
        model: of several contacts.
        system: with all of them; those that the model has no map of have no friction.
        train: the model's training trials, to which the classical laws are fitted.
    """
    name, none = model.hparams["name"].upper(), {contact.name: "none" for contact in system.contacts}
    found: dict[str, dict[str, Candidate]] = {}
    for contact in model.contacts:
        found[contact] = {"model": Candidate(name, online(model.map_of(contact)))}
    if model.physical():
        laws = {contact: model.map_of(contact).hparams["law"]["name"] for contact in model.contacts}
        joint = Joint(simulated_law(system, none | laws, model.physical()))
        for contact, law in laws.items():
            found[contact]["law"] = Candidate(f"{LAWS[law].__name__} with {name}'s parameters", None, joint.at(contact))
    for table in found.values():
        table["force_balance"] = Candidate("force balance", lambda trial: trial.online["friction_force"])
    for kind in (CoulombFit, CoulombViscousFit):
        fits = {contact: kind([trial.at(contact) for trial in train]) for contact in found}
        values = {at_contact(c, key): value for c, fit in fits.items() for key, value in fit.parameters.items()}
        joint = Joint(simulated_law(system, none | dict.fromkeys(fits, kind.law), values))
        for contact, fit in fits.items():
            found[contact][fit.law] = Candidate(fit.label, online(fit), joint.at(contact))
    return found
