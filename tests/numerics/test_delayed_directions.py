"""Changes of an input path that acts late: all at once as one by one."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import check_answers, coefficient_paths, values

from frictionpinn.numerics.delay import shift_pieces
from frictionpinn.numerics.directions import Directions
from frictionpinn.numerics.paths import DEGREE, InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.numerics.spline_basis import PathBasis
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

NAMES = ("f", "theta", "omega", "alpha")


def splines(n: int, seed: int) -> tuple[np.ndarray, list, dict[str, InputPath]]:
    """A motion and a force on an uneven clock, knots ten samples apart, and each coefficient as a path of its own."""
    t = np.cumsum(np.random.default_rng(seed).uniform(0.5, 1.5, n)) * 0.01
    made = [("theta", (1, 2, 3), PathBasis.evenly(t, n // 10, 3)), ("f", (0,), PathBasis.evenly(t, n // 20, 1))]
    return t, made, coefficient_paths(NAMES, t, made)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 1000), shifts=st.lists(st.floats(-0.05, 0.05), min_size=3, max_size=3))
def test_directions_act_late_as_each_path_does(seed, shifts):
    t, made, paths = splines(60, seed)
    late = dict(zip((0, 1, 3), shifts, strict=True))  # the rate between them is prompt
    expected = {}
    for name, path in paths.items():
        coefficients = path.coefficients.copy()
        for column, shift in late.items():
            coefficients[:, [column]] = shift_pieces(t, path.coefficients[:, [column]], shift)
        expected[name] = InputPath(NAMES, t, coefficients)
    expected = Directions.of(expected, path)
    found = Directions.of_splines(t, len(NAMES), made).late(late)
    assert list(found) == list(expected)
    told, own = found.samples[found.order], expected.samples[expected.order]
    # Where a knot or an end comes between two samples the one follows it at six times, the other from the nearer on.
    wrong, size = np.abs(told - own), np.abs(own).max(axis=(0, 1))
    assert (wrong.max(axis=(0, 1)) <= 0.1 * size).all()
    for column, shift in late.items():
        inside = np.abs(t[:, None] - shift - t[[0, -1]]).min(axis=1) > 0.02
        assert wrong[:, inside, column].max() <= 1e-3 * size[column]
    assert np.abs(found.first[found.order] - told[:, 0]).max() <= 1e-9 * np.abs(own).max()
    assert (np.diff(found.support[:, 0]) >= 0).all()
    acts = (np.abs(found.coefficients) > 0).any(axis=(2, 3))
    for (first, last), own in zip(found.support, acts, strict=True):
        assert not own[:first].any() and not own[last + 1 :].any()


def test_what_stands_beside_directions_comes_first_in_name_and_where_it_first_acts():
    t, made, _ = splines(40, 1)
    directions = Directions.of_splines(t, len(NAMES), made)
    whole = InputPath(NAMES, t, np.ones((39, len(NAMES), DEGREE + 1)))
    found = directions.beside(Directions.of({"delay": whole}, whole))
    assert list(found) == ["delay", *directions]
    assert np.array_equal(found.coefficients[found.order[0]], whole.coefficients)
    assert np.array_equal(found.coefficients[found.order[1:]], directions.coefficients[directions.order])
    assert tuple(found.support[found.order[0]]) == (0, 38)


def test_a_motion_answers_to_coefficients_of_a_late_path_as_to_each():
    simulator = Simulator(Mechanism(SYSTEMS["pob"](), LAWS["lugre"](), ("sensor_delay",)), as_shown=True)
    t = np.linspace(0, 0.6, 241)
    swing = {"theta": 0.3 * np.sin(6 * t), "omega": 1.8 * np.cos(6 * t), "alpha": -10.8 * np.sin(6 * t)}
    signals = {name: swing.get(name, np.zeros(len(t))) for name in simulator.mechanism.input_signals}
    path = InputPath.from_signals(simulator.mechanism, t, signals)
    p = dict.fromkeys(simulator.parameter_names, 0.0) | SYSTEMS["pob"]().values | values("lugre")
    p["sensor_delay_x_v_a"] = 0.004  # all that is predicted is late alike: the inputs act late instead
    columns = tuple(path.names.index(name) for name in swing)
    check_answers(simulator, path, p, [("theta", columns, PathBasis.evenly(t, 12, 3))], 2e-3)  # one sample at the start
