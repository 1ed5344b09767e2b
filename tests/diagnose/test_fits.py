"""What a fit says of itself, where it starts anew, and when it is given up."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.diagnose import bench as benches
from frictionpinn.diagnose import restarts
from frictionpinn.diagnose.bench import Bench
from frictionpinn.diagnose.candidates import candidates, scales
from frictionpinn.diagnose.diagnosis import _bench
from frictionpinn.diagnose.fit import Fit
from frictionpinn.diagnose.restarts import blunted, lifted, peaked, widened
from frictionpinn.diagnose.select import Settings, _beside_vanished
from frictionpinn.identify import likelihood
from frictionpinn.identify.problem import Problem
from frictionpinn.identify.solve import State
from frictionpinn.physics import EFFECTS, LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

TRUTH = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 5e-3}
TRIALS = [{"duration": 1.0, "force": "5*sin(2*pi*t)"}, {"duration": 1.0, "force": "8*sin(3*pi*t)"}]


@pytest.fixture(scope="module")
def recording():
    return GaussianNoise(0.02)(simulate_recording(SYSTEMS["drive"](M=1.0), "lugre", TRUTH, TRIALS, 200.0), 0)


@pytest.fixture(scope="module")
def made(recording) -> Bench:
    declared = Mechanism(SYSTEMS["drive"](M=1.0), LAWS["lugre"]())
    tested = Mechanism(declared.system, declared.law, ("constant_force",))
    return Bench(declared, tested, tested, recording, recording.select(()))


def leaving(*series: dict[str, np.ndarray]) -> Fit:
    """A fit with these residuals of each trial."""
    state = SimpleNamespace(pieces=[SimpleNamespace(residuals=r) for r in series])
    return Fit((), {}, (), state, {})


@pytest.mark.parametrize("seed", range(20))
def test_white_noise_of_any_size_is_explained_with_or_without_outliers(seed):
    rng = np.random.default_rng(seed)
    trials = [{"x": 1e-3 * rng.standard_normal(800), "v": 7.0 * rng.standard_normal(800)} for _ in range(5)]
    assert leaving(*trials).explains
    for trial in trials:
        trial["x"][rng.integers(0, 800, 8)] *= 20
        trial["v"][5] = np.nan
    assert leaving(*trials).explains


@pytest.mark.parametrize("seed", range(5))
def test_a_wave_far_below_the_noise_is_not_explained(seed):
    rng = np.random.default_rng(seed)
    wave = 0.25 * np.sin(np.arange(800) / 25.0 + seed)  # 3 % of the noise's variance
    trials = [{"x": rng.standard_normal(800) + wave, "v": rng.standard_normal(800)} for _ in range(5)]
    assert not leaving(*trials).explains
    assert leaving(*({"v": trial["v"]} for trial in trials)).explains


def test_a_fit_without_residuals_leaves_nothing():
    assert leaving({"x": np.zeros(100)}).correlation == 0.0


def test_the_declared_model_explains_its_own_recording(made):
    assert made.base().explains


def test_static_friction_that_vanished_starts_anew_within_the_bounds(recording):
    problem = Problem(Mechanism(SYSTEMS["drive"](M=1.0), LAWS["lugre"]()), recording)
    at = problem.space.names.index("v_s")
    low, high = problem.space.low[at], problem.space.high[at]
    starts = peaked(problem, TRUTH | {"mu_s": TRUTH["mu_c"]})
    assert len({s["v_s"] for s in starts}) == len(starts) > 1
    assert all(low < s["v_s"] < high and s["mu_s"] > 1.5 * s["mu_c"] for s in starts)
    assert all(s["sigma_0"] == TRUTH["sigma_0"] for s in starts)
    assert peaked(problem, TRUTH | {"v_s": low}) and peaked(problem, TRUTH) == []


def test_nothing_starts_anew_where_the_law_has_no_static_friction(recording):
    problem = Problem(Mechanism(SYSTEMS["drive"](M=1.0), LAWS["coulomb"]()), recording)
    assert peaked(problem, {"mu_c": 3.0}) == []


def test_friction_that_vanished_is_brought_back_as_a_share_of_the_force(made):
    assert lifted(made.problem, made.sizes, TRUTH) is None
    back = lifted(made.problem, made.sizes, TRUTH | {"sigma_2": 1e-9})
    assert back["sigma_2"] > 0.1 and back["mu_c"] == TRUTH["mu_c"]


@pytest.mark.parametrize(
    ("costs", "peak", "width"),
    [
        ((100.4, 130.0, 101.8, 140.0), 0.5, 1e-4 * 2.5**3),  # as likely, beyond a kink
        ((101.0, 101.0, 95.0, 96.0), 0.5, 1e-4 * 2.5**4),  # likelier
        ((101.0, 95.0, 98.0, 99.0), 0.5, 1e-4 * 2.5**2),
        ((102.0, 103.0, 104.0, 105.0), 0.5, 1e-4),  # told by the data
        ((100.0, 100.0, 100.0, 100.0), 0.31, 1e-4),  # no peak is left
    ],
)
def test_a_peak_is_as_wide_as_the_data_allow(made, monkeypatch, costs, peak, width):
    base, state = made.base(), SimpleNamespace(cost=100.0)
    needle = replace(base, values=base.values | {"mu_c": 0.3, "mu_s": 2.0, "v_s": 1e-4}, state=state)
    monkeypatch.setattr(Fit, "explains", True)

    def refit(fit, names, values, iterations=40):
        if not iterations:
            return fit
        assert "v_s" not in names and values["mu_s"] < needle.values["mu_s"]
        step = round(np.log(values["v_s"] / 1e-4) / np.log(2.5)) - 1
        return replace(fit, values=values | {"mu_s": peak}, state=SimpleNamespace(cost=costs[step]))

    found = widened(SimpleNamespace(problem=made.problem, refit=refit), needle)
    assert found.values["v_s"] == pytest.approx(width)
    monkeypatch.setattr(Fit, "explains", False)
    assert widened(None, needle) is needle


@pytest.mark.parametrize(
    ("untold", "contradicted", "width"),
    [
        (0.0, lambda old, new: True, 2.5**2),  # each is better than the one before, in the order of their costs
        (0.0, lambda old, new: new.values["v_s"] < 2e-4, 2.5),  # the needle alone
        (0.0, lambda old, new: False, 1.0),
        (np.inf, lambda old, new: True, 1.0),  # the data tell the static friction
    ],
)
def test_a_needle_gives_way_to_a_blunter_peak_where_held_out_trials_contradict_it(
    made, monkeypatch, untold, contradicted, width
):
    base = made.base()
    needle = replace(base, values=base.values | {"mu_c": 0.3, "mu_s": 2.0, "v_s": 1e-4})
    monkeypatch.setattr(Fit, "explains", True)
    monkeypatch.setattr(restarts, "OPEN", untold)

    def refit(fit, names, values):
        return replace(fit, values=values, state=SimpleNamespace(cost=fit.state.cost + 1e5 * values["v_s"]))

    found = blunted(SimpleNamespace(refit=refit, clip=dict), needle, contradicted)
    assert found.values["v_s"] == pytest.approx(1e-4 * width)
    assert found is needle or [s.state for s in found.minima] == [found.state, needle.state]


def test_a_search_anew_never_ends_above_the_fit_that_it_starts_from(made):
    fit = made.base()
    found = made._anew(fit, True)
    assert found.state.cost <= fit.state.cost
    assert found.searched
    poor = made.refit(fit, fit.names, fit.values | {"mu_s": 2 * fit.values["mu_s"]}, iterations=1)
    assert made._anew(poor, False).state.cost < fit.state.cost + 1.0


def test_a_refit_finds_a_constant_force_of_nothing_where_there_is_none(made):
    fit = made.base()
    found = made.refit(fit, (*fit.names, "constant_force"), fit.values | {"constant_force": 0.3})
    assert abs(found.values["constant_force"]) < 0.05
    assert found.state.cost < fit.state.cost + 0.1 and found.explains


def test_what_stays_moves_to_the_minimum_of_the_quadratic_model_without_what_goes():
    S = np.array([[2.0, 1.0, 0.5], [1.0, 3.0, 0.0], [0.5, 0.0, 1.0]])
    piece = SimpleNamespace(gg=S, grad_g=np.zeros(3), grad_l=np.zeros(0))
    names, u = ("mu_c", "drag", "shape"), np.array([0.5, 0.2, 0.3])
    space = SimpleNamespace(limits=(np.full(3, -9.0), np.full(3, 9.0)), to_values=lambda u: u)
    stub = SimpleNamespace(problem_of=lambda *a: SimpleNamespace(space=space), problem=None)
    fit = Fit(
        names, dict(zip(names, u, strict=True)), (SimpleNamespace(simulator=None),), State(u, (u[:0],), (piece,)), {}
    )
    held = Bench.without(stub, fit, ["drag"], ["shape"])
    assert held.values == pytest.approx({"mu_c": 0.5 + 0.2 * 1.0 / 2.0, "drag": 0.0, "shape": 0.3})
    free = Bench.without(stub, fit, ["drag"])
    moved = np.linalg.solve(S[np.ix_([0, 2], [0, 2])], -S[[0, 2], 1] * -0.2)
    assert free.values == pytest.approx({"mu_c": 0.5 + moved[0], "drag": 0.0, "shape": 0.3 + moved[1]})


def test_a_fit_settles_at_other_noise_levels_from_the_starts_of_its_search(made, monkeypatch):
    fit = made.search(made.base())
    assert fit.searched and fit.starts
    louder = replace(fit, sigmas={name: 1.5 * sigma for name, sigma in fit.sigmas.items()})
    monkeypatch.setattr(likelihood, "find_start", lambda *a, **k: pytest.fail("looked for starts again"))
    found = made.settle(louder)
    assert found.searched and found.starts == fit.starts
    assert made.estimate.minimum.starts
    assert made.starts[0].keys() == set(made.declared)


def test_a_refit_ends_where_it_stands_once_it_takes_more_steps_than_any_model_should(made, monkeypatch):
    fit = made.base()
    monkeypatch.setattr(benches, "LONGEST", 0.0)
    found = made.refit(fit, (*fit.names, "constant_force"), fit.values | {"constant_force": 0.3})
    assert found.values["constant_force"] == pytest.approx(0.3) and not found.explains


def test_effects_of_the_bench_are_neutral_at_the_start(made):
    (par,) = EFFECTS["constant_force"]().parameters
    assert made.base().values["constant_force"] == par.neutral


def test_candidates_are_tested_beside_static_friction_that_vanished_from_the_fit():
    system = SYSTEMS["drive"](M=1.0)
    clean = simulate_recording(system, "lugre", TRUTH | {"constant_force": 0.3}, TRIALS, 200.0, ["constant_force"])
    made = GaussianNoise(0.02)(clean, 0)
    bench, kinds, _ = _bench(Mechanism(system, LAWS["lugre"]()), made, made.select(()), ["constant_force"], None, {})
    options = candidates(kinds, system, bench.mechanism.law, scales(system, bench.simulate(bench.base())))
    settings, whole = Settings(), bench.base()
    selection = SimpleNamespace(fit=replace(whole, values=whole.values | TRUTH), refused=[], accepted=[])
    assert _beside_vanished(bench, selection, options, settings) == []
    names = tuple(name for name in whole.names if name not in ("mu_s", "v_s"))
    selection.fit = replace(bench.refit(whole, names, whole.values | {"mu_s": whole.values["mu_c"]}), names=whole.names)
    found = _beside_vanished(bench, selection, options, settings)
    assert [t.candidate.effect for t in found] == ["constant_force"]
    assert found[0].beside["mu_s"] > 1.2 * found[0].beside["mu_c"]
    selection.refused = [SimpleNamespace(candidate=options[0])]
    assert _beside_vanished(bench, selection, options, settings) == []
