"""What the state of an online estimator holds, and which sensor shows which of it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ..numerics.codegen import Kernels
from ..physics.base import contact_of
from ..physics.mechanism import Mechanism
from .tuning import Tuning

STATE, RATE, FORCE = 0, 1, 2  # what a measured signal shows: a component of X, of w = (a, z'), the friction force
ATOL = 1e-5  # absolute error of the integrator in velocities


@dataclass(frozen=True)
class Layout:
    """State X = (s, chains, parameters), see :mod:`.recursions`, and the sensors that show it.

    Attributes:
        kept: number of states before the parameters.
        chains: offset in X, number of states, column in the inputs, whether it is a coordinate; shape (n_chains, 4).
        spreads: standard deviation of every chain's states before the first sample.
        densities: of every chain's highest derivative, (n_chains,).
        signals: measured names that the estimator takes.
        rows: what each shows and where in it, shape (n_signals, 2).
        variances: of their noise, SI units squared, shape (n_signals,).
        kicks: variance that a sample adds to each of the mechanism's states, (n_s,).
        atol: absolute error of the integrator in each of them, (n_s,).
        adapted: places of the parameters that adapt among all, shape (n_adapted,).
        slips: whether each free coordinate moves the contact of a parameter that adapts, shape (n_adapted, m).
    """

    kept: int
    chains: np.ndarray
    spreads: tuple[np.ndarray, ...]
    densities: np.ndarray
    signals: tuple[str, ...]
    rows: np.ndarray
    variances: np.ndarray
    kicks: np.ndarray
    atol: np.ndarray
    adapted: np.ndarray
    slips: np.ndarray

    @property
    def size(self) -> int:
        """Length of X."""
        return self.kept + len(self.adapted)

    @classmethod
    def of(cls, mechanism: Mechanism, kernels: Kernels, tuning: Tuning, adapt: Collection[str], share: float) -> Layout:
        """The layout of a mechanism's estimator, see :class:`.OnlineEstimator` for the arguments."""
        n_s, m, columns = kernels.sizes[0], len(mechanism.free), mechanism.input_signals
        rows = dict[str, tuple[int, int]]()
        for j, c in enumerate(mechanism.free):
            rows |= dict(zip(c.signals, ((STATE, j), (STATE, m + j), (RATE, j)), strict=True))
        chains, offset = [], n_s
        for chain in tuning.chains.values():
            chains.append((offset, chain.order, columns.index(chain.signals[0]), int(len(chain.signals) == 3)))
            rows |= {name: (STATE, offset + k) for k, name in enumerate(chain.signals)}
            offset += chain.order
        if mechanism.system.massless:
            rows |= {item.name: (FORCE, 0) for item in mechanism.system.inputs}
        signals = tuple(name for name in rows if name in tuning.sigmas)
        kicks, atol = np.zeros(n_s), np.full(n_s, ATOL * tuning.interval)
        kicks[m : 2 * m] = [(share * tuning.scales[c.name][2]) ** 2 * tuning.interval for c in mechanism.free]
        atol[m : 2 * m] = ATOL
        names = [par.name for par in mechanism.parameters]
        slips = [moved_by(mechanism, kernels, contact_of(name)) for name in adapt]
        return cls(
            kept=offset,
            chains=np.array(chains, dtype=np.int64).reshape(-1, 4),
            spreads=tuple(np.array(chain.spread) for chain in tuning.chains.values()),
            densities=np.array([chain.density for chain in tuning.chains.values()]),
            signals=signals,
            rows=np.array([rows[name] for name in signals], dtype=np.int64).reshape(-1, 2),
            variances=np.array([tuning.sigmas[name] ** 2 for name in signals]),
            kicks=kicks,
            atol=atol,
            adapted=np.array([names.index(name) for name in adapt], dtype=np.int64),
            slips=np.array(slips, dtype=np.bool_).reshape(len(slips), m),
        )


def moved_by(mechanism: Mechanism, kernels: Kernels, contact: str) -> np.ndarray:
    """Whether each free coordinate moves a contact, shape (m,); all of them where there is only one."""
    several = len(kernels.contacts) > 1 and contact
    jacobian = mechanism.system.at(contact).jacobian if several else {}
    return np.array([not several or jacobian[c.name] != 0 for c in mechanism.free], bool)
