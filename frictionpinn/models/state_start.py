"""Where the training of a parameter estimator through the motion starts, so that no minimum is met by chance.

Simulated, the loss has many minima along the ridge on which static friction and Stribeck velocity move together. In
stiffness and damping it has few while friction rises towards rest over a wide range of velocities: nothing jumps then.

1. a design over stiffness and damping, the rise as wide as the bounds allow;
2. from the best two the law alone is fitted to the motion, then the law beside the errors of the inputs;
3. where nothing was smoothed, and so no noise is measured, what is left there tells how large the noise is and over how
   many samples it stays correlated, and both are fitted again at that;
4. points along the ridge from the better one, and the best two of them fitted again;
5. the best of all fitted while its segments carry on more and more of the motion from one to the next, up to whole
   trials: what segments forget tells of viscous friction. A law that does not explain whole trials (by the likelihood
   ratio) is fitted to the segments as they were, each of which it may still explain;
6. law and a departure of its own at every speed fitted together, which tells whether a network has anything to add.
   Where that is no likelier than the law alone (by the same ratio) the network stays at rest in the training, too: it
   would learn noise, and what it learns viscous friction lacks.

A black box starts from steps 1 to 5 (:mod:`.black_box_start`).

L-BFGS (Nocedal and Wright, Numerical Optimization, 7.2) over the law in coordinates in which its curvature is one, or
it takes hundreds of iterations along the ridge.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.optimize import minimize, minimize_scalar
from scipy.stats import chi2, qmc
from torch import nn

from ..numerics.whiteness import correlation_time
from ..physics.beforehand import DAMPING_RATIO, STATIC_RATIO
from .base import Batch
from .knots import KNOTS, LOADS
from .segments import SEGMENT

if TYPE_CHECKING:
    from .state import StateModel

log = logging.getLogger(__name__)
DESIGN = 16  # points, a power of two as Sobol's sequence wants
RIDGE, FINER = (6, 8), 12  # values of mu_s / mu_c and of v_s, and how often the best v_s is moved beside each mu_s
FOLLOWED = 2  # points of design and ridge from which a fit goes on
ALONE, JOINT, ALONG = 30, 80, 60  # iterations: the law alone, beside the inputs' errors, along the ridge
CARRIED = (0.5, 1.0)  # shares of the motion that a segment has from the one before, in turn
DIFFER = 1e-3  # significance: trials are not what their segments carry on; a network has something to add to its law
TO_THE_END = 400  # most iterations with each of them: those looked at came to rest within half as many
FURTHEST = 0.1  # most that a unit step moves a law's parameters (logarithms) where the loss hardly depends on them
CLOSE = 1e-4  # step of the differences that tell the curvature, logarithms
UNKNOWN = ("law_parameters.", "errors.")

Point = dict[str, float]


def find_start(model: StateModel, batch: Batch) -> None:
    """Leave the law's parameters and the inputs' errors of ``model`` where its training on ``batch`` starts."""
    alone = fit_law(model, batch)
    model.departs.fill_(float(has_something_to_add(model, batch, alone)))


def fit_law(model: StateModel, batch: Batch) -> float:
    """Leave the law alone where it and the inputs' errors fit the motion best; the loss there."""
    law = model.law_parameters
    assert law is not None
    model.carried.fill_(0.0)
    model.departs.fill_(0.0)
    points = _best(model, batch, [*design(model), model.physical()])  # a start that was given is one of those tried
    ends = _afresh(model, batch, points)
    if model.scales.get("assumed"):
        _restore(model, ends[0][1])
        model.discount.fill_(discount(model.residuals(batch)))
        ends = _afresh(model, batch, points)
    fitted = ends[0][1]
    _restore(model, fitted)
    for point in _best(model, batch, ridge(model, batch)):
        _restore(model, fitted)
        law.place(point)
        ends.append((_fit(model, batch, UNKNOWN, ALONG), _now(model)))
    apart, best = min(ends, key=lambda end: end[0])
    _restore(model, best)
    for share in CARRIED:
        model.carried.fill_(share)
        whole = _fit(model, batch, UNKNOWN, TO_THE_END)
    joints = int((batch["start"] == SEGMENT).sum())
    joints *= 1 if model.errors is None or model.errors.places is None else 2  # velocity and position begin anew
    if joints and len(batch["start"]) * (whole - apart) > chi2.isf(DIFFER, joints):
        model.carried.fill_(0.0)
        _restore(model, best)
        whole = _fit(model, batch, UNKNOWN, TO_THE_END)
    return whole


