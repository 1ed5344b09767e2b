"""Partial derivatives of expressions that share most of their parts."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp


class Partials:
    """Derivatives of expressions by sympy's own rules, each shared part differentiated once for a symbol.

    sympy walks an expression as a tree and asks every node for its symbols anew: what the equations of a mechanism
    share, accelerations above all, it walks hundreds of times. The results are the same expressions.
    """

    def __init__(self) -> None:
        self._symbols: dict[sp.Basic, frozenset[sp.Basic]] = {}

    def __call__(self, expressions: Sequence[sp.Expr], symbol: sp.Symbol) -> list[sp.Expr]:
        """d expression / d symbol of each."""
        made: dict[sp.Expr, sp.Expr] = {}
        return [self._partial(expr, symbol, made) for expr in expressions]

    def _within(self, expr: sp.Basic) -> frozenset[sp.Basic]:
        found = self._symbols.get(expr)
        if found is None:
            own = [self._within(arg) for arg in expr.args]
            found = self._symbols[expr] = frozenset().union(*own) if own else frozenset(expr.free_symbols)
        return found

    def _partial(self, expr: sp.Expr, x: sp.Symbol, made: dict[sp.Expr, sp.Expr]) -> sp.Expr:
        if x not in self._within(expr):
            return sp.S.Zero
        found = made.get(expr)
        if found is None:
            found = made[expr] = self._by_rule(expr, x, made)
        return found

    def _by_rule(self, expr: sp.Expr, x: sp.Symbol, made: dict[sp.Expr, sp.Expr]) -> sp.Expr:
        args = expr.args
        if expr.is_Add:
            return sp.Add(*[self._partial(arg, x, made) for arg in args])
        if expr.is_Mul:
            each = [(k, self._partial(arg, x, made)) for k, arg in enumerate(args)]
            return sp.Add(*[sp.Mul(*args[:k], d, *args[k + 1 :]) for k, d in each if d != 0])
        if expr.is_Pow:
            base, power = (self._partial(arg, x, made) for arg in args)
            return expr * (power * sp.log(expr.base) + base * expr.exp / expr.base)
        if isinstance(expr, sp.Piecewise):
            return sp.Piecewise(*[(self._partial(value, x, made), where) for value, where in args])
        if isinstance(expr, sp.Function) and type(expr)._eval_derivative is sp.Function._eval_derivative:
            each = [(k, self._partial(arg, x, made)) for k, arg in enumerate(args, start=1)]
            return sp.Add(*[expr.fdiff(k) * d for k, d in each if d != 0])
        return sp.diff(expr, x)
