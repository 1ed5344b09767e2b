"""Simulation of a system with a network's friction in motion, the bristle a state where there is one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.integrate import odeint

from ..models.elements import StateFriction
from ..models.in_motion import InMotion
from ..numerics.explicit import explicit_motion
from ..numerics.paths import InputPath
from ..numerics.simulation import ContactLost, Simulation, SimulationFailed, Steps
from ..physics import LAWS, System
from ..physics.mechanism import Mechanism

RTOL, ATOL, ATOL_BRISTLE = 1e-6, 1e-8, 1e-11
MOST = 100_000  # steps of the integrator per sample: a failure ends
LONGEST = 0.8  # step, in samples: a rest must not hide the end of it


def simulate_in_motion(
    system: System, friction: InMotion | StateFriction, path: InputPath, y0: Mapping[str, float]
) -> Simulation:
    """Integrate positions, velocities and bristles by LSODA (stiff and non-stiff methods in turn, Petzold 1983).

    Args:
        system: gives the equations of motion.
        friction: of a trained model, see :class:`InMotion` and :class:`StateFriction`.
        path: driven coordinates and inputs.
        y0: initial position and velocity by signal name; at rest at 0 where not given. Bristles begin as steady sliding
            leaves them, at rest unbent.

    Raises:
        ContactLost: the normal force reaches zero.
        SimulationFailed: the integrator gives up.
    """
    mechanism = Mechanism(system, LAWS["coulomb"]())
    m, t = len(mechanism.free), path.t
    contact, motion = explicit_motion(system).numpy
    values = [system.values[par.name] for par in system.parameters]

    def rates(time: float, y: np.ndarray, u: np.ndarray | None = None) -> tuple[list[float], tuple[float, ...]]:
        """State rate; slip velocity, normal force and friction force."""
        u = path(min(time, t[-1])) if u is None else u
        moves = [*y[: 2 * m].tolist(), *u.tolist(), *values]  # numpy's numbers are several times slower, one by one
        v_slip, normal = (float(value) for value in contact(*moves)[:2])
        if normal <= 0:
            raise ContactLost(time)
        force, *bristles = friction.rates(v_slip, normal, y[2 * m :]).tolist()
        a = [float(value) for value in motion(force, *moves)[:m]]
        return [*moves[m : 2 * m], *a, *bristles], (v_slip, normal, force)

    start = [float(y0.get(c.signals[k], 0.0)) for k in (0, 1) for c in mechanism.free]
    v_slip, normal = (float(value) for value in contact(*start, *path.samples[0].tolist(), *values)[:2])
    start += friction.settled(v_slip, normal).tolist()
    y, told = odeint(
        lambda time, y: rates(time, y)[0], start, t, tfirst=True, rtol=RTOL, full_output=True, mxstep=MOST,
        atol=[*[ATOL] * (2 * m), *[ATOL_BRISTLE] * friction.states], hmax=LONGEST * float(np.median(np.diff(t))),
    )  # fmt: skip
    if told["message"] != "Integration successful." or not np.isfinite(y).all():
        raise SimulationFailed(float(told["tcur"].max()), told["message"], "evaluate another run")
    rows = [rates(*row) for row in zip(t, y, path.samples, strict=True)]
    rate, (slip, normal, force) = np.array([row[0] for row in rows]), np.array([row[1] for row in rows]).T
    q, v, a = y[:, :m], y[:, m : 2 * m], rate[:, m : 2 * m]
    signals = dict(path.signals)
    for j, c in enumerate(mechanism.free):
        signals.update(zip(c.signals, (q[:, j], v[:, j], a[:, j]), strict=True))
    no_steps = Steps(np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 0, 0)))
    return Simulation(t, q, v, a, y[:, 2 * m], rate[:, 2 * m], slip, normal, force, signals, no_steps)
