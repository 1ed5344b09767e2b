"""A trained network as the friction of a simulated system, whatever past and rates it looks at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..data.contact import BASE
from ..errors import UserError, choose
from ..models import FrictionModel
from ..numerics.explicit import explicit_motion
from ..numerics.neural import ADAPTIVE, integrate_with_network
from ..numerics.paths import InputPath
from ..numerics.simulation import ContactLost, Simulation, SimulationFailed, Steps
from ..physics import LAWS, System
from ..physics.mechanism import Mechanism
from .instant import WindowedForce, callable_force, memoryless

INTEGRATORS = ("bdf2", *ADAPTIVE)
_ITERATIONS, _SETTLED = 60, 1e-6  # Newton steps; force, relative to the model's scale, that counts as zero


def simulate_model(
    system: System,
    model: FrictionModel,
    path: InputPath,
    y0: Mapping[str, float],
    substeps: int,
    integrator: str | None = None,
) -> Simulation:
    """Simulate the system with the network inside its equation of motion.

    bdf2 takes ``substeps`` equal steps per sample: the windows of a model that sees a past reach back over the
    simulated samples, spaced as in training, and the force is found implicitly in every step, so that a network as
    steep as stiction does not limit it. A method of torchdiffeq (explicit, adaptive) simulates memoryless models.

    Args:
        system: gives the equations of motion.
        model: trained; of any variant.
        path: driven coordinates and inputs, sampled at the interval of the model's training data.
        y0: initial position and velocity by signal name; at rest at 0 where not given.
        substeps: steps per sample, at least 1.
        integrator: bdf2, or dopri5, dopri8, bosh3, fehlberg2, adaptive_heun of torchdiffeq; None: dopri5 for a
            memoryless model, which it simulates the most accurately (benchmarks/results/in_simulation.txt), else bdf2.

    Returns:
        a :class:`Simulation`; z and z' are zero.

    Raises:
        ContactLost: the normal force reaches zero.
        SimulationFailed: no force satisfies the equation of motion at some time.
        UserError: an unknown integrator, or an explicit one for a model with a past.
    """
    integrator = integrator or ("dopri5" if memoryless(model) else "bdf2")
    choose(integrator, dict.fromkeys(INTEGRATORS), "integrator")
    if integrator == "bdf2":
        return _March(system, model, path, y0, substeps).run()
    if not memoryless(model):
        raise UserError(
            "a model that sees a past or its bristle's rate is implicit in its force",
            where="integrator",
            received=integrator,
            allowed="bdf2",
            fix="leave integrator=null, or evaluate a memoryless bb1 or bb2",
        )
    found = integrate_with_network(system, callable_force(model), path.t, [path], [y0], method=integrator)
    return found[0] if isinstance(found, list) else found


@dataclass
class _Candidates:
    """States that a step may end in, one for each trial force, and the contact there."""

    y: np.ndarray
    accelerations: np.ndarray
    now: dict[str, np.ndarray]
    slip_acceleration: np.ndarray


class _March:
    """BDF2 over equal substeps; in each, the force F with F = model(state that F leads to) by Newton's method."""

    def __init__(self, system: System, model: FrictionModel, path: InputPath, y0: Mapping[str, float], substeps: int):
        self.mechanism = Mechanism(system, LAWS["coulomb"]())
        self.names = [c.signals[k] for k in (0, 1) for c in self.mechanism.free]
        self.path, self.substeps, self.m = path, substeps, len(self.mechanism.free)
        self.values = [system.values[par.name] for par in system.parameters]
        interval = (path.t[-1] - path.t[0]) / (len(path.t) - 1)
        self.h, self.scale = interval / substeps, float(model.scales["force"])
        self.t = path.t[0] + self.h * np.arange((len(path.t) - 1) * substeps + 1)
        self.u = np.array([path(time) for time in self.t])
        self.friction = WindowedForce(model, substeps, interval)
        self.contact, self.motion = explicit_motion(system).numpy
        n = len(self.t)
        self.y, self.a = np.zeros((n, 2 * self.m)), np.zeros((n, self.m))
        self.y[0] = [float(y0.get(name, 0.0)) for name in self.names]
        self.past = {name: np.zeros(n) for name in BASE}
        self.rates = {name: np.zeros(n) for name in BASE}
        self.force = np.zeros(n)

    def run(self) -> Simulation:
        self._first()
        for k in range(1, len(self.t)):
            self._keep(k, *self._solve(k, 2 * self.force[k - 1] - self.force[max(k - 2, 0)]))
        every = slice(None, None, self.substeps)
        q, v, a = self.y[every, : self.m], self.y[every, self.m :], self.a[every]
        signals = dict(self.path.signals)
        for j, c in enumerate(self.mechanism.free):
            signals.update(zip(c.signals, (q[:, j], v[:, j], a[:, j]), strict=True))
        zero, no_steps = np.zeros(len(q)), Steps(np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 0, 0)))
        slip, normal = self.past["v_slip"][every], self.past["normal_force"][every]
        return Simulation(self.path.t, q, v, a, zero, zero, slip, normal, self.force[every], signals, no_steps)

    def _first(self) -> None:
        """The contact at the start; before it, every signal is taken to have been what it was there."""
        ahead = self._candidates(1, np.zeros(1), frozen=True)
        here = self._candidates(0, np.zeros(1))
        for name in BASE:
            self.past[name][0] = here.now[name][0]
        for name in BASE[1:]:
            self.rates[name][0] = (ahead.now[name][0] - here.now[name][0]) / self.h
        self._keep(0, *self._solve(0, 0.0))

    def _candidates(self, k: int, force: np.ndarray, frozen: bool = False) -> _Candidates:
        """End states of step k under the forces, shape (m,); the state of step 0 is given."""
        m, fixed = self.m, k == 0 or frozen
        y = np.repeat(self.y[max(k - 1, 0)][:, None], len(force), axis=1)
        a = np.zeros((m, len(force)))
        for _ in range(1 if fixed else 3):  # the state enters the accelerations smoothly, if at all
            known = [*y, *self.u[k], *self.values]
            rows = self.motion(force, *known)
            a = np.array([np.broadcast_to(row, force.shape) for row in rows[:-1]]).reshape(m, len(force))
            if not fixed:
                y = self._advance(k, y, a)
        known = [*y, *self.u[k], *self.values]
        now = dict(zip(BASE, (np.broadcast_to(value, force.shape) for value in self.contact(*known)), strict=True))
        if not (now["normal_force"] > 0).all():
            raise ContactLost(self.t[k])
        return _Candidates(y, a, now, np.broadcast_to(self.motion(force, *known)[-1], force.shape))

    def _advance(self, k: int, y: np.ndarray, a: np.ndarray) -> np.ndarray:
        """BDF2, its first step implicit Euler."""
        rate = np.concatenate([y[self.m :], a])
        if k == 1:
            return self.y[0][:, None] + self.h * rate
        return (4 * self.y[k - 1] - self.y[k - 2])[:, None] / 3 + 2 / 3 * self.h * rate

    def _solve(self, k: int, guess: float) -> tuple[float, _Candidates]:
        """Newton's method with a difference quotient, halved where it overshoots, on F - model(F)."""
        x, x_rate = self.friction.of_past(self.past, k), self.friction.of_past(self.rates, k)

        def miss(forces: np.ndarray) -> tuple[np.ndarray, _Candidates]:
            found = self._candidates(k, forces)
            rates = self._rates(k, found)
            if k:
                features = x + self.friction.now(found.now), x_rate + self.friction.now(rates)
            else:  # before the start, everything was what it is there
                features = self.friction.constant(found.now), self.friction.constant(rates)
            return forces - self.friction(*features, found.now, rates), found

        force, step = guess, 1e-6 * self.scale
        values, found = miss(np.array([force, force + step]))
        for _ in range(_ITERATIONS):
            if abs(values[0]) < _SETTLED * self.scale:
                return force, found
            change = -values[0] * step / (values[1] - values[0]) if values[1] != values[0] else -values[0]
            tried = force + change * 0.5 ** np.arange(4)
            trial, both = miss(np.concatenate([tried, tried + step]))
            best = int(np.nanargmin(np.abs(trial[:4]))) if np.isfinite(trial[:4]).any() else 0
            force, pick = float(tried[best]), [best, best + 4]
            values = trial[pick]
            found = _Candidates(
                both.y[:, pick],
                both.accelerations[:, pick],
                {n: v[pick] for n, v in both.now.items()},
                both.slip_acceleration[pick],
            )
        raise SimulationFailed(self.t[k], "no force satisfies the equation of motion", "raise substeps")

    def _rates(self, k: int, found: _Candidates) -> dict[str, np.ndarray]:
        rates = {"v_slip": found.slip_acceleration}
        for name in BASE[1:]:
            held = np.full(found.slip_acceleration.shape, self.rates[name][0])
            rates[name] = (found.now[name] - self.past[name][k - 1]) / self.h if k else held
        return rates

    def _keep(self, k: int, force: float, found: _Candidates) -> None:
        self.force[k], self.y[k], self.a[k] = force, found.y[:, 0], found.accelerations[:, 0]
        for name, values in self._rates(k, found).items():
            self.past[name][k], self.rates[name][k] = found.now[name][0], values[0]
