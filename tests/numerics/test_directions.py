"""Changes of an input path in the coefficients of splines: group by group as path by path."""

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import check_answers, coefficient_paths, values
from scipy.interpolate import BSpline

from frictionpinn.numerics.directions import Directions
from frictionpinn.numerics.paths import DEGREE, InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.numerics.spline_basis import PathBasis
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME

NAMES = ("f", "q", "v", "a")


def splines(seed: int, n: int) -> tuple[np.ndarray, list, dict[str, InputPath]]:
    """A motion and a force on an uneven clock, and each of their coefficients as a path of its own."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 1.5, n)) * 0.01
    motion, force = (PathBasis.evenly(t, int(rng.integers(1, n // 3)), orders) for orders in (3, 1))
    made = [("q", (1, 2, 3), motion), ("f", (0,), force)]
    return t, made, coefficient_paths(NAMES, t, made)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 1000), n=st.integers(12, 60))
def test_those_of_splines_are_those_of_each_coefficients_path(seed, n):
    t, made, paths = splines(seed, n)
    found, expected = Directions.of_splines(t, len(NAMES), made), Directions.of(paths, paths["q[0]"])
    assert list(found) == list(expected)
    assert np.array_equal(found.support[found.order], expected.support[expected.order])
    for part in ("coefficients", "samples", "first"):
        one, other = getattr(found, part)[found.order], getattr(expected, part)[expected.order]
        assert np.abs(one - other).max() <= 1e-9 * np.abs(other).max()


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 1000), n=st.integers(12, 60))
def test_a_path_of_a_basis_is_its_spline_between_the_samples_too(seed, n):
    t, ((_, _, basis), _), _ = splines(seed, n)
    values = np.random.default_rng(seed + 1).standard_normal(basis.size)
    knots = np.concatenate([[t[0]] * DEGREE, t[list(basis.breaks)], [t[-1]] * DEGREE])
    spline, path = BSpline(knots, values, DEGREE), basis.path(values)
    middle = (t[1:] - t[:-1]) / 2
    for order in range(3):
        expected = spline.derivative(order)(t[:-1] + middle)
        told = np.sum(path[:, order] * middle[:, None] ** np.arange(DEGREE + 1), axis=1)
        assert np.abs(told - expected).max() <= 1e-9 * max(np.abs(spline.derivative(order)(t)).max(), 1e-12)


@pytest.mark.parametrize("system", ["pob", "sdob"])
def test_a_motion_answers_to_groups_of_coefficients_as_to_each(system):
    simulator = Simulator(Mechanism(SYSTEMS[system](), LAWS["lugre"]()))
    t = np.linspace(0, 0.6, 241)
    driven, made = simulator.mechanism.driven, []
    expressions = {c.signals[0]: 0.3 * sp.sin(6 * TIME + k) for k, c in enumerate(driven)}
    path = InputPath.from_expressions(simulator.mechanism, t, expressions)
    for c in driven:
        columns = tuple(path.names.index(name) for name in c.signals)
        made.append((c.signals[0], columns, PathBasis.evenly(t, 7, 3)))
    check_answers(simulator, path, values("lugre"), made, 1e-8)
