"""The verdict: what the added effects take off, whether what is left matters, and what is known of what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..data.findings import NO_SLIP
from ..data.inspect import no_slip
from ..identify.result import NO_EXCITATION
from ..numerics.coloured import Noise
from ..numerics.formula import sparse_formula
from ..numerics.score import Columns, Normal
from ..physics.remainder import Remainder
from .bench import Bench
from .candidates import impossible
from .errors import compare, main_signal
from .fit import Fit
from .held_out import check
from .linearise import linearise, on_probe
from .scan import Remaining, Scanned
from .select import Accepted, Selection, Settings

FOUND, NOTHING, PARTLY, UNEXPLAINED = "effect found", "nothing missing", "partly explained", "unexplained"
NO_VERDICT = "no verdict"
FIFTH = 0.2  # of the squared error beyond the noise: names that take off less are not the names of what is missing
SIMILAR = 0.9  # of the best log p: variables that explain as much are named together
AT_END = 1e-3  # of a bound: nearer to it a fit has ended there; searches end a little inside
CONFIRMED = 0.005  # share of the held-out remainder that a variable must explain: less is printed as 0 %
POINTS = 60  # of a shape: several for each bump


@dataclass(frozen=True)
class Verdict:
    """What is said of a selection.

    Attributes:
        verdict: "effect found": nothing is left that matters; "nothing missing": neither was there before;
            "partly explained": held-out trials confirm the added effects, and what is left matters; "unexplained": no
            effects, or such as take off less than a fifth of the squared error beyond the noise.
        unexplained: the significant remainder that matters, or None.
        trifle: one that is significant, but smaller than ``Settings.worth``, where no other is left.
        fit, scanned: the model that the verdict is about, and what is known at it.
        before, after: declared and augmented model on the trials of ``scored``.
        scored: "held-out trials", or "fitted trials" where none could be held out.
        errors: see :func:`frictionpinn.diagnose.errors.compare`.
        shares: of the squared error beyond the noise by which errors are quoted first: what each effect took off when
            it was added, {value, ci95}.
        left: the share that is left.
    """

    verdict: str
    unexplained: Unexplained | None
    trifle: Unexplained | None
    fit: Fit
    scanned: Scanned
    before: Fit
    after: Fit
    scored: str
    errors: dict[str, Any]
    shares: tuple[dict[str, Any], ...]
    left: dict[str, Any]


def judge(bench: Bench, selection: Selection, settings: Settings) -> Verdict:
    """Judge a selection."""
    path = [selection.base, *(a.fit for a in selection.accepted)]
    fits = [fit for own in path if (fit := check(bench, own)) is not None]
    scored = "held-out trials"
    if len(fits) < len(path):
        scored, fits = "fitted trials", path
    errors, excesses = compare(bench, fits, selection.last.sigmas)
    excess = excesses[main_signal(bench.mechanism.system, errors)]

    fit, scanned, before, after = selection.fit, selection.last, fits[0], fits[-1]
    whole: dict[str, Any] = {"value": 1.0, "ci95": [1.0, 1.0]}
    shares = tuple(excess.share(k) for k in range(1, len(selection.accepted) + 1))
    left = excess.share(0) if shares else whole

    def significant(remaining: Sequence[Remaining]) -> list[Remaining]:
        return [m for m in remaining if m.log_p + np.log10(len(remaining)) < settings.log_p]

    remaining = significant(selection.last.remaining)
    matter = [m for m in remaining if size(m, *along(bench, m.variable)) >= settings.worth]
    if not matter:
        name = FOUND if selection.accepted else NOTHING
    elif selection.accepted and not excess.squared[-1] > (1 - FIFTH) * excess.squared[0]:
        name = PARTLY
    else:
        name = UNEXPLAINED
        if selection.accepted:  # the answer is the declared model's: the effects are not what is missing
            fit, scanned, after = selection.base, selection.first, before
            matter = significant(scanned.remaining) or list(scanned.remaining)
            errors, _ = compare(bench, [before, after], scanned.sigmas)
            shares, left = (), whole

    def told(remaining: Sequence[Remaining]) -> Unexplained | None:
        return describe(bench, fit, remaining) if remaining else None

    trifle = None if matter else told(remaining)
    return Verdict(name, told(matter), trifle, fit, scanned, before, after, scored, errors, shares, left)


def gate(
    bench: Bench, accepted: Sequence[Accepted], values: Mapping[str, float], ci95: Mapping[str, tuple[float, float]]
) -> list[str]:
    """What keeps a verdict from having a sense: nothing slips, a fit at its bounds, effects such as no mechanism has.

    Args:
        bench: with the declared model's fit.
        accepted: effects that were added.
        values, ci95: parameters of the model that the verdict is about, SI units, and their 95 % intervals.
    """
    reasons = []
    if why := no_slip(bench.problem.recording, bench.mechanism.system):
        reasons.append(why)
    elif bench.estimate.outcome == NO_EXCITATION:
        reasons.append(f"{NO_SLIP}: no friction can be told")
    bounds = bench.problem.space.bounds
    for name in sorted(bench.problem.bounded & bounds.keys() & values.keys()):
        if np.isclose(values[name], [b for b in bounds[name] if b != 0], rtol=AT_END).any():
            reasons.append(f"{name} of the fit ended at its bound, {values[name]:.3g}: widen friction.bounds.{name}")
    found = [(a.candidate.name, impossible(bench, a.candidate, values, ci95)) for a in accepted]
    return reasons + [f"{name} is no answer: {why}" for name, why in found if why]


@dataclass(frozen=True)
class Unexplained:
    """A significant remainder.

    Attributes:
        depends_on: variables, the one that explains most first.
        kind: "force", or "friction" (a share of the dry friction).
        share: of the held-out remainder that the first explains, cross-validated; NaN without held-out trials.
        formula: a short one, or None.
        x, shape, error: the remainder over the first variable, and its standard error, shape (POINTS,).
        unit: of the shape.
        log_p: how significant.
        size: root mean square of its force over that of the friction force.
    """

    depends_on: tuple[str, ...]
    kind: str
    share: float
    formula: str | None
    x: np.ndarray
    shape: np.ndarray
    error: np.ndarray
    unit: str
    log_p: float
    size: float

    @property
    def confirmed(self) -> bool:
        """Whether held-out trials agree that it depends on these variables, where there are any."""
        return not self.share < CONFIRMED


def describe(bench: Bench, fit: Fit, remaining: Sequence[Remaining]) -> Unexplained:
    """Describe what a scan found to remain of a fit, the most significant first."""
    best = remaining[0]
    names = tuple(dict.fromkeys(m.variable for m in remaining if m.log_p < SIMILAR * best.log_p))
    remainder = bench.remainders[best.variable]
    low, high = np.quantile(bench.covered[best.variable], [0.01, 0.99])  # where the data are
    x = np.linspace(low, high, POINTS)
    bumps = remainder.bumps(x, bench.places)
    shape = bumps @ best.coefficients
    error = np.sqrt(np.maximum(np.einsum("ik,kl,il->i", bumps, best.errors, bumps), 0.0))
    share, formula = explained_share(bench, fit, best), sparse_formula(x, shape, error, best.variable)
    unit = bench.mechanism.system.at(remainder.contact).force_unit if best.kind == "force" else "1"
    whole = size(best, *along(bench, best.variable))
    return Unexplained(names, best.kind, share, formula, x, shape, error, unit, best.log_p, whole)


def along(bench: Bench, variable: str) -> tuple[np.ndarray, np.ndarray]:
    """Bumps of a remainder at all samples, shape (n, BUMPS), and the friction force at its contact there, (n,)."""
    remainder = bench.remainders[variable]
    return remainder.bumps(bench.covered[variable], bench.places), bench.forces(remainder.contact)


def size(m: Remaining, bumps: np.ndarray, forces: np.ndarray) -> float:
    """Root mean square of a remainder's force over that of the friction force, what its errors make of it taken out.

    Args:
        bumps: of its variable at samples, shape (n, BUMPS).
        forces: friction force there, shape (n,).
    """
    squared = (bumps @ m.coefficients) ** 2 - np.einsum("ik,kl,il->i", bumps, m.errors, bumps)
    weight = forces**2 if m.kind == "friction" else 1.0
    whole = max(float(np.mean(forces**2)), 1e-300)
    return float(np.sqrt(max(float(np.mean(weight * squared)), 0.0) / whole))


def explained_share(bench: Bench, fit: Fit, found: Remaining) -> float:
    """Share of the held-out residual beyond noise that the remainder, estimated on the fitted trials, explains."""
    checked = check(bench, fit)
    if checked is None:
        return float("nan")
    rows = linearise(bench, checked, found.names)
    columns = [Columns.of(row, Noise()) for row in rows]
    normal = Normal.of(found.names, columns)
    # A fit may take what it lacks for noise; differences from sample to sample do not.
    level = {name: min(1.0, bench.problem.sigmas[name] / sigma) for name, sigma in checked.sigmas.items()}
    floor = 0.0
    for row, column in zip(rows, columns, strict=True):
        noise = sum(level.get(name, 1.0) ** 2 * np.count_nonzero(r) for name, r in zip(row.signals, row.r, strict=True))
        floor += noise * (1 - column.own.shape[1] / len(column.r))
    c = found.coefficients
    gained = -(2 * normal.b @ c + c @ normal.A @ c)
    excess = normal.rr - floor
    return float(np.clip(gained / excess, 0.0, 1.0)) if excess > 0 else float("nan")


@dataclass(frozen=True)
class Network:
    """The fallback term F_net(x) = sum_k w_k exp(-(x - x_k)^2 / h^2), or the law seeing the load N (1 + that sum).

    A network with one hidden layer of radial units: a black box on what remains, no more is known of it than the
    variable x that it depends on. It is one of the project's symbolic effects, so that the model with it is simulated,
    differentiated, saved and folded like any other.

    Attributes:
        effect: the term, as an effect.
        kind: "force", w in the system's unit of force; or "friction", w a share of the dry friction.
        values: weights and the units' places by name, SI units.
        fit: of all parameters and weights together.
        errors: before it and after, see :func:`frictionpinn.diagnose.errors.compare`.
    """

    effect: Remainder
    kind: str
    values: dict[str, float]
    fit: Fit
    errors: dict[str, dict[str, Any]]


def train_network(bench: Bench, fit: Fit, scanned: Scanned) -> Network | None:
    """Train the network through the equation of motion, on the variable with the most significant remainder of a fit.

    None where no fit succeeds.
    """
    best = scanned.remaining[0]
    effect, start = bench.remainders[best.variable], on_probe(bench, fit)
    steps = dict(zip(best.names, best.coefficients, strict=True))
    tried = [bench.refit(start, (*fit.names, *best.names), start.values | weights) for weights in ({}, steps)]
    found = min((f for f in tried if f is not None), key=lambda f: f.state.cost, default=None)
    if found is None:
        return None
    before, after = check(bench, start), check(bench, found)
    pair = (start, found) if before is None or after is None else (before, after)
    values = {name: found.values[name] for name in (*best.names, *effect.place)}
    return Network(effect, best.kind, values, found, compare(bench, pair, scanned.sigmas)[0])
