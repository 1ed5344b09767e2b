"""Changes of an input path that acts late: all at once as one by one."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.numerics.delay import shift_directions, shift_pieces
from frictionpinn.numerics.directions import Directions
from frictionpinn.numerics.paths import DEGREE, InputPath

NAMES = ("theta", "omega", "alpha")


def local_directions(count: int, n: int, seed: int) -> tuple[np.ndarray, dict[str, InputPath], Directions]:
    generator = np.random.default_rng(seed)
    t = np.cumsum(generator.uniform(0.5, 1.5, n)) * 0.01
    paths = {}
    for k in generator.permutation(count):
        coefficients = np.zeros((n - 1, len(NAMES), DEGREE + 1))
        first = int(generator.integers(0, n - 2))
        coefficients[first : first + 6] = generator.standard_normal(coefficients[first : first + 6].shape)
        paths[f"c[{k}]"] = InputPath(NAMES, t, coefficients)
    return t, paths, Directions.of(paths, next(iter(paths.values())))


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 1000), shifts=st.tuples(*[st.floats(-0.05, 0.05)] * 2))
def test_directions_act_late_as_each_path_does(seed, shifts):
    t, paths, directions = local_directions(7, 40, seed)
    late = {0: shifts[0], 2: shifts[1]}
    expected = {}
    for name, path in paths.items():
        coefficients = path.coefficients.copy()
        for column, shift in late.items():
            coefficients[:, [column]] = shift_pieces(t, path.coefficients[:, [column]], shift)
        expected[name] = InputPath(NAMES, t, coefficients)
    expected = Directions.of(expected, path)
    found = shift_directions(t, directions, late)
    assert list(found) == list(expected)
    size = np.abs(expected.coefficients).max()
    assert np.abs(found.coefficients[found.order] - expected.coefficients[expected.order]).max() <= 1e-9 * size
    assert np.abs(found.samples[found.order] - expected.samples[expected.order]).max() <= 1e-9 * size
    assert (np.diff(found.support[:, 0]) >= 0).all()


def test_what_stands_beside_directions_comes_first_in_name_and_where_it_first_acts():
    t, _, directions = local_directions(4, 30, 1)
    whole = InputPath(NAMES, t, np.ones((29, len(NAMES), DEGREE + 1)))
    found = directions.beside(Directions.of({"delay": whole}, whole))
    assert list(found) == ["delay", *directions]
    assert np.array_equal(found.coefficients[found.order[0]], whole.coefficients)
    assert np.array_equal(found.coefficients[found.order[1:]], directions.coefficients[directions.order])
    assert tuple(found.support[found.order[0]]) == (0, 28)
