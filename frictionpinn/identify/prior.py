"""What is known of static friction and Stribeck velocity before any recording: enough to keep a search from nowhere.

Few samples tell these two. Where a search has one of them at an end of its range, the other shows no more, and the
likelihood is flat: from there no descent comes back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from .space import Space
from .trial import Piece

EXCESS = 0.5  # (mu_s - mu_c) / mu_c: dry contacts have 0.1 to 2
SPREADS = {"mu_s": 1.0, "v_s": 1.5}  # standard deviations of the logarithm: 95 % within factors of 7 and 19


@dataclass(frozen=True)
class Prior:
    """A log-normal prior, as rows A u = b of unit standard deviation beside those of the data.

    log((mu_s - mu_c) / mu_c) is about log 0.5, and v_s about a fiftieth of the slip velocity (root mean square).
    Intervals are those of the likelihood alone.

    Attributes:
        rows: A, shape (n, n_u).
        target: b, shape (n,).
        about: what is expected, by parameter, in words.
        start: value where v_s is expected, by name.
    """

    rows: np.ndarray
    target: np.ndarray
    about: dict[str, str]
    start: Mapping[str, float]

    @classmethod
    def of(cls, space: Space, start: Mapping[str, float], fixed: Mapping[str, float]) -> Prior:
        """The prior of those of the two that are free in the space; v_s is expected where it starts."""
        rows: list[np.ndarray] = []
        target: list[float] = []
        about: dict[str, str] = {}
        for name, spread in SPREADS.items():
            if name not in space.names:
                continue
            i = space.names.index(name)
            row, lower = np.zeros(len(space.names)), space.below[i]
            row[i] = 1.0
            expected = float(start[name])
            if name == "mu_s" and lower >= 0:
                row[lower], value = -1.0, np.log(EXCESS)
                about[name] = f"{1 + EXCESS:g} mu_c, its excess over mu_c within a factor of {np.exp(2 * spread):.2g}"
            else:
                expected = (1 + EXCESS) * fixed["mu_c"] if name == "mu_s" and "mu_c" in fixed else expected
                value = np.log(expected)
                about[name] = f"{expected:.2g}, within a factor of {np.exp(2 * spread):.2g}"
            rows.append(row / spread)
            target.append(value / spread)
        return cls(
            np.array(rows).reshape(len(rows), len(space.names)),
            np.array(target),
            about,
            {n: start[n] for n in SPREADS if n in start},
        )

    @classmethod
    def none(cls) -> Prior:
        """No prior."""
        return cls(np.zeros((0, 0)), np.zeros(0), {}, {})

    @property
    def information(self) -> np.ndarray:
        """What it adds to the information on u, shape (n_u, n_u)."""
        return self.rows.T @ self.rows

    def cost(self, u: np.ndarray) -> float:
        """Half the squared distance, in standard deviations."""
        r = self.rows @ u - self.target
        return 0.5 * float(r @ r)

    def added(self, piece: Piece, u: np.ndarray) -> Piece:
        """A trial's contribution with this one."""
        r = self.rows @ u - self.target
        changed = replace(piece, cost=piece.cost + 0.5 * float(r @ r))
        if not len(piece.gg):
            return changed
        return replace(changed, gg=piece.gg + self.information, grad_g=piece.grad_g + self.rows.T @ r)
