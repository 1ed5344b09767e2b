"""Compiled functions generated from the symbolic physics, kept on disk between processes."""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from threading import RLock
from types import ModuleType

import numba
import numpy as np
import pooch
import sympy as sp
from numba.core.types.function_type import CompileResultWAP
from sympy.printing.pycode import PythonCodePrinter

from ..physics import CONTACT
from ..physics.base import at_contact
from ..physics.mechanism import Mechanism
from .partial import Partials

log = logging.getLogger(__name__)

VERSION = 5  # of this generator and of straight_line, which compiled code in the cache is made by
_LOADING = RLock()  # a module that another thread is still loading lacks its functions

_HEADER = '''"""{title}"""

import math

from numba import njit

from frictionpinn.numerics.straight_line import straight_line

SIGNATURE = "void(f8[::1],f8[::1],f8[::1],f8[::1],f8[::1])"

'''

_FUNCTION = """

@straight_line
def _{name}(s, w, u, p, out):
{body}


@njit(SIGNATURE, cache=True, fastmath=False, error_model="numpy", nogil=True, no_cpython_wrapper=True)
def {name}(s, w, u, p, out):
    _{name}(s, w, u, p, out)
"""


class _Printer(PythonCodePrinter):
    def __init__(self):
        super().__init__({"fully_qualified_modules": True})

    def _print_sign(self, expr: sp.Expr) -> str:
        x = self._print(expr.args[0])
        return f"(1.0 if ({x}) > 0.0 else (-1.0 if ({x}) < 0.0 else 0.0))"


def _localised(expressions: Sequence[sp.Expr], local: Mapping[sp.Symbol, sp.Symbol]) -> list[sp.Expr]:
    """Expressions in these symbols, b^(e + n) written as b^e b^n, so that a power and its derivative share one
    evaluation; what they share is rewritten once."""
    made: dict[sp.Basic, sp.Basic] = dict(local)

    def written(expr: sp.Basic) -> sp.Basic:
        if expr not in made:
            new = expr.func(*map(written, expr.args)) if expr.args else expr
            if new.is_Pow and new.exp.is_Add and (number := new.exp.as_coeff_Add()[0]).is_Integer:
                new = sp.Pow(new.base, new.exp - number, evaluate=False) * sp.Pow(new.base, number)
            made[expr] = new
        return made[expr]

    return [written(expr) for expr in expressions]


def _function_source(name: str, expressions: list[sp.Expr], arguments: dict[sp.Symbol, str]) -> str:
    """Source of ``name(s, w, u, p, out)`` that writes every expression which is not identically zero."""
    local = {symbol: sp.Symbol(place.replace("[", "").rstrip("]"), real=True) for symbol, place in arguments.items()}
    wanted = [i for i, expr in enumerate(expressions) if expr != 0]
    written = _localised([expressions[i] for i in wanted], local)
    steps, results = sp.cse(written, symbols=sp.numbered_symbols("c"), optimizations=None)
    used = set().union(*(e.free_symbols for _, e in steps), *(e.free_symbols for e in results))
    printer = _Printer()
    lines = [f"{short.name} = {arguments[symbol]}" for symbol, short in local.items() if short in used]
    lines += [f"{symbol.name} = {printer.doprint(expr)}" for symbol, expr in steps]
    lines += [f"out[{i}] = {printer.doprint(expr)}" for i, expr in zip(wanted, results, strict=True)]
    return _FUNCTION.format(name=name, body="\n".join("    " + line for line in lines or ["pass"]))


def module_source(title: str, functions: dict[str, list[sp.Expr]], arguments: dict[sp.Symbol, str]) -> str:
    """Source of a module; ``arguments`` say where a symbol stands in the functions' vectors (``s[0]``)."""
    parts = [_function_source(name, expressions, arguments) for name, expressions in functions.items()]
    return _HEADER.format(title=title) + "".join(parts)