def _afresh(model: StateModel, batch: Batch, points: Sequence[Point]) -> list[tuple[float, dict[str, torch.Tensor]]]:
    """Where fits of the law alone, then beside the inputs' errors, end from these points on, the best one first."""
    ends = []
    for point in points:
        model.law_parameters.place(point)  # type: ignore[union-attr]
        if model.errors is not None:
            model.errors.forget()
        _fit(model, batch, ("law_parameters.",), ALONE)
        ends.append((_fit(model, batch, UNKNOWN, JOINT), _now(model)))
    return sorted(ends, key=lambda end: end[0])


def discount(residuals: Sequence[np.ndarray]) -> float:
    """What a residual's square counts for less: its mean, times the samples over which residuals stay correlated.

    A filter, a quantised position, what a model lacks: their errors are no independent noise in every sample, and a
    likelihood that takes them for that is sure of what an error suggests, whatever is known beforehand.
    """
    return float(np.mean(np.concatenate(residuals) ** 2)) * correlation_time(residuals)


def has_something_to_add(model: StateModel, batch: Batch, alone: float) -> bool:
    """Whether a departure from the law makes the motion likelier than the law alone, whose loss is ``alone``."""
    known, network, weight, free = _now(model), model.network, model.weight, BySpeed(model)
    model.departs.fill_(1.0)
    model.network, model.weight = free, 0.0  # type: ignore[assignment]
    beside = _fit(model, batch, ("network.", *UNKNOWN), TO_THE_END)
    model.network, model.weight = network, weight
    _restore(model, known)
    gain, asked = len(batch["start"]) * (alone - beside), chi2.isf(DIFFER, len(free.values))
    fate = "is trained beside" if gain > asked else "stays at rest beside"
    log.info(f"the network {fate} its law: a departure gains {gain:.0f} in -2 log likelihood, asked {asked:.0f}")
    return bool(gain > asked)


class BySpeed(nn.Module):
    """A departure from the law at every knot over the velocity that samples meet faster than its noise, the same at
    all loads and, beside an odd network, in both directions; in place of a network."""

    place: torch.Tensor

    def __init__(self, model: StateModel):
        super().__init__()
        v, met = model.knots[:, 0].reshape(KNOTS, LOADS)[:, 0], model.met.reshape(KNOTS, LOADS).sum(1) > 0
        met = met & (v.abs() > model.scales["slip_noise"])
        side = torch.arange(KNOTS)
        if model.odd:
            met, side = met | met.flip(0), torch.maximum(side, side.flip(0))
        speeds = torch.unique(side[met])
        self.values = nn.Parameter(torch.zeros(len(speeds)))
        place = torch.searchsorted(speeds, side)
        self.register_buffer("place", place.where(met, torch.tensor(len(speeds))).repeat_interleave(LOADS))

    def forward(self, eyes: torch.Tensor) -> torch.Tensor:
        return nn.functional.pad(self.values, (0, 1))[self.place, None]


def design(model: StateModel) -> list[Point]:
    """Stiffness and damping spread evenly in the logarithm (Sobol); sliding friction as the sliding samples have it."""
    law, scales = model.law_parameters, model.scales
    assert law is not None
    told = model.physical() | {"mu_c": scales["ratio"], "sigma_2": scales["viscous"]}
    told |= {"mu_s": scales["breakaway"], "v_s": 0.05 * scales["velocity"]}
    points = []
    for x, y in qmc.Sobol(2, seed=0).random(DESIGN):
        point = {name: value for name, value in told.items() if name in law.raw} | law.fixed
        if "sigma_0" in law.raw:
            point["sigma_0"] = _between(law.bounds["sigma_0"], x)
        if "sigma_1" in law.raw:
            critical = 2 * np.sqrt(point["sigma_0"] / scales["mobility"])
            point["sigma_1"] = critical * _between(DAMPING_RATIO, y)
        points.append(point)
    return points


