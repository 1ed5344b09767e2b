"""Friction characteristics: the steady force of a model and of a law over slip velocity and normal force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from ..data.contact import BASE, ContactTrial
from ..models import FrictionModel, StateEnsemble, StateModel
from ..numerics.explicit import FORCE, explicit_motion
from ..numerics.torch_functions import numpy_function
from ..physics import CONTACT, FrictionLaw, System
from .instant import WindowedForce


@dataclass(frozen=True)
class Characteristics:
    """Steady friction force over a grid.

    Attributes:
        v: slip velocities, shape (n,).
        N: normal forces, shape (m,).
        model, truth: force, shape (m, n); ``truth`` None where no law is known.
    """

    v: np.ndarray
    N: np.ndarray
    model: np.ndarray
    truth: np.ndarray | None

    @property
    def rms(self) -> float | None:
        """Root mean square difference over the grid, in the unit of force."""
        return None if self.truth is None else float(np.sqrt(np.mean((self.model - self.truth) ** 2)))


def steady_force(law: FrictionLaw, parameters: Mapping[str, float], v: np.ndarray, N: np.ndarray) -> np.ndarray:
    """Force of a law in steady sliding (z' = 0) at slip velocity v and normal force N, arrays that broadcast."""
    force = law.force(CONTACT, law.symbols)
    if law.memory:
        rate = law.bristle_rate(CONTACT, law.symbols)  # linear in z; solve() would turn exp(-x) into an overflow
        settled = -rate.subs(CONTACT.z, 0) / sp.diff(rate, CONTACT.z)
        force = force.subs({CONTACT.z: settled, CONTACT.zdot: 0})
    names = [par.name for par in law.parameters]
    values = [float(parameters.get(par.name, par.value)) for par in law.parameters]  # type: ignore[arg-type]
    function = numpy_function([CONTACT.v, CONTACT.N, *(law.symbols.__dict__[name] for name in names)], force)
    return np.asarray(function(v, N, *values), float)


def characteristics(
    model: FrictionModel,
    system: System,
    train: Sequence[ContactTrial],
    law: FrictionLaw | None,
    parameters: Mapping[str, float],
    grid: int,
) -> Characteristics:
    """The model's force where slip velocity and normal force have long been what they are, beside the law's.

    The grid spans what the training trials cover; the velocity 0, where a steady force is not defined, is left out.
    A model that sees the frictionless acceleration is given the one of steady sliding under the law (0 where no
    law is known).
    """
    reach = max(float(np.abs(trial.offline["v_slip"]).max()) for trial in train)
    loads = np.concatenate([np.abs(trial.offline["normal_force"]) for trial in train])
    v = np.linspace(-reach, reach, grid + grid % 2)
    N = np.linspace(float(loads.min()), float(loads.max()), grid)
    if N[0] == N[-1]:
        N = N[:1]
    slip, load = (column.ravel() for column in np.meshgrid(v, N))
    truth = steady_force(law, parameters, slip, load) if law is not None else None
    shape = (len(N), len(v))
    if isinstance(model, StateModel | StateEnsemble):
        seen = model.friction().steady(slip, load).reshape(shape)
        return Characteristics(v, N, seen, None if truth is None else truth.reshape(shape))
    balanced = np.zeros(slip.shape) if truth is None else truth * mobility(system, train)
    force = WindowedForce(model, 1, 1.0)
    now, rest = dict(zip(BASE, (slip, load, balanced), strict=True)), dict.fromkeys(BASE, np.zeros(slip.shape))
    seen = force(force.constant(now), force.constant(rest), now, rest).reshape(shape)
    return Characteristics(v, N, seen, None if truth is None else truth.reshape(shape))


def mobility(system: System, along: Sequence[ContactTrial] = ()) -> float:
    """Slip acceleration for a unit of force in the contact, where it does not depend on the motion; else 0.

    Of one of several contacts the mean of J M^-1 J^T over the trials ``along``, M the inertia of the free coordinates.
    """
    if system.massless:
        return 0.0
    if len(system.whole.contacts) > 1:
        return _typical_mobility(system, along) if along else 0.0
    slope = -sp.diff(explicit_motion(system).slip_acceleration, FORCE)
    value = slope.subs({par.symbol: system.values[par.name] for par in system.parameters})
    return float(value) if value.is_number else 0.0


def _typical_mobility(system: System, along: Sequence[ContactTrial]) -> float:
    rows = sp.Matrix([system.residual(c) for c in system.free])
    inertia = rows.jacobian([c.symbols[2] for c in system.free])
    J = sp.Matrix([system.jacobian[c.name] for c in system.free])
    motion = [(symbol, name) for c in system.moving for symbol, name in zip(c.symbols, c.signals, strict=True)]
    symbols = [symbol for symbol, _ in motion] + [par.symbol for par in system.parameters]
    function = numpy_function(symbols, (J.T * inertia.LUsolve(J))[0])
    values = [system.values[par.name] for par in system.parameters]
    found = [function(*(trial.smoothed[name] for _, name in motion), *values) for trial in along]
    return float(np.mean(np.concatenate([np.atleast_1d(value) for value in found])))
