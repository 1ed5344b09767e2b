"""The parts of the engine: search coordinates, splines, elimination, derivatives."""

import numpy as np
import pytest
from cases import case
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.identify import Problem
from frictionpinn.identify.space import Space
from frictionpinn.identify.uncertainty import WIDEST, widened
from frictionpinn.numerics.gram import gram
from frictionpinn.numerics.loss import choose_loss
from frictionpinn.numerics.quadratic import Piece, State, reduced
from frictionpinn.numerics.spline_basis import PathBasis, choose_basis
from frictionpinn.numerics.whiteness import correlation_time


def space():
    mechanism, truth, *_ = case("pob", "lugre", (1, 4))
    return Space.build(mechanism, tuple(truth), {name: (v / 10, v * 10) for name, v in truth.items()}, {}, truth), truth


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6))
@settings(max_examples=50, deadline=None)
def test_search_vector_and_values_are_inverse_and_static_friction_stays_above(steps):
    own, truth = space()
    p = np.array([v * 5**x for v, x in zip(truth.values(), steps, strict=True)])
    back = own.to_values(own.to_search(p))
    i, j = own.names.index("mu_s"), own.names.index("mu_c")
    assert back[i] > back[j]
    if p[i] > 1.01 * p[j]:
        assert back == pytest.approx(p, rel=1e-9)


def test_jacobian_of_the_values_is_their_derivative():
    own, truth = space()
    u = own.to_search(np.array(list(truth.values())))
    numeric = [(own.to_values(u + d) - own.to_values(u - d)) / 2e-6 for d in 1e-6 * np.eye(len(u))]
    assert own.jacobian(u) == pytest.approx(np.array(numeric).T, rel=1e-6, abs=1e-12)


def test_spline_pieces_and_design_agree_and_reproduce_polynomials():
    t = np.sort(np.random.default_rng(0).uniform(0, 2, 80))
    basis = PathBasis.evenly(t, 7, 3)
    y = np.stack([t**5 - t, 5 * t**4 - 1, 20 * t**3])
    coefficients, residual = basis.fit(y, np.ones(3))
    assert np.abs(residual).max() < 1e-6
    pieces = basis.path(coefficients)
    assert pieces[:, :, 0] == pytest.approx((basis.design @ coefficients)[:, :-1].T, abs=1e-8)
    end = pieces[-1] @ (t[-1] - t[-2]) ** np.arange(6)
    assert end == pytest.approx(y[:, -1], abs=1e-5)


def test_criterion_takes_more_knots_for_a_faster_motion():
    t, generator = np.arange(800) / 400, np.random.default_rng(0)
    sizes = []
    for w in (6.0, 40.0):
        y = np.stack([np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)])
        sigmas = 0.05 * y.std(axis=1)
        basis = choose_basis(t, y + sigmas[:, None] * generator.standard_normal(y.shape), sigmas, 400)
        sizes.append(basis.size)
    assert sizes[1] > 2 * sizes[0]


@pytest.mark.parametrize(("most", "misses"), [(90, 0.7), (62, 0.7), (48, 0.8), (40, 1.5)])
def test_an_input_stays_a_spline_where_finer_ones_are_not_allowed(most, misses):
    """Taken as it was measured, its noise would move the body."""
    t, generator = np.linspace(0, 2.5, 250), np.random.default_rng(0)
    true = np.sin(2 * np.pi * 3 * t + 0.5 * np.sin(2 * np.pi * 3 * t))
    y = true + 0.03 * generator.standard_normal(len(t))
    basis = choose_basis(t, y[None], np.array([0.03]), most)
    assert basis.size <= most
    found = basis.design[0] @ basis.fit(y[None], np.array([0.03]))[0]
    assert np.std(found - true) < misses * 0.03


def test_an_input_that_no_allowed_spline_follows_is_taken_as_measured():
    t = np.linspace(0, 2.5, 250)
    y = np.sin(2 * np.pi * 25 * t) + 0.03 * np.random.default_rng(0).standard_normal(len(t))
    assert choose_basis(t, y[None], np.array([0.03]), 40) is None


@given(st.integers(1, 60), st.integers(5, 30), st.sampled_from([0.0, 0.5, 0.95]))
@settings(max_examples=60, deadline=None)
def test_weighted_gram_is_the_matrix_product_of_full_rows_and_of_rows_with_few_entries(columns, rows, empty):
    generator = np.random.default_rng(columns + 100 * rows)
    J, r, w = generator.standard_normal((rows, columns)), generator.standard_normal(rows), generator.uniform(0, 2, rows)
    J[generator.random(J.shape) < empty] = 0.0
    H, g = gram(J, r, w)
    assert pytest.approx(J.T @ (w[:, None] * J), abs=1e-10) == H
    assert pytest.approx(J.T @ (w * r), abs=1e-10) == g


