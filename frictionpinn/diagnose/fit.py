"""A fit to the trials of a problem, and whether it leaves anything but noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..identify.loss import Loss
from ..identify.solve import Solution, State, invert, reduced
from ..identify.trial import TrialModel
from ..identify.uncertainty import information_of

SPANS = 5, 20, 60  # samples over which autocorrelations are summed: what a model lacks is slower than that
CORRELATED = 4.5  # standard deviations of such a sum, from which the residual is more than white noise
FAR = 5.0  # standard deviations at which lone residuals are cut


@dataclass(frozen=True)
class Fit:
    """A fit to the trials of a problem.

    Attributes:
        names: parameters that were estimated.
        values: all parameters of the tested mechanism by name, SI units.
        models: of the trials.
        state: unknowns and cost.
        sigmas: noise levels that weighted the residuals.
        minima: of the likelihood around it, where they were looked for, best first.
        searched: whether a search from all starts led here, or found nothing lower.
        starts: of that search, from short windows.
    """

    names: tuple[str, ...]
    values: dict[str, float]
    models: tuple[TrialModel, ...]
    state: State
    sigmas: dict[str, float]
    minima: tuple[Solution, ...] = ()
    searched: bool = False
    starts: tuple[Solution, ...] = ()

    @property
    def locals(self) -> tuple[np.ndarray, ...]:
        """Unknowns of each trial."""
        return self.state.locals

    @property
    def widening(self) -> np.ndarray:
        """Standard errors with all minima around the fit counted, over those of its curvature, in the order of names.

        At least 1, and 1 where one minimum was found.
        """
        if len(self.minima) < 2:
            return np.ones(len(self.names))
        several, one = (invert(S).diagonal() for S in (information_of(self.minima), reduced(self.minima[0].state)[0]))
        return np.sqrt(np.maximum(several / np.maximum(one, 1e-300), 1.0))

    @property
    def count(self) -> int:
        """Samples of all signals."""
        return sum(len(model.t) * len(model.outputs) for model in self.models)

    @property
    def _residuals(self) -> dict[str, list[np.ndarray]]:
        """Signal -> residuals of each trial that has it."""
        names = dict.fromkeys(name for piece in self.state.pieces for name in piece.residuals)
        return {name: [p.residuals[name] for p in self.state.pieces if name in p.residuals] for name in names}

    def levels(self, loss: Loss) -> dict[str, float]:
        """Noise of every signal as the residuals show it, SI units."""
        result = dict(self.sigmas)
        for name, own in self._residuals.items():
            r = np.concatenate(own)
            r = r[~np.isnan(r)]
            result[name] = (loss.sigma(r, len(r)) if len(r) else 0.0) or result[name]
        return result

    @cached_property
    def correlation(self) -> float:
        """How far the residuals are from white noise: the largest sum of autocorrelations over the signals, in its
        standard deviation under white noise.

        For one signal of n samples and a span of L lags it is sqrt(n / L) sum_{l=1}^{L} rho_l. It asks for no noise
        level, and estimated unknowns only lower it.
        """
        return max((_correlation(own) for own in self._residuals.values()), default=0.0)

    @property
    def explains(self) -> bool:
        """Whether the residuals are as white as noise."""
        return self.correlation < CORRELATED


def _correlation(series: Sequence[np.ndarray]) -> float:
    rows = [np.nan_to_num(r) for r in series]
    size = float(np.median(np.abs(np.concatenate(rows)))) / 0.6745
    if size == 0.0:
        return 0.0
    rows = [np.clip(r / size, -FAR, FAR) for r in rows]
    lags = SPANS[-1]
    products = np.zeros(lags + 1)
    for r in rows:
        for lag in range(min(lags + 1, len(r))):
            products[lag] += float(r[lag:] @ r[: len(r) - lag])
    count = sum(map(len, rows))
    sums = np.cumsum(products[1:]) / products[0]
    return max(float(np.sqrt(count / span) * sums[span - 1]) for span in SPANS)
