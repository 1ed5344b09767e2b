"""The verdict: what the added effects take off, and whether what is left matters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .bench import Bench
from .errors import along, compare, main_signal
from .evidence import check
from .fit import Fit
from .remainder import BUMPS, Remainder
from .scan import Remaining, Scanned
from .select import Selection, Settings
from .unexplained import Unexplained, describe

FOUND, NOTHING, PARTLY, UNEXPLAINED = "effect found", "nothing missing", "partly explained", "unexplained"
FIFTH = 0.2  # of the squared error beyond the noise: names that take off less are not the names of what is missing


@dataclass(frozen=True)
class Verdict:
    """What is said of a selection.

    Attributes:
        name: "effect found": nothing is left that matters; "nothing missing": neither was there before;
            "partly explained": held-out trials confirm the added effects, and what is left matters; "unexplained": no
            effects, or such as take off less than a fifth of the squared error beyond the noise.
        rest: the significant remainder that matters, or None.
        trifle: one that is significant, but smaller than ``Settings.worth``, where no other is left.
        fit, scanned: the model that the verdict is about, and what is known at it.
        before, after: declared and augmented model on the trials of ``scored``.
        errors: see :func:`frictionpinn.diagnose.errors.compare`.
        shares: of the squared error beyond the noise by which errors are quoted first: what each effect took off when
            it was added, {value, ci95}.
        left: the share that is left.
    """

    name: str
    rest: Unexplained | None
    trifle: Unexplained | None
    fit: Fit
    scanned: Scanned
    before: Fit
    after: Fit
    scored: str
    errors: dict[str, Any]
    shares: tuple[dict[str, Any], ...]
    left: dict[str, Any]


def judge(
    bench: Bench,
    selection: Selection,
    remainders: Sequence[Remainder],
    places: Mapping[str, float],
    covered: Mapping[str, np.ndarray],
    forces: np.ndarray,
    settings: Settings,
) -> Verdict:
    """Judge a selection.

    Args:
        remainders, places: see :func:`frictionpinn.diagnose.scan.scan`.
        covered: samples of every remainder's variable, shape (n,) each.
        forces: friction force at the same samples, shape (n,).
    """

    def words(fit: Fit, remaining: Sequence[Remaining]) -> Unexplained:
        by = {m.names: size(m, places, covered[m.variable], forces) for m in remaining}
        return describe(bench, fit, remaining, remainders, dict(places), dict(covered), by[remaining[0].names])

    path = [selection.base, *selection.path, selection.fit]
    scored, judged = "held-out trials", [check(bench, fit) for fit in path]
    fits = [fit for fit in judged if fit is not None]
    if len(fits) < len(path):
        scored, fits = "fitted trials", path
    errors = compare(bench, fits[0], fits[-1], selection.last.sigmas)
    excess = along(bench, fits, selection.last.sigmas, main_signal(bench.mechanism.system, errors))
    left = _significant(selection.last.remaining, settings)
    matter = [m for m in left if size(m, places, covered[m.variable], forces) >= settings.worth]
    rest = trifle = None
    fit, scanned = selection.fit, selection.last
    if not matter:
        name = FOUND if selection.accepted else NOTHING
        trifle = words(fit, left) if left else None
    elif selection.accepted and not excess.squared[-1] > (1 - FIFTH) * excess.squared[0]:
        name, rest = PARTLY, words(fit, matter)
    else:
        name, own = UNEXPLAINED, matter
        if selection.accepted:
            fit, scanned, fits = selection.base, selection.first, [fits[0]] * 2
            own = _significant(scanned.remaining, settings) or list(scanned.remaining)
            errors = compare(bench, fits[0], fits[1], scanned.sigmas)
        rest = words(fit, own)
    many = len(selection.accepted) if fit is selection.fit else 0
    shares = tuple(excess.share(k) for k in range(1, many + 1))
    whole = {"value": 1.0, "ci95": [1.0, 1.0]}
    return Verdict(name, rest, trifle, fit, scanned, fits[0], fits[-1], scored, errors, shares,
                   excess.share(0) if many else whole)  # fmt: skip


def size(m: Remaining, places: Mapping[str, float], x: np.ndarray, forces: np.ndarray) -> float:
    """Root mean square of a remainder's force over that of the friction force, what its errors make of it taken out.

    Args:
        x: samples of its variable, shape (n,).
        forces: friction force there, shape (n,).
    """
    first, step = places[f"{m.variable}_from"], places[f"{m.variable}_step"]
    bumps = np.exp(-((((x - first) / step)[:, None] - np.arange(BUMPS)) ** 2))
    squared = (bumps @ m.coefficients) ** 2 - np.einsum("ik,kl,il->i", bumps, m.errors, bumps)
    whole = max(float(np.mean(forces**2)), 1e-300)
    weight = forces**2 if m.kind == "friction" else 1.0
    return float(np.sqrt(max(float(np.mean(weight * squared)), 0.0) / whole))


def _significant(remaining: Sequence[Remaining], settings: Settings) -> list[Remaining]:
    return [m for m in remaining if m.log_p + np.log10(len(remaining)) < settings.log_p]
