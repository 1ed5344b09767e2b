"""Fits of one mechanism with whatever effects are switched on."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis import recorded

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.diagnose import bench as benches
from frictionpinn.diagnose import contenders
from frictionpinn.diagnose.bench import Bench
from frictionpinn.diagnose.candidates import candidates, scales
from frictionpinn.diagnose.fit import Fit
from frictionpinn.diagnose.scan import scan
from frictionpinn.diagnose.select import Settings, select
from frictionpinn.numerics import descent
from frictionpinn.numerics.quadratic import Piece, State
from frictionpinn.physics import EFFECTS, LAWS, SYSTEMS
from frictionpinn.physics.contacts import law_named
from frictionpinn.physics.effects import effects_for
from frictionpinn.physics.mechanism import Mechanism

FORCE = 0.3  # N


def bench_of(acting=(), values=None) -> Bench:
    system, made = recorded(acting, values)
    declared = Mechanism(system, LAWS["lugre"]())
    effects = effects_for(system, declared.law, ["constant_force"])
    return Bench(declared, effects, (), made.select(made.names[:2]), made.select(()))


@pytest.fixture(scope="module")
def clean() -> Bench:
    return bench_of()


@pytest.fixture(scope="module")
def pushed() -> Bench:
    return bench_of(["constant_force"], {"constant_force": FORCE})


def leaving(*series: dict[str, np.ndarray], span: float = 0.5) -> Fit:
    """A fit with these residuals of each trial."""
    state = State(np.zeros(0), (), tuple(Piece(0.0, r) for r in series))
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


def gone_wrong(bench: Bench, right: Fit, factor: float) -> Fit:
    """A fit of the same parameters that ended elsewhere, and higher."""
    far = {name: factor * right.values[name] for name in ("sigma_0", "mu_s", "v_s")}
    wrong = bench.refit(right, ("mu_c",), right.values | far)
    assert wrong.state.cost > right.state.cost + 100
    problem = bench.problem_of(bench.problem, right.names, wrong.values, wrong.models[0].simulator)
    there = problem.evaluator(wrong.models, wrong.sigmas)(problem.space.to_search(wrong.values), wrong.locals, True)
    return replace(wrong, names=right.names, state=there)


def test_of_two_fits_each_wrong_in_another_trial_one_is_put_together_that_is_right_in_both(pushed):
    right = pushed.refit(pushed.base, (*pushed.declared, "constant_force"), pushed.base.values)
    problem = pushed.problem_of(pushed.problem, right.names, right.values, right.models[0].simulator)

    def begun_wrong(trial: int) -> Fit:
        own = [1.5 * local if k == trial else local for k, local in enumerate(right.locals)]
        return replace(right, state=problem.evaluator(right.models, right.sigmas)(right.state.u, own, True))

    one, other = begun_wrong(0), begun_wrong(1)
    assert min(one.state.cost, other.state.cost) > right.state.cost + 10
    assert pushed.together((one, other)).state.cost == pytest.approx(right.state.cost, abs=0.5)


@pytest.mark.parametrize(
    ("steps", "promised", "white", "asked", "anew"),
    [
        (20, 0.0, False, [[0.0]], 0),
        (1, 0.0, False, [[0.0], "coarse"], 1),
        (1, 0.0, True, [[0.0], "coarse"], 0),
        (20, 1e6, False, [[0.0], "coarse"], 0),
    ],
    ids=["as promised", "no end", "no end beside noise", "much less than promised"],
)
def test_a_refit_without_end_or_short_of_its_promise_begins_at_the_coarse_resolution_too_and_without_end_a_trial_anew(
    pushed, monkeypatch, steps, promised, white, asked, anew
):
    add, widths, regained = contenders.add, [], []

    def seen(bench, fit, tested, own):
        widths.append("coarse" if own == bench.from_coarse else own)
        return add(bench, fit, tested, own)

    monkeypatch.setattr(contenders, "add", seen)
    monkeypatch.setattr(Bench, "regained", lambda bench, fit: regained.append(fit) or fit)
    monkeypatch.setattr(Fit, "white", white)
    monkeypatch.setitem(descent.CLOSELY, "iterations", steps)
    candidate = SimpleNamespace(name="constant_force", strengths=("constant_force",), hidden=())
    shape = {"width": 0.0, "untested": False, "shape": {}, "step": {"constant_force": FORCE}}
    head = SimpleNamespace(candidate=candidate, statistic=promised, **shape)
    (found,) = contenders.refitted(pushed, pushed.base, [(head, [])], Settings())
    assert widths == asked
    assert len(regained) == anew
    assert found.fit.state.cost < pushed.base.state.cost - 10


def test_where_an_effect_leads_out_of_a_wrong_minimum_the_model_without_it_follows_and_settles_there():
    bench = bench_of(["constant_force"], {"constant_force": FORCE})
    right, wrong = bench.base, gone_wrong(bench, bench.base, 1.5)
    bench.base = replace(wrong, sigmas={name: 1.2 * sigma for name, sigma in wrong.sigmas.items()})
    effect = EFFECTS["constant_force"]()
    options = candidates(
        [effect], bench.mechanism.system, bench.mechanism.law, scales(bench.mechanism.system, bench.runs)
    )
    found = select(bench, options, Settings())
    assert [a.candidate.name for a in found.accepted] == ["constant_force"]
    assert found.base.sigmas == pytest.approx(right.levels(bench.problem.loss), rel=0.02)
    there = bench.refit(right, right.names, right.values, sigmas=found.base.sigmas)
    assert found.base.state.cost == pytest.approx(there.state.cost, abs=2.0)
    assert found.fit.values["constant_force"] == pytest.approx(FORCE, rel=0.1)


def motion(bench: Bench, fit: Fit, values) -> np.ndarray:
    """What a fit's own unknowns of the trials lead to at other values of the parameters."""
    models = [replace(model, simulator=bench.simulator) for model in fit.models]
    runs = [model.predict(model.simulate(values, x)) for model, x in zip(models, fit.locals, strict=True)]
    return np.concatenate(runs, axis=1)


