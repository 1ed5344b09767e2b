"""Fits of one mechanism with whatever effects are switched on."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis import recorded

from frictionpinn.diagnose import bench as benches
from frictionpinn.diagnose.bench import Bench
from frictionpinn.diagnose.fit import Fit
from frictionpinn.numerics.descent import State
from frictionpinn.physics import EFFECTS, LAWS
from frictionpinn.physics.mechanism import Mechanism

FORCE = 0.3  # N


def bench_of(acting=(), values=None) -> Bench:
    system, made = recorded(acting, values)
    declared = Mechanism(system, LAWS["lugre"]())
    tested = Mechanism(system, declared.law, ("constant_force",))
    return Bench(declared, tested, tested, made.select(made.names[:2]), made.select(()))


@pytest.fixture(scope="module")
def clean() -> Bench:
    return bench_of()


@pytest.fixture(scope="module")
def pushed() -> Bench:
    return bench_of(["constant_force"], {"constant_force": FORCE})


def leaving(*series: dict[str, np.ndarray], span: float = 0.5) -> Fit:
    """A fit with these residuals of each trial."""
    state = SimpleNamespace(pieces=[SimpleNamespace(residuals=r) for r in series])
    models = tuple(SimpleNamespace(outputs=tuple(r), t=0.01 * np.arange(800)) for r in series)
    return Fit((), {}, models, state, {}, span=span)


@pytest.mark.parametrize("seed", range(20))
def test_residuals_like_noise_of_any_size_are_white_with_or_without_outliers(seed):
    rng = np.random.default_rng(seed)
    trials = [{"x": 1e-3 * rng.standard_normal(800), "v": 7.0 * rng.standard_normal(800)} for _ in range(5)]
    assert leaving(*trials).white
    for trial in trials:
        trial["x"][rng.integers(0, 800, 8)] *= 20
        trial["v"][5] = np.nan
    assert leaving(*trials).white


@pytest.mark.parametrize("seed", range(5))
def test_residuals_with_a_wave_far_below_the_noise_are_not_white(seed):
    rng = np.random.default_rng(seed)
    wave = 0.25 * np.sin(np.arange(800) / 25.0 + seed)  # 3 % of the noise's variance
    trials = [{"x": rng.standard_normal(800) + wave, "v": rng.standard_normal(800)} for _ in range(5)]
    assert not leaving(*trials).white
    assert leaving(*({"v": trial["v"]} for trial in trials)).white


def test_the_declared_model_leaves_noise_of_its_own_recording(clean):
    assert clean.base.white


def test_effects_of_the_bench_are_neutral_at_the_start(clean):
    (par,) = EFFECTS["constant_force"]().parameters
    assert clean.base.values["constant_force"] == par.neutral


def test_a_refit_finds_a_force_that_acts_and_nothing_of_one_that_does_not(clean, pushed):
    for bench, truth in ((clean, 0.0), (pushed, FORCE)):
        fit = bench.base
        names = (*fit.names, "constant_force")
        found = bench.refit(fit, names, fit.values | {"constant_force": 0.15}, widths=bench.widths)
        assert found.values["constant_force"] == pytest.approx(truth, abs=0.05)
        assert found.white and found.state.cost < fit.state.cost + 0.1


def test_a_fit_settles_at_the_noise_that_its_residuals_show_and_no_worse_than_it_was(clean):
    fit = clean.base
    louder = replace(fit, sigmas={name: 1.5 * sigma for name, sigma in fit.sigmas.items()})
    found = clean.settle(louder)
    assert found.sigmas == pytest.approx(fit.levels(clean.problem.loss), rel=1e-6)
    assert found.values == pytest.approx(clean.settle(fit).values, rel=1e-2, abs=1e-3)
    assert found.minima and found.minima[0].state is found.state


def test_a_refit_ends_where_it_stands_once_it_takes_more_steps_than_any_model_should(clean, monkeypatch):
    fit = clean.base
    monkeypatch.setattr(benches, "LONGEST", 0.0)
    found = clean.refit(fit, (*fit.names, "constant_force"), fit.values | {"constant_force": 0.3})
    assert found is None or found.values["constant_force"] == pytest.approx(0.3)


def test_what_stays_moves_to_the_minimum_of_the_quadratic_model_without_what_goes():
    S = np.array([[2.0, 1.0, 0.5], [1.0, 3.0, 0.0], [0.5, 0.0, 1.0]])
    piece = SimpleNamespace(gg=S, grad_g=np.zeros(3), grad_l=np.zeros(0))
    names, u = ("mu_c", "drag", "shape"), np.array([0.5, 0.2, 0.3])
    space = SimpleNamespace(limits=(np.full(3, -9.0), np.full(3, 9.0)), to_values=lambda u: u)
    stub = SimpleNamespace(problem_of=lambda *a: SimpleNamespace(space=space), problem=None)
    models = (SimpleNamespace(simulator=None),)
    fit = Fit(names, dict(zip(names, u, strict=True)), models, State(u, (u[:0],), (piece,)), {})
    held = Bench.without(stub, fit, ["drag"], ["shape"])
    assert held == pytest.approx({"mu_c": 0.5 + 0.2 * 1.0 / 2.0, "drag": 0.0, "shape": 0.3})
    free = Bench.without(stub, fit, ["drag"])
    moved = np.linalg.solve(S[np.ix_([0, 2], [0, 2])], -S[[0, 2], 1] * -0.2)
    assert free == pytest.approx({"mu_c": 0.5 + moved[0], "drag": 0.0, "shape": 0.3 + moved[1]})