@pytest.mark.parametrize("loss", ["gaussian", "robust"])
def test_weights_are_the_derivative_of_the_loss(loss):
    own, r, h = choose_loss(loss, case("drive", "dahl")[0]), np.array([-8.0, -0.5, 0.3, 3.0]), 1e-6
    numeric = [(own.cost(r + d) - own.cost(r - d)) / (2 * h) for d in h * np.eye(4)]
    assert own.weight(r) * r == pytest.approx(numeric, rel=1e-6)


@pytest.mark.parametrize(("system", "law"), [("pob", "lugre"), ("damper", "lugre"), ("sdob", "dahl")])
def test_gradient_is_the_derivative_of_the_cost(system, law):
    mechanism, truth, _, noisy, _ = case(system, law, (1,))
    problem = Problem(mechanism, noisy)
    problem = problem.varied(limits=problem.space.reaching(truth))
    p = np.array([truth[name] for name in problem.names])
    u = problem.space.to_search(p * 1.05)
    models = problem.models_at(u)
    local = [model.local for model in models]
    tight = {"rtol": 1e-8, "atol": 1e-9}
    state = problem.evaluator(models, **tight)(u, local, True)

    def cost(du, dl):
        return problem.evaluator(models, **tight)(u + du, [local[0] + dl], False).cost

    scale = np.sqrt(np.diag(state.pieces[0].gg))
    for i in range(len(u)):
        d = 1e-3 * np.eye(len(u))[i] / scale[i]
        assert (cost(d, 0) - cost(-d, 0)) / (2 * d[i]) == pytest.approx(
            state.pieces[0].grad_g[i], abs=0.02 * scale[i], rel=0.02
        )
    scale = np.sqrt(np.diag(state.pieces[0].ll))
    for i in (0, len(local[0]) // 2, len(local[0]) - 1):
        d = 1e-3 * np.eye(len(local[0]))[i] / scale[i]
        assert (cost(0, d) - cost(0, -d)) / (2 * d[i]) == pytest.approx(
            state.pieces[0].grad_l[i], abs=0.02 * scale[i], rel=0.02
        )


def test_elimination_gives_the_block_of_the_full_inverse():
    mechanism, truth, _, noisy, _ = case("pob", "lugre", (1, 4))
    problem = Problem(mechanism, noisy)
    u = problem.space.to_search(np.array([truth[name] for name in problem.names]))
    models = problem.models_at(u)
    state = problem.evaluator(models)(u, [model.local for model in models], True)
    n, sizes = len(u), [len(piece.grad_l) for piece in state.pieces]
    full, first = np.zeros((n + sum(sizes),) * 2), n
    for piece, size in zip(state.pieces, sizes, strict=True):
        full[:n, :n] += piece.gg
        full[:n, first : first + size], full[first : first + size, :n] = piece.gl, piece.gl.T
        full[first : first + size, first : first + size] = piece.ll
        first += size
    scale = 1 / np.sqrt(np.diag(full))
    expected = (np.linalg.inv(full * scale[:, None] * scale) * scale[:, None] * scale)[:n, :n]
    assert np.linalg.inv(reduced(state)[0]) == pytest.approx(expected, rel=1e-4, abs=1e-9 * np.abs(expected).max())


def test_correlation_time_is_one_for_white_noise_and_longer_for_filtered_noise():
    white = np.random.default_rng(0).standard_normal(5000)
    assert correlation_time([white]) == pytest.approx(1.0, abs=0.2)
    filtered = np.convolve(white, np.ones(8) / 8, "valid")
    assert correlation_time([filtered]) == pytest.approx(8.0, rel=0.3)


@pytest.mark.parametrize(("information", "factor"), [(25.0, 2.0), (400.0, 1.0), (1e-3, WIDEST)])
def test_a_point_that_tells_less_widens_the_interval(information, factor):
    one = Space(("mu_c",), np.array([0.01]), np.array([1.0]), (-1,), np.zeros(1))
    u = np.log([0.1])
    beside = State(u + 0.3, (np.zeros(0),), (Piece(0.0, {}, np.array([[information]]), grad_g=np.zeros(1)),))
    covariance = widened(one, u, np.array([[1e-4]]), [beside], 1.0)
    assert covariance[0, 0] == pytest.approx(1e-4 * factor**2)
