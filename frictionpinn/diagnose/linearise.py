"""The trials at a fit, linear in all that may change: the rows of the score tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..numerics.parallel import in_parallel
from ..numerics.resolution import samples_within
from ..numerics.score import Rows, weighted
from .bench import Bench
from .fit import Fit


def on_probe(bench: Bench, fit: Fit) -> Fit:
    """The fit on the mechanism with forces that depend on a variable in any way, all of these still zero."""
    idle = {par.name: float(par.value) for par in bench.probe.mechanism.parameters if par.value is not None}
    models = tuple(replace(model, simulator=bench.probe) for model in fit.models)
    return replace(fit, values=idle | fit.values | bench.places, models=models)


def linearise(bench: Bench, fit: Fit, names: Sequence[str]) -> list[Rows]:
    """Every trial at a fit, see :func:`on_probe`, with derivatives in the parameters ``names``.

    Raises:
        ContactLost, SimulationFailed: the model cannot be simulated there.
    """
    fit, loss, joint = on_probe(bench, fit), bench.problem.loss, bench.problem.joint

    def work(k: int) -> Rows:
        model, local = fit.models[k], fit.locals[k]
        run = model.simulate(fit.values, local, names, joint)
        signals, r = list(model.outputs), [model.predict(run) - model.y]
        J = [model.derivatives(run, fit.values, names, joint)]
        first = len(names) + len(model.states)
        if joint:
            for item, coefficients in zip(model.inputs, model.coefficients(local), strict=True):
                shown, changes, sensed = model.shown(item, coefficients, fit.values, names, joint)
                place = [*range(first, first + item.basis.size), *(names.index(name) for name in sensed)]
                rows = np.zeros((len(item.names), *J[0].shape[1:]))
                rows[:, :, place] = changes
                first += item.basis.size
                signals += item.names
                r.append(shown - item.y)
                J.append(rows)
        residuals, sigmas = np.concatenate(r), np.array([fit.sigmas.get(name, 1.0) for name in signals])[:, None]
        weight = np.sqrt(loss.weight(np.nan_to_num(residuals) / sigmas)) / sigmas
        weight = np.where(np.isnan(residuals), 0.0, weight)
        rows = weighted(np.dstack([residuals, np.concatenate(J)]), weight, samples_within(model.t, fit.width))
        r_, change, own = np.split(rows, [1, 1 + len(names)], axis=2)
        return Rows(tuple(signals), r_[:, :, 0], change, own, weight)

    return in_parallel(work, [len(model.t) for model in fit.models])
