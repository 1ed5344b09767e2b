"""What a residual costs: the Gaussian log-likelihood, or one with heavy tails that outliers cannot dominate."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from ..errors import choose
from ..physics.mechanism import Mechanism

# Degrees of freedom of Student's t: of Gaussian noise the errors are 1.6 % above the least (with 4, a common choice,
# 5.8 %), and a jump of 20 standard deviations that comes a sample late costs 21 where a square costs 200
# (benchmarks/identify_loss.py).
NU = 10.0
QUANTILES = 100_000  # of a Gaussian, over which its spread is averaged: exact to 1e-5


class Loss:
    """Cost r^2 / 2 of a residual r in units of its noise's standard deviation.

    Attributes:
        robust: whether outliers count little.
        spread: standard deviation of Gaussian noise, in units of the level that :meth:`sigma` gives it.
    """

    robust = False
    spread = 1.0

    def cost(self, r: np.ndarray) -> float:
        """Sum over all residuals."""
        return 0.5 * float(np.vdot(r, r))

    def weight(self, r: np.ndarray) -> np.ndarray:
        """Derivative of the cost divided by r, shape of r."""
        return np.ones_like(r)

    def sigma(self, r: np.ndarray, freedom: float) -> float:
        """Most likely noise standard deviation of residuals r, shape (n,), with ``freedom`` degrees of freedom."""
        return float(np.sqrt(np.vdot(r, r) / freedom))

    def inflation(self, r: np.ndarray) -> float:
        """Factor on the inverse of the weighted normal matrix that makes it the covariance, from residuals r."""
        return 1.0


class StudentT(Loss):
    """Negative log-likelihood of Student's t with nu degrees of freedom: (nu + 1) / 2 log(1 + r^2 / nu).

    The weight (nu + 1) / (nu + r^2) falls to 0 for an outlier, so that it is left out, and Gauss-Newton with these
    weights is the usual iteratively reweighted least squares. The noise level is that of the t distribution's scale.

    Source: Lange, Little and Taylor, J. Am. Stat. Assoc. 84 (1989).
    """

    robust = True

    def __init__(self, nu: float = NU):
        self.nu = nu

    @cached_property
    def spread(self) -> float:  # type: ignore[override]
        """1 / s with E[(nu + 1) x^2 / (nu s^2 + x^2)] = 1 for Gaussian x of deviation 1."""
        x = norm.ppf((np.arange(QUANTILES) + 0.5) / QUANTILES)
        return 1 / brentq(lambda s: float(np.mean(self.weight(x / s) * (x / s) ** 2)) - 1, 0.1, 2.0)

    def cost(self, r: np.ndarray) -> float:
        return 0.5 * (self.nu + 1) * float(np.log1p(r**2 / self.nu).sum())

    def weight(self, r: np.ndarray) -> np.ndarray:
        return (self.nu + 1) / (self.nu + r**2)

    def sigma(self, r: np.ndarray, freedom: float) -> float:
        sigma = 1.4826 * float(np.median(np.abs(r))) or 1e-300
        for _ in range(50):
            new = float(np.sqrt(np.sum(self.weight(r / sigma) * r**2) / freedom))
            if abs(new - sigma) < 1e-6 * sigma:
                break
            sigma = new
        return sigma

    def inflation(self, r: np.ndarray) -> float:
        weight = self.weight(r)
        slope = np.mean(weight * (self.nu - r**2) / (self.nu + r**2))
        return float(np.mean((weight * r) ** 2) * np.mean(weight) / slope**2)


LOSSES = {"gaussian": Loss(), "robust": StudentT()}


def choose_loss(name: str, mechanism: Mechanism) -> Loss:
    """Return the loss of that name; :class:`UserError` for an unknown one.

    "auto" is robust for a law without memory: its force jumps within a sample, and a model that is a sample late makes
    an outlier of a jump that the noise hides from :func:`frictionpinn.numerics.jumps.beside_jumps`.
    """
    auto = LOSSES["gaussian" if mechanism.law.memory else "robust"]
    return choose(name, {"auto": auto} | LOSSES, "loss")
