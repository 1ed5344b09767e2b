"""Simulation of a system with a network's friction in motion, the bristle a state where there is one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp

from ..models.elements import StateFriction
from ..models.in_motion import InMotion
from ..numerics.explicit import explicit_motion
from ..numerics.paths import InputPath
from ..numerics.simulation import ContactLost, Simulation, SimulationFailed, Steps
from ..physics import LAWS, System
from ..physics.mechanism import Mechanism

RTOL, ATOL, ATOL_BRISTLE = 1e-6, 1e-8, 1e-11
LONGEST = 0.8  # step, in samples: a rest must not hide the end of it


def simulate_in_motion(
    system: System, friction: InMotion | StateFriction, path: InputPath, y0: Mapping[str, float]
) -> Simulation:
    """Integrate positions, velocities and bristles by LSODA (stiff and non-stiff methods in turn).

    Args:
        system: gives the equations of motion.
        friction: of a trained model, see :class:`InMotion` and :class:`StateFriction`.
        path: driven coordinates and inputs.
        y0: initial position and velocity by signal name; at rest at 0 where not given.

    Raises:
        ContactLost: the normal force reaches zero.
        SimulationFailed: the integrator gives up.
    """
    mechanism = Mechanism(system, LAWS["coulomb"]())
    m, t = len(mechanism.free), path.t
    contact, motion = explicit_motion(system).numpy
    values = [system.values[par.name] for par in system.parameters]

    def rates(y: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[float, ...]]:
        """State rate; accelerations; slip velocity, normal force, friction force and bristle rate."""
        v_slip, normal = (float(value) for value in contact(*y[: 2 * m], *u, *values)[:2])
        force, *bristles = friction.rates(v_slip, abs(normal), y[2 * m :])
        a = np.array(motion(force, *y[: 2 * m], *u, *values)[:m], float)
        return np.concatenate([y[m : 2 * m], a, bristles]), a, (v_slip, normal, force, bristles[0])

    def unloads(time: float, y: np.ndarray) -> float:
        return float(contact(*y[: 2 * m], *path(time), *values)[1])

    unloads.terminal = True  # type: ignore[attr-defined]
    start = [float(y0.get(c.signals[k], 0.0)) for k in (0, 1) for c in mechanism.free]
    start += [0.0] * friction.states
    found = solve_ivp(
        lambda time, y: rates(y, path(min(time, t[-1])))[0], (t[0], t[-1]), start, "LSODA", t_eval=t, events=unloads,
        rtol=RTOL, atol=[*[ATOL] * (2 * m), *[ATOL_BRISTLE] * friction.states],
        max_step=LONGEST * float(np.median(np.diff(t))),
    )  # fmt: skip
    if found.status == 1:
        raise ContactLost(float(found.t_events[0][0]))
    if found.status != 0 or not np.isfinite(found.y).all():
        raise SimulationFailed(float(found.t[-1]), found.message, "evaluate another run")
    y = found.y.T
    rows = [rates(state, u)[1:] for state, u in zip(y, path.samples, strict=True)]
    q, v, a = y[:, :m], y[:, m : 2 * m], np.array([row[0] for row in rows])
    slip, normal, force, bristle = np.array([row[1] for row in rows]).T
    signals = dict(path.signals)
    for j, c in enumerate(mechanism.free):
        signals.update(zip(c.signals, (q[:, j], v[:, j], a[:, j]), strict=True))
    no_steps = Steps(np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 0, 0)))
    return Simulation(t, q, v, a, y[:, 2 * m], bristle, slip, normal, force, signals, no_steps)
