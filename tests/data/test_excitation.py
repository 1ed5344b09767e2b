"""Expressions of time in configurations: what they mean, and that nothing else gets through."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frictionpinn.data.excitation import parse_expression
from frictionpinn.errors import UserError
from frictionpinn.numerics.paths import sample_expression
from frictionpinn.physics.system import TIME

T = np.linspace(0, 2, 201)


@pytest.mark.parametrize(
    "text, function",
    [
        ("35*deg*sin(2*pi*t)", lambda t: np.deg2rad(35) * np.sin(2 * np.pi * t)),
        ("45*deg*sin(w*t + 0.45*sin(w*t))", lambda t: np.deg2rad(45) * np.sin(5.65 * t + 0.45 * np.sin(5.65 * t))),
        ("-(t - 1)**2 / 4 + 1e-3", lambda t: -((t - 1) ** 2) / 4 + 1e-3),
        ("tanh(t)*exp(-t)*sqrt(t + 1)*cos(t)", lambda t: np.tanh(t) * np.exp(-t) * np.sqrt(t + 1) * np.cos(t)),
        ("abs(t - 1.003) + sign(t - 1.003)", lambda t: np.abs(t - 1.003) + np.sign(t - 1.003)),
        ("0.5", lambda t: np.full_like(t, 0.5)),
        (2, lambda t: np.full_like(t, 2.0)),
    ],
)
def test_an_expression_means_what_it_says(text, function):
    position, velocity, acceleration = sample_expression(parse_expression(text, "data.theta", {"w": 5.65}), T, text)
    np.testing.assert_allclose(position, function(T), atol=1e-12)
    smooth = np.abs(T - 1.003) > 0.01
    h = 1e-4
    np.testing.assert_allclose(velocity[smooth], ((function(T + h) - function(T - h)) / (2 * h))[smooth], atol=1e-5)
    second = (function(T + h) - 2 * function(T) + function(T - h)) / h**2
    np.testing.assert_allclose(acceleration[smooth], second[smooth], atol=1e-3)


@pytest.mark.parametrize(
    "text, character",
    [
        ("__import__('os').system('ls')", 1),
        ("t.real", 1),
        ("2*(lambda: t)()", 3),
        ("[t for t in (1,)]", 1),
        ("t if t else 0", 1),
        ("sin(t, t)", 1),
        ("sin", 1),
        ("2*sinn(t)", 3),
        ("2*w0*t", 3),
        ("t**t", 4),
        ("9**9**9", 4),
        ("((9**64)**64)**64", 2),
        ("1/0", 3),
        ("1e999*t", 1),
        ("sin(t", 4),
        ("2 t", 3),
        ("'text'", 1),
        ("True", 1),
        ("t := 2", 3),
        ("", 1),
    ],
)
def test_anything_else_is_refused_with_its_place(text, character):
    with pytest.raises(UserError, match=rf"data\.theta, character {character}\b") as caught:
        parse_expression(text, "data.theta")
    assert "\n" not in str(caught.value)


def test_a_misspelt_name_is_suggested():
    with pytest.raises(UserError, match="did you mean 'omega'"):
        parse_expression("omga*t", constants={"omega": 1.0})


@pytest.mark.parametrize("name", ["t", "pi", "sin", "2w", "a b"])
def test_a_constant_must_not_take_a_name_in_use(name):
    with pytest.raises(UserError, match="constant"):
        parse_expression("t", constants={name: 1.0})


def test_values_that_are_not_finite_name_the_time():
    with pytest.raises(UserError, match="t = 0 s"):
        sample_expression(parse_expression("1/t"), T, "1/t")


@given(st.text(max_size=60))
def test_no_text_does_anything_but_parse_or_be_refused(text):
    try:
        value = parse_expression(text)
    except UserError as error:
        assert "\n" not in str(error)
    else:
        assert value.free_symbols <= {TIME}


@given(st.recursive(
    st.sampled_from(["t", "pi", "deg", "w"]) | st.floats(0.1, 9).map(lambda x: f"{x:.3f}"),
    lambda inner: st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda x: f"({x[0]} {x[1]} {x[2]})")
    | st.tuples(st.sampled_from(["sin", "cos", "tanh", "abs"]), inner).map(lambda x: f"{x[0]}({x[1]})"),
    max_leaves=6,
))  # fmt: skip
def test_expressions_agree_with_python(text):
    names = {"pi": math.pi, "deg": math.pi / 180, "w": 5.65, "t": 0.7, "abs": abs}
    names |= {name: getattr(math, name) for name in ("sin", "cos", "tanh")}
    expected = eval(text, {"__builtins__": {}}, names)
    value = float(parse_expression(text, constants={"w": 5.65}).subs(TIME, 0.7))
    assert value == pytest.approx(expected, rel=1e-9, abs=1e-9)