def ridge(model: StateModel, batch: Batch) -> list[Point]:
    """The law as it is with other static frictions, each with the Stribeck velocity that fits best beside it.

    The ridge is narrow: a Stribeck velocity a few per cent off moves a stop. None where the two are not both free.
    """
    law, now = model.law_parameters, model.physical()
    assert law is not None
    if not {"mu_s", "v_s"} <= set(law.raw):
        return []
    speeds = np.log(np.geomspace(*law.bounds["v_s"], RIDGE[1]))
    points = []
    for ratio in np.geomspace(*STATIC_RATIO, RIDGE[0]):

        def at(v: float, ratio: float = ratio) -> Point:
            return now | {"mu_s": float(ratio * now["mu_c"]), "v_s": float(np.exp(v))}

        def miss(v: float) -> float:
            law.place(at(v))
            return model.loss_now(batch)

        k = int(np.argmin([miss(v) for v in speeds]))
        around = speeds[max(k - 1, 0)], speeds[min(k + 1, len(speeds) - 1)]
        points.append(at(minimize_scalar(miss, bounds=around, method="bounded", options={"maxiter": FINER}).x))
    return points


def _between(bounds: Sequence[float], share: float) -> float:
    low, high = bounds
    return float(low * (high / low) ** share)


def _best(model: StateModel, batch: Batch, points: Sequence[Point]) -> list[Point]:
    """The points of least loss, the network and the inputs' errors as they are."""
    losses = []
    for point in points:
        model.law_parameters.place(point)  # type: ignore[union-attr]
        losses.append(model.loss_now(batch))
    return [points[k] for k in np.argsort(losses)[:FOLLOWED]]


def _now(model: StateModel) -> dict[str, torch.Tensor]:
    return {name: p.detach().clone() for name, p in model.named_parameters()}


@torch.no_grad()
def _restore(model: StateModel, known: Mapping[str, torch.Tensor]) -> None:
    for name, p in model.named_parameters():
        p.copy_(known[name])


def _fit(model: StateModel, batch: Batch, named: tuple[str, ...], iterations: int) -> float:
    """Minimise the loss by L-BFGS over the parameters whose names begin so; the loss that is reached."""
    own = [(name, p) for name, p in model.named_parameters() if name.startswith(named)]
    law = np.concatenate([np.full(p.numel(), not name.startswith(UNKNOWN[1])) for name, p in own])
    first = torch.cat([p.detach().flatten() for _, p in own]).double().cpu().numpy()
    size = float(len(batch["v"]))  # so that the curvature is that of a sum of squares, for which the tolerances are

    def at(x: np.ndarray) -> tuple[float, np.ndarray]:
        parts = torch.from_numpy(x).split([p.numel() for _, p in own])
        with torch.no_grad():
            for (_, p), part in zip(own, parts, strict=True):
                p.copy_(part.view_as(p))
        with torch.enable_grad():
            value = size * model.losses(batch)["loss"]
            slopes = torch.autograd.grad(value, [p for _, p in own])
        return float(value.detach()), torch.cat([g.flatten() for g in slopes]).double().cpu().numpy()

    ways, highest = _ways(lambda x: at(x)[1], first, law), 0.0

    def place(y: np.ndarray) -> np.ndarray:
        x = first + y
        x[law] = first[law] + ways @ y[law]
        return x

    def loss(y: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal highest
        value, slope = at(place(y))
        if not np.isfinite([value, *slope]).all():  # too long a step: worse than all there was, the next is shorter
            return 2 * highest, np.zeros_like(slope)
        highest = max(highest, value)
        slope[law] = ways.T @ slope[law]
        return value, slope

    found = minimize(loss, np.zeros(len(first)), jac=True, method="L-BFGS-B", options={"maxiter": iterations})
    return at(place(found.x))[0] / size


def _ways(slope: Callable[[np.ndarray], np.ndarray], x: np.ndarray, law: np.ndarray) -> np.ndarray:
    """Steps of the law's parameters in which the curvature of the loss at x is one or, where it is small, less."""
    steps = np.zeros((np.count_nonzero(law), len(x)))
    steps[np.arange(len(steps)), np.flatnonzero(law)] = CLOSE
    curvature = np.array([(slope(x + step) - slope(x - step))[law] / (2 * CLOSE) for step in steps])
    sizes, ways = np.linalg.eigh((curvature + curvature.T) / 2)
    return ways / np.sqrt(np.maximum(np.abs(sizes), FURTHEST**-2))
