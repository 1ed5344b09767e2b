"""What is known of a remainder that no name fits: its variables, how much they explain, its shape, a formula."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from sklearn.linear_model import OrthogonalMatchingPursuit

from .bench import Bench
from .evidence import check
from .fit import Fit
from .remainder import BUMPS, Remainder
from .rows import linearise
from .scan import Remaining
from .score import Columns, Normal

SIMILAR = 0.9  # of the best statistic: variables that explain as much are named together
TERMS, GOOD = 3, 0.97  # terms of a formula at most; share of the shape that it must explain
POINTS = 60


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


def describe(
    bench: Bench,
    fit: Fit,
    remaining: Sequence[Remaining],
    remainders: Sequence[Remainder],
    places: dict[str, float],
    covered: dict[str, np.ndarray],
    size: float,
) -> Unexplained:
    """Describe what a scan found to remain.

    Args:
        fit: the model whose remainder it is.
        remaining: of the scan, the most significant first.
        places: hidden parameters of the remainders.
        covered: samples of every variable.
        size: of the first, relative to the friction force.
    """
    best = remaining[0]
    alike = [m for m in remaining if m.log_p < SIMILAR * best.log_p]
    names = tuple(dict.fromkeys(m.variable for m in alike))
    r = next(r for r in remainders if r.variable == best.variable)
    low, high = np.quantile(covered[best.variable], [0.01, 0.99])
    x = np.linspace(low, high, POINTS)
    first, step = (places[name] for name in r.place)
    bumps = np.exp(-((((x - first) / step)[:, None] - np.arange(BUMPS)) ** 2))
    shape, variance = bumps @ best.coefficients, np.einsum("ik,kl,il->i", bumps, best.errors, bumps)
    unit = bench.mechanism.system.force_unit if best.kind == "force" else "1"
    formula = sparse_formula(x, shape, np.sqrt(np.maximum(variance, 0.0)), best.variable)
    share = explained_share(bench, fit, best, places)
    error = np.sqrt(np.maximum(variance, 0.0))
    return Unexplained(names, best.kind, share, formula, x, shape, error, unit, best.log_p, size)


def explained_share(bench: Bench, fit: Fit, found: Remaining, places: dict[str, float]) -> float:
    """Share of the held-out residual beyond noise that the remainder, estimated on the fitted trials, explains."""
    checked = check(bench, fit)
    if checked is None:
        return float("nan")
    names = found.names
    rows = linearise(bench, checked, names, places, probed=True)
    columns = [Columns.of(row, None) for row in rows]
    normal = Normal.of(names, columns)
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


def sparse_formula(x: np.ndarray, y: np.ndarray, error: np.ndarray, name: str) -> str | None:
    """The shortest sum of elementary functions of x that explains the shape, or None.

    Orthogonal matching pursuit over powers, absolute values, an exponential of |x| and harmonics.
    """
    scale = max(float(np.abs(x).max()), 1e-300)
    weight = 1 / np.maximum(error, np.median(error) + 1e-300)
    table = {"1": np.ones_like(x), name: x, f"{name}^2": x**2, f"{name}^3": x**3, f"|{name}|": np.abs(x),
             f"{name}*|{name}|": x * np.abs(x), f"sign({name})": np.sign(x)}  # fmt: skip
    for share in (0.05, 0.2):
        table[f"exp(-|{name}|/{share * scale:.3g})"] = np.exp(-np.abs(x) / (share * scale))
    span = max(float(x.max() - x.min()), 1e-300)
    for k in (1, 2, 3):
        table[f"sin({2 * np.pi * k / span:.3g}*{name})"] = np.sin(2 * np.pi * k * x / span)
        table[f"cos({2 * np.pi * k / span:.3g}*{name})"] = np.cos(2 * np.pi * k * x / span)
    keys = list(table)
    A = np.stack([table[key] for key in keys], axis=1) * weight[:, None]
    target = y * weight
    total = float(target @ target)
    for count in range(1, TERMS + 1):
        model = OrthogonalMatchingPursuit(n_nonzero_coefs=count, fit_intercept=False).fit(A, target)
        left = target - A @ model.coef_
        if total > 0 and 1 - float(left @ left) / total > GOOD:
            terms = [(c, key) for c, key in zip(model.coef_, keys, strict=True) if c != 0]
            return " ".join(f"{c:+.3g}" if key == "1" else f"{c:+.3g}*{key}" for c, key in terms).lstrip("+")
    return None
