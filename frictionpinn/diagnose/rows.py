"""What a fit leaves, and its derivatives in whatever may be missing, in units of the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..numerics.parallel import in_parallel
from ..numerics.resolution import averaged, samples_within
from ..numerics.simulate import Simulation
from ..numerics.tangent import Tangent
from . import linear
from .bench import Bench
from .candidates import Candidate
from .fit import Fit
from .linear import Rows, weighted


def linearise(
    bench: Bench, fit: Fit, names: Sequence[str], values: Mapping[str, float] | None = None, probed: bool = False
) -> list[Rows]:
    """Weighted residuals of every trial, and their derivatives in ``names``, at the fit or with other values."""
    p, simulator = fit.values | dict(values or {}), bench.probe if probed else bench.simulator

    def work(k: int) -> Rows:
        model = replace(fit.models[k], simulator=simulator)
        made = linear.linearise(model, p, fit.locals[k], fit.sigmas, bench.problem.loss, names, bench.problem.joint)
        return _resolved(made, model.t, fit.width)

    return in_parallel(work, [len(model.t) for model in fit.models])


def on_probe(bench: Bench, fit: Fit, places: Mapping[str, float]) -> Fit:
    """The fit on the mechanism with forces that depend on a variable in any way, all of these still zero."""
    idle = {par.name: float(par.value) for par in bench.probe.mechanism.parameters if par.value is not None}
    models = tuple(replace(model, simulator=bench.probe) for model in fit.models)
    return replace(fit, values=idle | fit.values | dict(places), models=models)


def derivatives(
    bench: Bench, fit: Fit, names: Sequence[str], values: Mapping[str, float], runs: Sequence[Simulation] | None
) -> list[Rows]:
    """As :func:`linearise`, in the outputs alone and without the trials' own unknowns.

    ``runs`` are the fit's ``strict`` simulations where these values do not move them; else it is simulated anew.
    """
    p, simulator = fit.values | dict(values), bench.simulator

    def work(k: int) -> Rows:
        model, local = fit.models[k], fit.locals[k]
        path = model.path(local)
        if runs is None:
            y0, contact = model.initial(p, local), model.contact
            run = simulator.simulate(model.t, path, p, y0, z0="steady", sensitivities=names, contact=contact)
            changes = run.sensitivities
        else:
            steady = "z" not in model.start
            changes = simulator.differentiate(runs[k], path, p, names, steady=steady, contact=model.contact)
        return _weighted(bench, fit, k, changes)

    return in_parallel(work, [len(model.t) for model in fit.models])


def tangents(bench: Bench, fit: Fit, values: Mapping[str, float], runs: Sequence[Simulation]) -> list[Tangent]:
    """The linear equations along the fit's ``strict`` simulations, at values that do not move them."""
    p = fit.values | dict(values)
    return [
        Tangent(bench.simulator, run, model.path(local), p, steady="z" not in model.start)
        for model, local, run in zip(fit.models, fit.locals, runs, strict=True)
    ]


def responses(bench: Bench, fit: Fit, candidate: Candidate, along: Sequence[Tangent]) -> list[Rows]:
    """As :func:`derivatives`, in a candidate's strengths at every point of its grid: these side by side."""

    def work(k: int) -> Rows:
        return _weighted(bench, fit, k, along[k].respond(candidate.strengths, candidate.grid, fit.models[k].contact))

    return in_parallel(work, [len(model.t) for model in fit.models])


def _weighted(bench: Bench, fit: Fit, k: int, changes: Mapping[str, np.ndarray]) -> Rows:
    model = fit.models[k]
    J = np.stack([changes[key] for key in model.outputs.values()])
    made = weighted(model, fit.state.pieces[k].residuals, J, fit.sigmas, bench.problem.loss)
    return _resolved(made, model.t, fit.width)


def _resolved(rows: Rows, t: np.ndarray, width: float) -> Rows:
    """The rows at a resolution in time, s."""
    half = samples_within(t, width)
    if not half:
        return rows
    every = np.concatenate([rows.r[:, :, None], rows.change, rows.local], axis=2)
    every, n = averaged(every, np.ones(rows.r.shape), half), rows.change.shape[2]
    r, change, local = every[:, :, 0], every[:, :, 1 : n + 1], every[:, :, n + 1 :]
    return replace(rows, r=np.ascontiguousarray(r), change=change, local=local)