def test_a_mechanism_that_moves_alike_begins_with_its_bristle_as_far_bent():
    system, law = SYSTEMS["drive"](), law_named("lugre", "friction")
    truth = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 5e-3}
    trials = [{"duration": 1.5, "force": "8*sin(9*t)"}, {"duration": 1.5, "force": "6*sin(7*t + 0.5*sin(7*t))"}]
    clean = simulate_recording(system, "lugre", truth | {"gain_error_force": -0.05}, trials, 100.0, ["gain_error"])
    effects, noisy = effects_for(system, law, ["gain_error", "inertia"]), GaussianNoise(0.02)(clean, 0)
    bench = Bench(Mechanism(system, law), effects, (), noisy, clean.select(()))
    weak = bench.refit(bench.base, (*bench.declared, "gain_error_force"), bench.base.values)
    more = 1 / (1 + weak.values["gain_error_force"])  # (1 + g) F = M a + F_f is F = (M a + F_f) / (1 + g)
    heavy = {name: more * weak.values[name] for name in ("sigma_0", "sigma_1", "sigma_2", "mu_c", "mu_s")}
    values = weak.values | heavy | {"gain_error_force": 0.0, "inertia": (more - 1) * system.values["M"]}
    begins = bench._followed(weak, (*bench.declared, "inertia"), values)
    as_it_is = motion(bench, weak, weak.values)
    np.testing.assert_allclose(motion(bench, begins, values), as_it_is, atol=1e-6 * np.abs(as_it_is).max())


def test_a_force_that_goes_from_one_mass_to_the_other_strains_the_coupling_and_leaves_the_motion():
    system, law = SYSTEMS["two_mass"](), law_named("coulomb_viscous", "friction")
    truth = {f"{at}.{name}": value for at in ("motor", "load")
             for name, value in (("mu_c", 0.2), ("sigma_2", 0.01))}  # fmt: skip
    trials = [{"duration": 2.0, "tau": "1.2*sin(6*t)"}, {"duration": 2.0, "tau": "0.8*sin(4*t) + 0.4*sin(19*t)"}]
    clean = simulate_recording(system, "coulomb_viscous", truth | {"load.constant_force": 0.1}, trials, 100.0,
                               ["constant_force@load"])  # fmt: skip
    effects = effects_for(system, law, ["constant_force@load", "constant_force@motor"])
    bench = Bench(Mechanism(system, law), effects, (), GaussianNoise(0.02)(clean, 0), clean.select(()))
    load = bench.refit(bench.base, (*bench.declared, "load.constant_force"), bench.base.values)
    swapped = load.values | {"load.constant_force": 0.0, "motor.constant_force": load.values["load.constant_force"]}
    names = (*bench.declared, "motor.constant_force")

    as_it_is = motion(bench, load, load.values)
    left = motion(bench, load, swapped) - as_it_is
    follows = motion(bench, bench._followed(load, names, swapped), swapped) - as_it_is
    assert np.sqrt(np.mean(follows**2)) < 0.2 * np.sqrt(np.mean(left**2))
    motor = bench.imitated(load, names, swapped)
    assert load.values["load.constant_force"] == pytest.approx(0.1, rel=0.2)
    # Not told apart; a lower minimum may be found on the way, a worse one may not.
    assert load.state.cost - Settings().told_apart < motor.state.cost < load.state.cost + 2.0


def test_what_shapes_an_effect_keeps_to_the_values_tried_and_settles_where_it_was_judged():
    acting = {"position_gradient": 3.0, "position_middle": 0.0}
    system, made = recorded(["position_friction"], acting)
    declared = Mechanism(system, LAWS["lugre"]())
    bench = Bench(declared, effects_for(system, declared.law, ["position_friction"]), (), made, made.select(()))
    given = candidates(bench.tested.effects, system, declared.law, scales(system, bench.runs))
    (bump,) = [c for c in given if c.group == "bump"]
    (tested,) = scan(bench, bench.base, [bump]).tested
    fit = contenders.add(bench, bench.base, tested, [0.0])
    for name in bump.hidden:
        tried = [point[name] for point in bump.grid]
        assert 0.99 * min(tried) <= fit.values[name] <= 1.01 * max(tried)  # of the motion as fitted or measured
    assert bench.refit(fit, fit.names, fit.values).state.cost < fit.state.cost + 0.1