def equations_key(text: str) -> str:
    """Hash of the equations in ``text``, of this generator and of numba."""
    return hashlib.sha256(f"{VERSION} {numba.__version__} {text}".encode()).hexdigest()[:20]


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """Folder of the generated code: ``FRICTIONPINN_CACHE``, else the user's cache; a temporary one if not writable."""
    folder = Path(os.environ.get("FRICTIONPINN_CACHE") or pooch.os_cache("frictionpinn")) / "compiled"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        temporary = Path(tempfile.mkdtemp(prefix="frictionpinn-"))
        log.warning("cache folder %s cannot be written (%s): compiling into %s", folder, error.strerror, temporary)
        return temporary


def load_module(stem: str, source) -> ModuleType:
    """Import the generated module ``stem``; ``source()`` writes its text where no process has done so before."""
    with _LOADING:
        path = cache_folder() / f"{stem}.py"
        if not path.exists():
            with tempfile.NamedTemporaryFile("w", dir=path.parent, suffix=".tmp", delete=False) as handle:
                handle.write(source())
            os.replace(handle.name, path)
        name = f"frictionpinn_compiled_{stem}"
        if name in sys.modules:
            return sys.modules[name]
        spec = importlib.util.spec_from_file_location(name, path)
        if spec is None or spec.loader is None:
            raise ImportError(f"cannot load {path}")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # numba looks the module up by name when it loads compiled code
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
        return module


class Pointer:
    """A compiled kernel as an address: numba finds type and address of a function anew each time, 50 us a call."""

    def __init__(self, function):
        compiled = CompileResultWAP(function.get_compile_result(function.nopython_signatures[0]))
        self._numba_type_ = numba.types.FunctionType(compiled.signature())
        self.compiled, self.address = compiled, compiled.__wrapper_address__()

    def __wrapper_address__(self) -> int:
        return self.address


pointer = lru_cache(maxsize=None)(Pointer)


