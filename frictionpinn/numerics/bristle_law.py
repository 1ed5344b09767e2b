"""A friction law with memory by itself, generated from its equations: for contacts simulated without a mechanism."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from types import ModuleType

import sympy as sp

from ..physics import CONTACT, FrictionLaw
from .codegen import equations_key, load_module, module_source
from .torch_functions import numpy_function


class BristleLaw:
    """Force F(v, N, z, z') and bristle rate z'(v, N, z) of a law, as numpy functions and as compiled kernels.

    Args:
        law: with memory.
        held: parameters that stay numbers (``alpha=2`` leaves a square where a power would be).

    Attributes:
        names: the other parameters, in the order of p.
    """

    def __init__(self, law: FrictionLaw, **held: int):
        numbers = {getattr(law.symbols, name): sp.Integer(value) for name, value in held.items()}
        self.names = tuple(par.name for par in law.parameters if par.name not in held)
        self._p = [par.symbol for par in law.parameters if par.name not in held]
        self.force = law.force(CONTACT, law.symbols).xreplace(numbers)
        self.rate = law.bristle_rate(CONTACT, law.symbols).xreplace(numbers)
        self._title = law.name

    @cached_property
    def numpy(self) -> Callable:
        """(v, N, z, *p) -> [F, z'] on arrays that broadcast."""
        force = self.force.xreplace({CONTACT.zdot: self.rate})
        return numpy_function([CONTACT.v, CONTACT.N, CONTACT.z, *self._p], [force, self.rate])

    @cached_property
    def kernels(self) -> ModuleType:
        """``rate`` and ``force``, each ``f(s, w, u, p, out)`` with s = (v, z), w = (z',), u = (N,).

        ``rate`` writes (z', dz'/dz), ``force`` (F,); entries that are identically zero are not written.
        """
        c = CONTACT
        places = {c.v: "s[0]", c.z: "s[1]", c.zdot: "w[0]", c.N: "u[0]"}
        places |= {symbol: f"p[{i}]" for i, symbol in enumerate(self._p)}
        functions = {"rate": [self.rate, sp.diff(self.rate, c.z)], "force": [self.force]}
        key = equations_key(f"{sp.srepr(list(functions.values()))} {places}")
        return load_module(f"{key}_law", lambda: module_source(self._title, functions, places))
