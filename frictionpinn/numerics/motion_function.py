"""Expressions of a motion as numerical functions of its samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import sympy as sp

from ..physics.base import CONTACT, V_T
from ..physics.friction import CoulombViscous
from ..physics.system import System


@lru_cache(maxsize=256)  # asked for of every trial
def _compiled(arguments: tuple[sp.Symbol, ...], expr: sp.Expr) -> Callable:
    return sp.lambdify(arguments, expr, modules="numpy", cse=True)


def sliding_friction(view: System, mu_c: sp.Expr | float, sigma_2: sp.Expr | float) -> sp.Expr:
    """Dry and viscous friction of a contact along samples that slide: its sign is as sharp as can be."""
    p = SimpleNamespace(mu_c=mu_c, sigma_2=sigma_2, v_t=V_T.low)
    return CoulombViscous().force(replace(CONTACT, v=view.v_slip, N=view.N), p)


def motion_function(system: System, expr: sp.Expr) -> Callable:
    """Return f(signals, p) -> samples, shape (n,), of an expression of the motion, the inputs and parameters.

    ``signals`` are samples by name, shape (n,), SI units, 0 where one is missing; ``p`` values by name, SI units.
    """
    symbols = {s: n for c in system.moving for s, n in zip(c.symbols, c.signals, strict=True)}
    symbols |= {item.symbol: item.name for item in system.inputs}
    wanted = [s for s in symbols if s in expr.free_symbols]
    parameters = sorted((s for s in expr.free_symbols if s not in symbols), key=str)
    compiled = _compiled((*wanted, *parameters), expr)

    def function(signals: Mapping[str, np.ndarray], p: Mapping[str, float]) -> np.ndarray:
        n = len(next(iter(signals.values())))
        columns = [signals.get(symbols[s], np.zeros(n)) for s in wanted]
        return np.broadcast_to(np.asarray(compiled(*columns, *(p[str(s)] for s in parameters)), float), (n,))

    return function
