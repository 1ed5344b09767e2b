"""Straight-line arithmetic compiled without types: the numbers that Python gives, and one line for what it is not."""

from __future__ import annotations

import importlib.util
import itertools
import math
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numba.core.errors import NumbaError

from frictionpinn.numerics.straight_line import straight_line

COUNT = itertools.count()
NUMBERS = st.sampled_from(["x[0]", "x[1]", "x[2]", "2", "0.5", "-3", "1.25e-3", "math.pi", "t"])


def grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Expressions of expressions."""
    tests = st.builds("({} {} {})".format, inner, st.sampled_from(["<", "<=", ">", ">=", "==", "!="]), inner)
    truths = (
        st.just("c")
        | tests
        | st.builds("({} and {})".format, tests, tests)
        | st.builds("({} or not {})".format, tests, tests)
    )
    return st.one_of(
        st.builds("({} {} {})".format, inner, st.sampled_from(["+", "-", "*"]), inner),
        st.builds("({} / (1 + {}**2))".format, inner, inner),
        st.builds("{}**{}".format, st.builds("({})".format, inner), st.sampled_from(["0", "1", "2", "3", "5"])),
        st.builds("(1 + abs({}))**{}".format, inner, st.sampled_from(["(-1)", "(-2)", "0.5", "(-1/2)"])),
        st.builds("-{}".format, inner),
        st.builds("math.{}({})".format, st.sampled_from(["sin", "cos", "tanh"]), inner),
        st.builds("math.{}(1 + abs({}))".format, st.sampled_from(["sqrt", "log"]), inner),
        st.builds("math.exp(-abs({}))".format, inner),
        st.builds("{}({}, {})".format, st.sampled_from(["min", "max"]), inner, inner),
        st.builds("({} if {} else {})".format, inner, truths, inner),
    )


def compiled(folder, body: str):
    """The function of that body as Python has it and as it is compiled."""
    name = f"straight_line_{next(COUNT)}"
    path = folder / f"{name}.py"
    path.write_text("import math\n\n\ndef f(x, out):\n" + "".join(f"    {line}\n" for line in body.splitlines()))
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    inner = straight_line(module.f)

    @njit("void(f8[::1],f8[::1])", error_model="numpy")
    def outer(x, out):
        inner(x, out)

    return module.f, outer


@settings(max_examples=60, deadline=None, derandomize=True)  # a comparison of rounded numbers may tip either way
@given(st.lists(st.recursive(NUMBERS, grown, max_leaves=12), min_size=1, max_size=12))
def test_every_expression_is_what_python_makes_of_it(tmp_path_factory, expressions):
    body = ["t = x[0] * x[1] - 1", "c = x[0] > 0.0 or t == 3"]
    body += [f"out[{i}] = {expression}" for i, expression in enumerate(expressions)]
    python, outer = compiled(tmp_path_factory.mktemp("lines"), "\n".join(body))
    for x in ([0.3, -1.2, 2.5], [0.0, 0.0, 1.0], [-2.0, 4.0, -2.0]):
        wanted, found = np.zeros((2, len(expressions)))
        try:
            python(list(x), wanted)
        except (ArithmeticError, ValueError, TypeError):  # no finite real number
            continue
        outer(np.array(x), found)
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)


def test_division_by_zero_and_roots_of_negative_numbers_give_what_ieee_754_says(tmp_path):
    _, outer = compiled(tmp_path, "out[0] = 1 / x[0]\nout[1] = math.sqrt(x[1])\nout[2] = (x[0] - x[0])**(-1)")
    found = np.zeros(3)
    outer(np.array([0.0, -1.0]), found)
    assert found[0] == math.inf and math.isnan(found[1]) and found[2] == math.inf


@pytest.mark.parametrize("body", ["for i in x: pass", "out[0] = x", "out[0] = undefined(x[0])", "out[0], t = 1, 2"])
def test_what_is_no_straight_line_arithmetic_is_refused_with_its_text(tmp_path, body):
    with pytest.raises((NumbaError, NotImplementedError), match="no straight-line arithmetic"):
        compiled(tmp_path, body)
