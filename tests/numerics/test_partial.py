"""Partial derivatives of expressions with shared parts: those of sympy, to the last symbol."""

from __future__ import annotations

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.numerics.partial import Partials
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.effects import effects_for
from frictionpinn.physics.mechanism import Mechanism

X, Y = sp.symbols("x y", real=True)


def grown(inner: st.SearchStrategy[sp.Expr]) -> st.SearchStrategy[sp.Expr]:
    """Expressions of expressions."""
    one = st.sampled_from([sp.exp, sp.tanh, sp.sin, sp.Abs, sp.sign, sp.atan, lambda e: sp.log(1 + e**2)])
    return st.one_of(
        st.builds(lambda a, b: a + b, inner, inner),
        st.builds(lambda a, b: a * b, inner, inner),
        st.builds(lambda a, b: a / (1 + b**2), inner, inner),
        st.builds(lambda a, b: (1 + a**2) ** b, inner, inner),
        st.builds(lambda f, a: f(a), one, inner),
        st.builds(lambda a, b, c: sp.Piecewise((a, c > 0), (b, True)), inner, inner, inner),
        st.builds(sp.Max, inner, inner),
    )


EXPRESSIONS = st.recursive(st.sampled_from([X, Y, sp.Integer(2), sp.Rational(1, 3), sp.pi]), grown, max_leaves=8)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.lists(EXPRESSIONS, min_size=1, max_size=3))
def test_derivatives_are_those_of_sympy(expressions):
    partials = Partials()
    for symbol in (X, Y):
        assert partials(expressions, symbol) == [sp.diff(e, symbol) for e in expressions]


@pytest.mark.parametrize(("system", "law"), [("pob", "lugre"), ("damper", "stribeck"), ("two_mass", "coulomb")])
def test_the_equations_of_a_mechanism_with_every_effect_have_the_same_derivatives(system, law):
    built, law = SYSTEMS[system](), LAWS[law]()
    mechanism = Mechanism(built, law, tuple(effects_for(built, law)))
    rows, partials = list(mechanism.residuals), Partials()
    for symbol in sorted(set().union(*(row.free_symbols for row in rows)), key=str):
        assert partials(rows, symbol) == [sp.diff(row, symbol) for row in rows]
