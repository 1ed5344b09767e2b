"""A curve in a few elementary functions."""

from __future__ import annotations

import numpy as np

TERMS = 3  # of a formula at most: longer ones say no more than a table
GOOD = 0.97  # share of the shape that a formula must explain


def sparse_formula(x: np.ndarray, y: np.ndarray, error: np.ndarray, name: str) -> str | None:
    """The shortest sum of elementary functions of x that explains the shape, or None.

    Orthogonal matching pursuit over powers, absolute values, exponentials of |x| and harmonics; all shape (n,).
    """
    from sklearn.linear_model import OrthogonalMatchingPursuit  # half a second, and seldom needed

    scale, span = max(float(np.abs(x).max()), 1e-300), max(float(x.max() - x.min()), 1e-300)
    weight = 1 / np.maximum(error, np.median(error) + 1e-300)
    table = {"1": np.ones_like(x), name: x, f"{name}^2": x**2, f"{name}^3": x**3, f"|{name}|": np.abs(x),
             f"{name}*|{name}|": x * np.abs(x), f"sign({name})": np.sign(x)}  # fmt: skip
    for part in (0.05, 0.2):  # of the largest |x|: a narrow peak and a broad one
        table[f"exp(-|{name}|/{part * scale:.3g})"] = np.exp(-np.abs(x) / (part * scale))
    for k in (1, 2, 3):  # periods over the range: eight bumps show hardly more
        table[f"sin({2 * np.pi * k / span:.3g}*{name})"] = np.sin(2 * np.pi * k * x / span)
        table[f"cos({2 * np.pi * k / span:.3g}*{name})"] = np.cos(2 * np.pi * k * x / span)
    A, target = np.stack(list(table.values()), axis=1) * weight[:, None], y * weight
    total = float(target @ target)
    for count in range(1, TERMS + 1):
        model = OrthogonalMatchingPursuit(n_nonzero_coefs=count, fit_intercept=False).fit(A, target)
        left = target - A @ model.coef_
        if total > 0 and 1 - float(left @ left) / total > GOOD:
            terms = [(c, key) for c, key in zip(model.coef_, table, strict=True) if c != 0]
            return " ".join(f"{c:+.3g}" if key == "1" else f"{c:+.3g}*{key}" for c, key in terms).lstrip("+")
    return None
