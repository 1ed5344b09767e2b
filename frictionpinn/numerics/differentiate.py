"""Sensitivities of a finished simulation, from the steps that it recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..physics.base import at_contact
from .bristle import start_changes
from .codegen import Kernels, pointer
from .directions import Directions
from .paths import InputPath
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
    steady: np.ndarray,
    contact: bool = True,
) -> dict[str, np.ndarray]:
    """Return name -> derivatives, shape (n, n_sens), as in ``Simulation.sensitivities``.

    The steps are held; apart from that the derivatives are exact. ``steady`` says of each bristle that its initial
    state was that of ``steady_bristles`` and moves with the parameters; without ``contact``, what acts there is left
    out, see :func:`wanted_outputs`.
    """
    from . import sensitivity  # compiles on a new installation: not before it is needed

    m, n = len(kernels.mechanism.free), len(path.t)
    n_s, n_w, _, _ = kernels.sizes
    given, first = wanted.directions, len(wanted.names) - len(wanted.directions)
    put = np.concatenate([np.arange(first), first + np.argsort(given.order)])  # columns in the order of the names
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
            put,
            given.pieces,
            given.lanes,
            given.groups,
            given.piece,
            given.since,
            given.support,
            steps.interval,
            steps.size,
            steps.unknowns,
        )
    which, outputs = wanted_outputs(kernels, contact), np.zeros((0, n, len(wanted.names)))
    if len(which):
        kernel = pointer(kernels.sensitivity.output_derivatives)
        outputs = sensitivity.output_sensitivities(
            kernel, states, unknowns, path.samples, p, ds, dw, wanted.columns, put, given.samples,
            given.support, which, kernels.outputs,
        )  # fmt: skip
    return named(kernels, ds, dw, which, outputs)


def wanted_outputs(kernels: Kernels, contact: bool) -> np.ndarray:
    """Places of outputs: all, or without ``contact`` those of an imposed motion that a likelihood asks for, the
    required force and the slip velocity whose sign it follows."""
    names, imposed = kernels.output_names, kernels.mechanism.predictions if kernels.mechanism.system.massless else {}
    return np.array([k for k, name in enumerate(names) if contact or (imposed and name in {"v_slip", *imposed})], int)


def named(
    kernels: Kernels, ds: np.ndarray, dw: np.ndarray, which: np.ndarray, outputs: np.ndarray
) -> dict[str, np.ndarray]:
    """Derivatives of states and their rates, (n, ..., n_sens), and of the outputs ``which``, (len(which), n, n_sens),
    by the names of what they are derivatives of."""
    mechanism = kernels.mechanism
    m, zero, bristles = len(mechanism.free), np.zeros((len(ds), ds.shape[2])), list(mechanism.bristles)
    result = {kernels.output_names[k]: own for k, own in zip(which, outputs, strict=True)}
    for contact in mechanism.contacts:
        place = bristles.index(contact) - len(bristles) if contact in bristles else None
        moving = (zero, zero) if place is None else (ds[:, place], dw[:, place])
        result |= zip((at_contact(contact.name, name) for name in ("z", "zdot")), moving, strict=True)
    for j, coordinate in enumerate(mechanism.free):
        result.update(zip(coordinate.signals, (ds[:, j], ds[:, m + j], dw[:, j]), strict=True))
    return result


def start_sensitivity(
    kernels: Kernels, u: np.ndarray, p: np.ndarray, start: np.ndarray, wanted: Wanted, steady: np.ndarray
) -> np.ndarray:
    """Derivative of the initial state, shape (n_s, n_sens).

    The identity in the states that are given; the others as :func:`.bristle.start_changes` has them.
    """
    result = start_changes(kernels, start, u, p, wanted.columns, wanted.states, wanted.directions.first, steady=steady)
    given = np.flatnonzero(wanted.states >= 0)
    result[wanted.states[given], given] += 1.0
    return result
