"""The equation of a diagnosis as a person reads it: LaTeX, and MathML for the page."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from typing import Any

import sympy as sp
from sympy.core.alphabets import greeks
from sympy.printing.mathml import MathMLPresentationPrinter

from .base import CONTACT
from .contact_friction import ContactFriction
from .mechanism import Mechanism

LETTERS = {*greeks, "zdot"}  # first parts of names that are letters
LOAD = sp.Symbol("N_law")  # the normal force as the law sees it, where effects change it
SHORT = {CONTACT.v: "v", CONTACT.N: "N", CONTACT.z: "z", CONTACT.zdot: "zdot", CONTACT.s: "s", CONTACT.a: "a"}


def equations(mechanism: Mechanism, told: Collection[str] | None = None) -> list[sp.Eq]:
    """Friction force of the law and its effects as each contact sees them; z' of a bristle; the load that effects make.

    In velocity v, acceleration a, position s, normal force N and bristle deflection z; of several contacts with the
    contact's name below.

    Args:
        mechanism: law and effects.
        told: parameters that were estimated; strengths of effects beside them act as nothing. None: all are told.
    """
    table = [par for effect in mechanism.effects for par in effect.parameters_on(mechanism.system, mechanism.law)]
    untold = [par for par in table if told is not None and par.name not in told]
    nothing = {par.symbol: sp.sympify(par.neutral) for par in untold if par.neutral is not None}
    result = []
    for at in mechanism.contacts:
        below, prefix = f"_{at.name}" if at.name else "", f"{at.name}."
        names = {symbol: sp.Symbol(name + below) for symbol, name in (SHORT | {LOAD: LOAD.name}).items()}
        own = [s for s in vars(mechanism.p).values() if s.name.startswith(prefix)]
        names |= {s: sp.Symbol(s.name.removeprefix(prefix) + below) for s in own}
        for name, side in _sides(at, mechanism, nothing):
            written = sp.sympify(side).xreplace(nothing).xreplace(names)
            result.append(sp.Eq(sp.Symbol(name + below), tidy(written, names[CONTACT.v]), evaluate=False))
    return result


def _sides(at: ContactFriction, mechanism: Mechanism, nothing: dict[sp.Symbol, sp.Expr]) -> Iterator[tuple[str, Any]]:
    """Names and right sides of a contact's equations."""
    load = sp.sympify(at.seen.N).xreplace(nothing)
    seen, law, p = at.seen, mechanism.law, mechanism.p
    if load != CONTACT.N:
        seen = replace(seen, N=LOAD)
    yield "F", sp.sympify(at.law.force(seen, at.p)) + sum(e.force(seen, p, law) for e in at.effects)
    if at.law.memory:
        yield "zdot", at.law.bristle_rate(seen, at.p)
    elif at.memory:
        yield "zdot", next(e for e in at.effects if e.memory).bristle_rate(seen, p, law)
    if load != CONTACT.N:
        yield LOAD.name, load


def tidy(expr: sp.Expr, v: sp.Symbol) -> sp.Expr:
    """An expression without the constants that only keep derivatives finite: |v / v_s|^alpha, v the slip velocity."""
    expr = sp.sympify(expr)
    expr = expr.xreplace({number: sp.Integer(0) for number in expr.atoms(sp.Float) if 0 < abs(float(number)) < 1e-9})
    own = {}
    for power in expr.atoms(sp.Pow):
        exponents, scales = power.exp.free_symbols, power.base.free_symbols - {v}
        if v in power.base.free_symbols and len(exponents) == len(scales) == 1:
            own[power] = sp.Pow(sp.Abs(v / scales.pop()), exponents.pop())
    return expr.xreplace(own)


def is_word(symbol: sp.Symbol) -> bool:
    """Whether a name is one that is read as a whole: low_speed is no product, and no l with an index."""
    first = symbol.name.split("_")[0]
    return len(first) > 1 and first not in LETTERS


def _readable(e: sp.Eq) -> sp.Eq:
    """exp(x) as a function: an exponent that is a fraction is too small to read."""
    return sp.Eq(e.lhs, e.rhs.replace(sp.exp, sp.Function("exp")), evaluate=False)


def in_latex(e: sp.Eq) -> str:
    """LaTeX, names that are words upright and whole."""
    e = _readable(e)
    names = {s: rf"\mathrm{{{s.name}}}".replace("_", r"\_") for s in e.free_symbols if is_word(s)}
    return sp.latex(e, mul_symbol="dot", symbol_names=names)


class _Printer(MathMLPresentationPrinter):
    """Words upright and whole, z' with its dot, the terms of a sum below each other."""

    def _print_Symbol(self, sym: sp.Symbol, style: str = "plain") -> Any:
        if sym.name.partition("_")[0] == "zdot":
            over, dot = self.dom.createElement("mover"), self.dom.createElement("mo")
            dot.appendChild(self.dom.createTextNode("\u02d9"))
            over.appendChild(super()._print_Symbol(sp.Symbol("z" + sym.name[4:]), style))
            over.appendChild(dot)
            return over
        if not is_word(sym):
            return super()._print_Symbol(sym, style)
        word = self.dom.createElement("mi")
        word.setAttribute("mathvariant", "normal")
        word.appendChild(self.dom.createTextNode(sym.name))
        return word

    def rows(self, e: sp.Eq) -> Iterator[Any]:
        """Rows of a table: the left side, "=" and the first term, then a row for each other term of a sum."""
        terms = sorted(self._as_ordered_terms(e.rhs), key=lambda term: term.could_extract_minus_sign())
        for k, term in enumerate(terms):
            minus = k > 0 and term.could_extract_minus_sign()
            row = self.dom.createElement("mtr")
            left = [self._print(e.lhs)] if k == 0 else []
            sign = self._operator("=" if k == 0 else "-" if minus else "+")
            for cell in (left, [sign], [self._print(-term if minus else term)]):
                made = self.dom.createElement("mtd")
                for part in cell:
                    made.appendChild(part)
                row.appendChild(made)
            yield row

    def _operator(self, sign: str) -> Any:
        made = self.dom.createElement("mo")
        made.appendChild(self.dom.createTextNode(sign))
        return made


def in_mathml(equations: Iterable[sp.Eq]) -> str:
    """A block of MathML, a row for each term."""
    printer = _Printer({"mul_symbol": "dot"})
    rows = "".join(row.toxml(encoding="ascii").decode() for e in equations for row in printer.rows(_readable(e)))
    return f'<math display="block"><mtable>{rows}</mtable></math>'
