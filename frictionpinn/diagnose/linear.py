"""A fit as a linear problem: weighted residuals, and their derivatives in everything that may change them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..identify.loss import Loss
from ..identify.trial import TrialModel


@dataclass(frozen=True)
class Rows:
    """One trial at a fit, in units of the noise; rows run over signals, then samples.

    Attributes:
        signals: measured signals, outputs first, then noisy inputs.
        r: model minus measurement, shape (signals, n); 0 where missing.
        change: derivatives in the parameters, shape (signals, n, parameters); 0 for inputs.
        local: derivatives in the trial's own unknowns, shape (signals, n, unknowns).
    """

    signals: tuple[str, ...]
    r: np.ndarray
    change: np.ndarray
    local: np.ndarray


def linearise(
    model: TrialModel,
    p: Mapping[str, float],
    local: np.ndarray,
    sigmas: Mapping[str, float],
    loss: Loss,
    names: Sequence[str],
    joint: bool = True,
) -> Rows:
    """Weighted residuals of a trial and their derivatives.

    With a robust loss both carry the square root of its weights, as in iteratively reweighted least squares.

    Args:
        model: the trial.
        p: all parameters, SI units.
        local: its own unknowns, see :class:`TrialModel`.
        sigmas: noise standard deviations, SI units.
        loss: of the fit.
        names: parameters to differentiate by, in SI units.
        joint: whether the coefficients of noisy inputs are among the unknowns.

    Raises:
        ContactLost, SimulationFailed: the model cannot be simulated there.
    """
    run = model.simulate(p, local, names, joint)
    scale = np.array([sigmas[name] for name in model.outputs])[:, None]
    r = (model.predict(run) - model.y) / scale
    J = model.derivatives(run, p, names) / scale[:, :, None]
    n_g, first = len(names), len(names) + len(model.states)
    signals, rows, changes, locals_ = list(model.outputs), [r], [J[:, :, :n_g]], [J[:, :, n_g:]]
    if joint:
        for item in model.inputs:
            values = local[first - n_g : first - n_g + item.basis.size]
            levels = np.array([sigmas.get(name, 1.0) for name in item.names])[:, None]
            rows.append((item.basis.design @ values - item.y) / levels)
            own = np.zeros((len(item.names), len(model.t), model.size(joint)))
            own[:, :, first - n_g : first - n_g + item.basis.size] = item.basis.design / levels[:, :, None]
            changes.append(np.zeros((len(item.names), len(model.t), n_g)))
            locals_.append(own)
            signals += item.names
            first += item.basis.size
    stacked = np.concatenate(rows)
    weight = np.where(np.isnan(stacked), 0.0, np.sqrt(loss.weight(np.nan_to_num(stacked))))
    return Rows(
        tuple(signals),
        np.nan_to_num(stacked) * weight,
        np.nan_to_num(np.concatenate(changes)) * weight[:, :, None],
        np.nan_to_num(np.concatenate(locals_)) * weight[:, :, None],
    )


def weighted(
    model: TrialModel,
    residuals: Mapping[str, np.ndarray],
    J: np.ndarray,
    sigmas: Mapping[str, float],
    loss: Loss,
) -> Rows:
    """The outputs' rows of :func:`linearise` from derivatives at hand, shape (n_out, n, parameters), SI units."""
    scale = np.array([sigmas[name] for name in model.outputs])[:, None]
    r = np.stack([residuals[name] for name in model.outputs]) / scale
    weight = np.where(np.isnan(r), 0.0, np.sqrt(loss.weight(np.nan_to_num(r))))
    change = np.nan_to_num(J / scale[:, :, None]) * weight[:, :, None]
    return Rows(tuple(model.outputs), np.nan_to_num(r) * weight, change, np.zeros((*r.shape, 0)))
