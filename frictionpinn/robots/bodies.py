"""Bodies that have given base parameters and can exist.

A recording tells combinations of inertial parameters alone. Of all bodies with these, those are taken that differ least
from the file's and have positive mass and inertia: of each body the pseudo-inertia

    J = [Sigma, h; h', m],    Sigma = tr(I) / 2 - I,

is positive semidefinite (Wensing, Kim and Slotine, IEEE RA-L 3, 2018). Nearest in the norm of J, lengths in units of
the robot's own: an affine set and a cone, by alternating projections with the correction of Boyle and Dykstra (1986).
"""

from __future__ import annotations

import numpy as np

from ..physics.robot import Base, Robot

PASSES = 5000  # of the projections, 0.1 ms each
LEAST = 1e-6  # of the trace of the file's J: its least eigenvalue, clear of what simulators take for none
MET = 1e-9  # of the base parameters' norm: closer is rounding
ROOT = np.sqrt(0.5)
# Basis of the symmetric 4 x 4 matrices, of norm 1 each: shape (10, 4, 4).
_PAIRS = [(i, j) for i in range(4) for j in range(i, 4)]
_BASIS = np.zeros((10, 4, 4))
for _k, (_i, _j) in enumerate(_PAIRS):
    _BASIS[_k, _i, _j] = _BASIS[_k, _j, _i] = 1.0 if _i == _j else ROOT


def bodies_of(robot: Robot, base: Base, beta: np.ndarray) -> tuple[np.ndarray, float]:
    """Inertial parameters pi, shape (10 bodies,), and how far their base parameters are from beta, relative.

    Where nothing that exists has these base parameters, what exists and is nearest is returned.
    """
    own = robot.inertial.reshape(-1, 10)
    size = float(np.sqrt(np.mean([np.trace(_pseudo(row)[:3, :3]) / max(row[0], 1e-9) for row in own])))
    scale = np.array([size, size, size, 1.0])
    mixing = np.zeros((len(beta), own.size))
    mixing[np.arange(len(beta)), base.columns] = 1.0
    mixing[:, base.others] = base.mixing
    to_pi = np.stack([_parameters(matrix * np.outer(scale, scale)) for matrix in _BASIS], axis=1)
    A = np.einsum("bkp,pc->bkc", mixing.reshape(len(beta), -1, 10), to_pi).reshape(len(beta), -1)
    inverse = np.linalg.pinv(A)
    x = np.stack([np.einsum("cij,ij->c", _BASIS, _pseudo(row) / np.outer(scale, scale)) for row in own]).reshape(-1)
    least = LEAST * np.array([np.trace(_pseudo(row) / np.outer(scale, scale)) for row in own])[:, None]
    correction, norm = np.zeros_like(x), float(np.linalg.norm(beta)) or 1.0
    for _ in range(PASSES):
        met = x - inverse @ (A @ x - beta)
        values, vectors = np.linalg.eigh(np.einsum("kc,cij->kij", (met + correction).reshape(-1, 10), _BASIS))
        held = np.einsum("kia,ka,kja->kij", vectors, np.maximum(values, least), vectors)
        x = np.einsum("cij,kij->kc", _BASIS, held).reshape(-1)
        correction = met + correction - x
        if (left := float(np.linalg.norm(A @ x - beta)) / norm) < MET:
            break
    return (x.reshape(-1, 10) @ to_pi.T).reshape(-1), left


def _pseudo(row: np.ndarray) -> np.ndarray:
    """J of one body's m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = row
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    J = np.empty((4, 4))
    J[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    J[:3, 3] = J[3, :3] = x, y, z
    J[3, 3] = m
    return J


def _parameters(J: np.ndarray) -> np.ndarray:
    """The inverse of :func:`_pseudo`."""
    inertia = np.trace(J[:3, :3]) * np.eye(3) - J[:3, :3]
    return np.array([J[3, 3], *J[:3, 3], inertia[0, 0], inertia[0, 1], inertia[1, 1], inertia[0, 2], inertia[1, 2],
                     inertia[2, 2]])  # fmt: skip
