"""Estimates of a fit with their 95 % intervals."""

from __future__ import annotations

import numpy as np

from ..identify.uncertainty import UNTOLD, interval
from .bench import Bench
from .fit import Fit
from .scan import Scanned


def intervals(bench: Bench, fit: Fit, scanned: Scanned) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Estimates and 95 % intervals from the likelihood's curvature, its other minima and the noise's colour counted."""
    normal = scanned.known
    flat = [r / fit.sigmas[n] for piece in fit.state.pieces for n, r in piece.residuals.items()]
    factor = bench.problem.loss.inflation(np.nan_to_num(np.concatenate(flat)))
    errors = np.sqrt(factor * np.maximum(normal.covariance.diagonal(), 0.0))
    wider = dict(zip(fit.names, fit.widening, strict=True))
    table = {par.name: par for par in bench.tested.parameters}
    values = {name: fit.values[name] for name in fit.names}
    ci95 = {}
    for name in fit.names:
        par, error = table[name], np.nan
        positive = par.low >= 0 and par.neutral is None
        if name in normal.names:
            error = wider[name] * float(errors[normal.names.index(name)]) or np.nan  # 0: derivatives that overflow
        if positive and error > UNTOLD * values[name]:
            error = np.nan
        ci95[name] = interval(values[name], error, positive)
    return values, ci95
