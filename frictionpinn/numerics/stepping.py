"""One integration of a mechanism's equations over a path, and what its solution shows."""

from __future__ import annotations

import logging
from functools import cache
from types import ModuleType

import numpy as np

from ..errors import UserError
from .codegen import Kernels, pointer
from .paths import InputPath
from .simulation import ContactLost, Simulation, SimulationFailed, Steps
from .tableau import METHOD

log = logging.getLogger(__name__)

# How closely a stage is solved, in what a step may err: for a motion, for sensitivities (they hold where R = 0 holds),
# and for steps that are taken as they were.
PLAIN, STRICT, REPEATED = 1e-2, 1e-5, 1e-12
_NO_STEPS = Steps(np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 0, 0)))


@cache
def _integrator() -> ModuleType:
    """Import on first use: a new installation compiles the integrator then, for all mechanisms at once."""
    log.debug("loading the integrator: the first time on an installation takes about 15 s")
    from . import integrator

    return integrator


def _same_times(steps: Steps, t: np.ndarray) -> bool:
    intervals, n = np.diff(t), len(t) - 1
    if not len(steps) or steps.interval.max() >= n or (np.diff(steps.interval) < 0).any():
        return False
    return np.allclose(np.bincount(steps.interval, steps.size[:, 1], n), intervals, rtol=1e-9)


def integrate_path(
    kernels: Kernels,
    path: InputPath,
    p: np.ndarray,
    start: np.ndarray,
    errors: tuple[float, float, float],
    steps: Steps | None,
) -> tuple[np.ndarray, np.ndarray, Steps]:
    """States (n, n_s) and unknowns (n, n_w) at the samples of a path, and the steps taken.

    Args:
        path: as it acts.
        p: parameter vector, shape (n_p,).
        start: initial state, shape (n_s,).
        errors: rtol, atol and how closely a stage is solved.
        steps: to take instead of choosing any.

    Raises:
        ContactLost, SimulationFailed, UserError: see :meth:`Simulator.simulate`.
    """
    (n_s, n_w, _, _), n, m = kernels.sizes, len(path.t), len(kernels.mechanism.free)
    if n_w == 0:
        return np.zeros((n, 0)), np.zeros((n, 0)), _NO_STEPS
    if steps is not None and not _same_times(steps, path.t):
        raise UserError("steps of a simulation of other times", where="steps", fix="record them on the same times")
    core, (rtol, atol, tolerance) = _integrator(), errors
    limits = np.full(n_s, atol * min(2.5e-3, (path.t[-1] - path.t[0]) / (n - 1)))
    limits[m : 2 * m] = atol
    taken = steps or _NO_STEPS
    status, time, states, unknowns, interval, size, stages = core.integrate(
        pointer(kernels.plain.newton),
        METHOD.a,
        METHOD.c,
        METHOD.error,
        METHOD.order_error,
        path.t,
        path.coefficients,
        p,
        m,
        limits,
        kernels.places,
        rtol,
        REPEATED if steps else tolerance,
        start,
        taken.interval,
        taken.size,
    )
    if status == core.CONTACT_LOST:
        raise ContactLost(time, len(interval))
    if status == core.NOT_CONVERGED or not np.isfinite(states).all():
        fix = "check the parameters and inputs there"
        raise SimulationFailed(time, "Newton's method did not converge", fix, len(interval))
    if status != core.OK:
        fix = "loosen rtol and atol, or smooth the inputs"
        raise SimulationFailed(time, "the step became too small", fix, len(interval))
    return states, unknowns, Steps(interval, size, stages)


def observed(
    kernels: Kernels,
    path: InputPath,
    recorded: InputPath,
    p: np.ndarray,
    states: np.ndarray,
    unknowns: np.ndarray,
    steps: Steps,
) -> Simulation:
    """What a solution shows, before any sensor.

    Raises:
        ContactLost: the normal force is not above zero at every sample.
    """
    mechanism, m, count = kernels.mechanism, len(kernels.mechanism.free), len(kernels.mechanism.contacts)
    kernel = pointer(kernels.plain.outputs)
    outputs = _integrator().evaluate_samples(kernel, states, unknowns, path.samples, p, kernels.outputs)
    v_slip, normal, friction = (outputs[:, k : 3 * count : 3] for k in range(3))
    if not (normal > 0).all():
        raise ContactLost(path.t[int(np.argmin((normal > 0).all(axis=1)))], len(steps))
    q, v, a = states[:, :m], states[:, m : 2 * m], unknowns[:, :m]
    z, zdot = np.zeros((2, len(path.t), count))
    for place, k in enumerate(kernels.bristles, -len(kernels.bristles)):
        z[:, k], zdot[:, k] = states[:, place], unknowns[:, place]
    signals = dict(recorded.signals)
    for j, c in enumerate(mechanism.free):
        signals.update(zip(c.signals, (q[:, j], v[:, j], a[:, j]), strict=True))
    required = outputs[:, -1] if mechanism.system.massless else None
    if required is not None:
        signals |= dict.fromkeys(mechanism.predictions, required)
    at_contacts = (z, zdot, v_slip, normal, friction)
    z, zdot, v_slip, normal, friction = (values[:, 0] for values in at_contacts) if count == 1 else at_contacts
    return Simulation(
        path.t, q, v, a, z, zdot, v_slip, normal, friction, signals, steps, states, unknowns, contacts=kernels.contacts,
        required=required,
    )  # fmt: skip
