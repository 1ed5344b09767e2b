"""Sensitivities of a finished simulation, from the steps that it recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..physics.mechanism import Mechanism
from .bristle import resting_states, steady_bristle
from .codegen import Kernels, pointer
from .paths import Directions, InputPath
from .simulation import Steps
from .tableau import METHOD


@dataclass(frozen=True)
class Wanted:
    """What a simulation is differentiated with respect to.

    Attributes:
        names: in order, the directions last.
        columns: index of the parameter that each is, or -1, shape (n_sens,).
        states: index of the initial state that each is, or -1, shape (n_sens,).
        directions: derivatives of the input path, for the last entries (there in the order of their support).
    """

    names: tuple[str, ...]
    columns: np.ndarray
    states: np.ndarray
    directions: Directions


def differentiate(
    kernels: Kernels,
    path: InputPath,
    p: np.ndarray,
    states: np.ndarray,
    unknowns: np.ndarray,
    steps: Steps,
    wanted: Wanted,
    steady: bool,
    contact: bool = True,
) -> dict[str, np.ndarray]:
    """Return name -> derivatives, shape (n, n_sens), as in ``Simulation.sensitivities``.

    The steps are held; apart from that the derivatives are exact. ``steady`` says that the initial bristle state was
    ``steady_bristle`` and moves with the parameters; without ``contact``, slip velocity, normal and friction force
    are left out.
    """
    from . import sensitivity  # compiles on a new installation: not before it is needed

    mechanism, m, n = kernels.mechanism, len(kernels.mechanism.free), len(path.t)
    n_s, n_w, _, _ = kernels.sizes
    given = wanted.directions
    ds, dw = np.zeros((n, n_s, len(wanted.names))), np.zeros((n, n_w, len(wanted.names)))
    if n_w:
        start = start_sensitivity(kernels, path.coefficients[0, :, 0], p, states[0], wanted, steady)
        ds, dw = sensitivity.propagate(
            pointer(kernels.sensitivity.parameters),
            METHOD.a,
            METHOD.c,
            path.t,
            path.coefficients,
            p,
            m,
            states[0],
            unknowns[0],
            start,
            wanted.columns,
            given.coefficients,
            given.support,
            steps.interval,
            steps.size,
            steps.unknowns,
        )
    outputs = None
    if contact:
        kernel = pointer(kernels.sensitivity.output_derivatives)
        outputs = sensitivity.output_sensitivities(
            kernel, states, unknowns, path.samples, p, ds, dw, wanted.columns, given.samples, given.support, 3
        )
    if not np.array_equal(given.order, np.arange(len(given.order))):
        first = len(wanted.names) - len(given)
        as_given = np.concatenate([np.arange(first), first + given.order])
        ds, dw = ds[:, :, as_given], dw[:, :, as_given]
        outputs = None if outputs is None else outputs[:, :, as_given]
    return named(mechanism, ds, dw, outputs)


def named(mechanism: Mechanism, ds: np.ndarray, dw: np.ndarray, outputs: np.ndarray | None) -> dict[str, np.ndarray]:
    """Derivatives of states, their rates and (slip velocity, normal force, friction force), all (n, ..., n_sens), by
    what they are derivatives of."""
    m, zero = len(mechanism.free), np.zeros((len(ds), ds.shape[2]))
    result = {} if outputs is None else dict(zip(("v_slip", "N", "F"), np.moveaxis(outputs, 1, 0), strict=True))
    result["z"], result["zdot"] = (ds[:, -1], dw[:, -1]) if mechanism.memory else (zero, zero)
    for j, coordinate in enumerate(mechanism.free):
        result.update(zip(coordinate.signals, (ds[:, j], ds[:, m + j], dw[:, j]), strict=True))
    return result


def start_sensitivity(
    kernels: Kernels, u: np.ndarray, p: np.ndarray, start: np.ndarray, wanted: Wanted, steady: bool
) -> np.ndarray:
    """Derivative of the initial state, shape (n_s, n_sens).

    That of a steady bristle, and of the states of effects, is a central difference of its formula; at rest the bristle
    jumps with the direction of slip, and its derivative in an initial velocity is left at 0.
    """
    result = np.zeros((len(start), len(wanted.names)))
    for c, state in enumerate(wanted.states):
        if state >= 0:
            result[state, c] = 1.0
    moving = set(range(2 * len(kernels.mechanism.free), len(start)))
    if kernels.mechanism.memory and not steady:
        moving.discard(len(start) - 1)
    if not moving:
        return result
    if moving == {len(start) - 1}:  # the bristle alone
        from . import bristle_recursions  # compiles on a new installation: not before it is needed

        newton, outputs = pointer(kernels.plain.newton), pointer(kernels.plain.outputs)
        result[-1] += bristle_recursions.steady_changes(
            newton, outputs, start, np.ascontiguousarray(u), p, len(kernels.mechanism.free), wanted.columns,
            wanted.states, np.ascontiguousarray(wanted.directions.coefficients[:, 0, :, 0]),
        )  # fmt: skip
        return result
    rows = sorted(moving)
    first = len(wanted.names) - len(wanted.directions)
    for c in range(len(wanted.names)):
        base = (start, u, p)
        if c >= first:
            change, which = wanted.directions.coefficients[c - first, 0, :, 0], 1
            size = 1e-6 / max(float(np.abs(change).max()), 1e-12)
        else:
            which, index = (2, wanted.columns[c]) if wanted.columns[c] >= 0 else (0, wanted.states[c])
            change = np.eye(len(base[which]))[index]
            size = 1e-6 * (abs(base[which][index]) or 1e-2 * (which == 2))
        if size > 0 and change.any() and not (which == 0 and index in moving):
            shifted = [[x + sign * size * change if i == which else x for i, x in enumerate(base)] for sign in (1, -1)]
            above, below = (_settled(kernels, *values, steady=steady) for values in shifted)
            result[rows, c] += ((above - below) / (2 * size))[rows]
    return result


def _settled(kernels: Kernels, start: np.ndarray, u: np.ndarray, p: np.ndarray, *, steady: bool) -> np.ndarray:
    """The initial state with what is not given where it settles."""
    state = resting_states(kernels, start, u, p).copy()
    if steady and kernels.mechanism.memory:
        state[-1] = steady_bristle(kernels, state, u, p)
    return state