@dataclass(frozen=True)
class Kernels:
    """Compiled functions of one mechanism, each ``f(s, w, u, p, out)`` on contiguous float64 vectors.

    State s = (q, v, states of effects, z) of sizes (n_free, n_free, states, bristles), unknown w = (a, rates of those
    states, z'), inputs u (with the clocks last that enter the equations) and parameters p as in
    :class:`Mechanism`. ``out`` is flat and row-major; entries that are identically zero are not written, so hand
    over zeros.

    * ``newton``: R (n_w), dR/ds (n_w, n_s), dR/dw (n_w, n_w), least normal force (1).
    * ``parameters``: what ``newton`` writes, then dR/dp (n_w, n_p) and dR/du (n_w, n_u).
    * ``outputs``: slip velocity, normal force, friction force of every contact (3 contacts), then the required force of
      an imposed motion (1): n_o.
    * ``output_derivatives``: derivatives of the outputs, (n_o, n_s + n_w + n_p + n_u), in the order s, w, p, u.

    The files' names hold a hash of the equations: equal equations are compiled once on a machine.
    """

    mechanism: Mechanism

    def __reduce__(self):
        return type(self), (self.mechanism,)  # compiled code is loaded anew in the other process

    @cached_property
    def symbols(self) -> tuple[list[sp.Symbol], ...]:
        """Symbols of s, w, u and p."""
        m = self.mechanism
        memory = [state.symbol for state in m.states] + [contact.z for contact in m.bristles]
        rates = [state.rate for state in m.states] + [contact.zdot for contact in m.bristles]
        state = [c.symbols[0] for c in m.free] + [c.symbols[1] for c in m.free] + memory
        unknown = [c.symbols[2] for c in m.free] + rates
        inputs = [*m.inputs, *m.clocks]
        return state, unknown, inputs, [par.symbol for par in m.parameters]

    @cached_property
    def sizes(self) -> tuple[int, int, int, int]:
        """Lengths of s, w, u and p."""
        return tuple(len(symbols) for symbols in self.symbols)  # type: ignore[return-value]

    @cached_property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, those of contacts as :class:`.simulation.Simulation` has them."""
        at = (at_contact(contact, name) for contact in self.contacts for name in ("v_slip", "N", "F"))
        return (*at, *(self.mechanism.predictions if self.mechanism.system.massless else ()))

    @property
    def outputs(self) -> int:
        """Number n_o of outputs."""
        return len(self.output_names)

    @cached_property
    def contacts(self) -> tuple[str, ...]:
        """Names of the contacts."""
        return tuple(contact.name for contact in self.mechanism.contacts)

    @cached_property
    def bristles(self) -> np.ndarray:
        """Contact of each bristle, in the order of the state, shape (bristles,)."""
        return np.array([k for k, contact in enumerate(self.mechanism.contacts) if contact.memory], dtype=np.int64)

    @cached_property
    def places(self) -> np.ndarray:
        """Contact of each state behind the velocities, those that have such states counted from 0."""
        contacts = [k for k, contact in enumerate(self.mechanism.contacts) for _ in contact.states]
        return np.unique([*contacts, *self.bristles], return_inverse=True)[1].astype(np.int64)

    @cached_property
    def _arguments(self) -> dict[sp.Symbol, str]:
        return {
            symbol: f"{vector}[{i}]"
            for vector, symbols in zip("swup", self.symbols, strict=True)
            for i, symbol in enumerate(symbols)
        }

    @cached_property
    def _outputs(self) -> list[sp.Expr]:
        found = [
            sp.sympify(expr)
            for contact in self.mechanism.contacts
            for expr in (contact.motion[CONTACT.v], contact.motion[CONTACT.N], contact.friction)
        ]
        return [*found, self.mechanism.required] if self.mechanism.system.massless else found

    @cached_property
    def key(self) -> str:
        """Hash that names the files."""
        return equations_key(sp.srepr((*self.mechanism.residuals, *self._outputs)) + repr(self.symbols))

    @cached_property
    def _partials(self) -> Partials:
        return Partials()

    def _derivatives(self, expressions: Sequence[sp.Expr], symbols: list[sp.Symbol]) -> list[sp.Expr]:
        by_symbol = [self._partials(expressions, symbol) for symbol in symbols]
        return [own[k] for k in range(len(expressions)) for own in by_symbol]

    def _source(self, functions: dict[str, list[sp.Expr]]) -> str:
        return module_source(self.mechanism.name, functions, self._arguments)

    def _newton(self) -> list[sp.Expr]:
        (state, unknown, _, _), rows = self.symbols, list(self.mechanism.residuals)
        least = sp.Min(*self._outputs[1::3], evaluate=False) if len(self.mechanism.contacts) > 1 else self._outputs[1]
        return [*rows, *self._derivatives(rows, state), *self._derivatives(rows, unknown), least]

    def _plain_source(self) -> str:
        return self._source({"newton": self._newton(), "outputs": self._outputs})

    def _sensitivity_source(self) -> str:
        (state, unknown, inputs, parameters), rows = self.symbols, self.mechanism.residuals
        by_parameter, by_input = self._derivatives(rows, parameters), self._derivatives(rows, inputs)
        by_all = self._derivatives(self._outputs, [*state, *unknown, *parameters, *inputs])
        return self._source({"parameters": [*self._newton(), *by_parameter, *by_input], "output_derivatives": by_all})

    @cached_property
    def plain(self) -> ModuleType:
        """Module with ``newton`` and ``outputs``."""
        return load_module(f"{self.key}_plain", self._plain_source)

    @cached_property
    def sensitivity(self) -> ModuleType:
        """Module with ``parameters`` and ``output_derivatives``."""
        return load_module(f"{self.key}_sensitivity", self._sensitivity_source)

    def settles(self, names: Sequence[str]) -> bool:
        """Whether these parameters enter the rates of effects' states, on which it depends where those rest."""
        first, count = len(self.mechanism.free), len(self.mechanism.states)
        rates = self.mechanism.residuals[first : first + count]
        return any(row.has(sp.Symbol(name, real=True)) for row in rates for name in names)

    def strengths(self, names: tuple[str, ...]):
        """Function that writes dR/dp (n_w, len(names)) and then the derivatives of the outputs (n_o, len(names))."""
        symbols = [par.symbol for par in self.mechanism.parameters if par.name in names]
        symbols.sort(key=lambda symbol: names.index(symbol.name))

        def source() -> str:
            return self._source({"strengths": self._derivatives([*self.mechanism.residuals, *self._outputs], symbols)})

        return load_module(f"{self.key}_{equations_key(' '.join(names))[:8]}_strengths", source).strengths
