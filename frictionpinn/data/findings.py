"""What speaks against a recording before anything is learned from it: one line each, with what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.constants import g, inch, lbf

from .thresholds import NAMED, OFF
from .units import of_dimension, to_si

NO_SLIP = "nothing slips here"  # begins every finding by which no friction can be told, whatever is asked for

FACTORS = {
    1000.0: "1000", 100.0: "100", 10.0: "10", 180 / math.pi: "57.3 (degrees for radians)", 60.0: "60",
    2 * math.pi: "2 pi (turns for radians)", 30 / math.pi: "9.55 (rpm for rad/s)", g: "9.81 (g)",
    1e3 * inch: "25.4 (inch for mm)", 1 / inch: "39.4 (inch for m)", lbf: "4.45 (lbf for N)",
}  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """One thing that is odd about a recording.

    Attributes:
        what: what was found, where, with its figures.
        fix: what to do.
        grave: no answer from this recording has a sense before it is mended; else the answer may be a poor one.
        spoilt: signal that is not to be compared with others: what that would find follows from this.
    """

    what: str
    fix: str = ""
    grave: bool = False
    spoilt: str = ""

    def __str__(self) -> str:
        return "; ".join(filter(None, [self.what, self.fix]))


def named_factor(ratio: float) -> str:
    """The factor as people know it: "1000", "57.3 (degrees for radians)", else three digits."""
    size = max(abs(ratio), 1 / max(abs(ratio), 1e-300))
    factor = min(FACTORS, key=lambda known: abs(math.log(size / known)))
    return FACTORS[factor] if abs(size / factor - 1) < NAMED else f"{size:.3g}"


def unit_for(factor: float, unit: str) -> str:
    """The unit that a column most likely has whose values are ``factor`` times those in the SI unit ``unit``, or ""."""
    names = [*of_dimension(unit), *(["g"] if unit == "m/s^2" else [])]
    off = {name: abs(factor * float(to_si(np.ones(1), name, unit, "unit")[0]) - 1) for name in names}
    best = min(off, key=off.__getitem__, default="")
    return best if best and off[best] < NAMED else ""


def rescaled(name: str, factor: float, unit: str) -> str:
    """How to read a column that is ``factor`` times what its signal should be."""
    if 1 / OFF < -factor < OFF:
        return f"turn it: data.gains={{{name}: -1}}"
    if factor > 0 and (found := unit_for(factor, unit)):
        return f"give its unit: data.units={{{name}: {found}, default: SI}}"
    return f"correct its unit (data.units), or data.gains={{{name}: {1 / factor:.4g}}}"


def listed(names: Sequence[str]) -> str:
    """Names as a sentence has them: a, b and c."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))
