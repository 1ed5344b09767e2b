"""The verdict: what the added effects take off, and whether what is left matters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .bench import Bench
from .candidates import Remainder
from .contest import Settings
from .errors import compare, main_signal
from .fit import Fit
from .held_out import check
from .scan import Remaining, Scanned
from .select import Selection
from .unexplained import Unexplained, describe, size

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
        scored: "held-out trials", or "fitted trials" where none could be held out.
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
    path = [selection.base, *selection.path, selection.fit]
    judged = [check(bench, fit) for fit in path]
    fits = [fit for fit in judged if fit is not None]
    scored = "held-out trials"
    if len(fits) < len(path):
        scored, fits = "fitted trials", path
    errors, excesses = compare(bench, fits, selection.last.sigmas)
    excess = excesses[main_signal(bench.mechanism.system, errors)]

    fit, scanned, before, after = selection.fit, selection.last, fits[0], fits[-1]
    whole: dict[str, Any] = {"value": 1.0, "ci95": [1.0, 1.0]}
    shares = tuple(excess.share(k) for k in range(1, len(selection.accepted) + 1))
    left = excess.share(0) if shares else whole
    remaining = _significant(selection.last.remaining, settings)
    bumps = {r.variable: r.bumps(covered[r.variable], places) for r in remainders}
    matter = [m for m in remaining if size(m, bumps[m.variable], forces) >= settings.worth]
    if not matter:
        name = FOUND if selection.accepted else NOTHING
    elif selection.accepted and not excess.squared[-1] > (1 - FIFTH) * excess.squared[0]:
        name = PARTLY
    else:
        name = UNEXPLAINED
        if selection.accepted:  # the answer is the declared model's: the effects are not what is missing
            fit, scanned, after = selection.base, selection.first, before
            matter = _significant(scanned.remaining, settings) or list(scanned.remaining)
            errors, _ = compare(bench, [before, after], scanned.sigmas)
            shares, left = (), whole

    def told(remaining: Sequence[Remaining]) -> Unexplained | None:
        return describe(bench, fit, remaining, remainders, places, covered, forces) if remaining else None

    trifle = None if matter else told(remaining)
    return Verdict(name, told(matter), trifle, fit, scanned, before, after, scored, errors, shares, left)


def _significant(remaining: Sequence[Remaining], settings: Settings) -> list[Remaining]:
    return [m for m in remaining if m.log_p + np.log10(len(remaining)) < settings.log_p]
