"""What trials that no fit saw say where the fitted ones leave a parameter open, and where they do not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.diagnose.bench import Bench
from frictionpinn.diagnose.fit import Fit
from frictionpinn.diagnose.held_out import bent, check, compared_gains, held_out_gain, surprise
from frictionpinn.identify.solve import State
from frictionpinn.identify.trial import Piece
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

TRUTH = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 5e-3}
FORCES = "5*sin(2*pi*t)", "8*sin(3*pi*t)", "6*sin(2*pi*t + 0.5*sin(2*pi*t))"


@pytest.fixture(scope="module")
def bench() -> Bench:
    system = SYSTEMS["drive"](M=1.0)
    trials = [{"duration": 1.0, "force": force} for force in FORCES]
    made = GaussianNoise(0.02)(simulate_recording(system, "lugre", TRUTH, trials, 200.0), 0)
    declared = Mechanism(system, LAWS["lugre"]())
    tested = Mechanism(system, declared.law, ("constant_force",))
    return Bench(declared, tested, tested, made.select(made.names[:2]), made.select(made.names[2:]))


def off(fit: Fit, name: str, factor: float, known: bool) -> Fit:
    """The fit with a parameter that is wrong by a factor, and known as well as before or not at all."""
    at, pieces = fit.names.index(name), []
    for piece in fit.state.pieces:
        gg, gl = piece.gg.copy(), piece.gl.copy()
        if not known:
            gg[at], gg[:, at], gl[at] = 0.0, 0.0, 0.0
        pieces.append(replace(piece, gg=gg, gl=gl))
    values = fit.values | {name: factor * fit.values[name]}
    return replace(fit, values=values, state=replace(fit.state, pieces=tuple(pieces)))


def test_what_the_fitted_trials_leave_open_is_left_to_the_held_out_ones(bench):
    fit = bench.base()
    plain = check(bench, fit).state.cost
    wrong = off(fit, "sigma_2", 1.5, known=False)
    assert check(bench, wrong).state.cost > plain + 50
    assert surprise(bench, wrong) < surprise(bench, fit) + 15  # the price of one unknown more


def test_what_the_fitted_trials_tell_is_held_against_the_fit(bench):
    fit = bench.base()
    assert surprise(bench, off(fit, "sigma_2", 1.5, known=True)) > surprise(bench, fit) + 50


def test_a_fit_is_judged_once_and_one_with_other_values_by_itself(bench):
    fit = bench.base()
    assert check(bench, fit) is check(bench, replace(fit, minima=(), searched=True))
    other = replace(fit, values=fit.values | {"mu_c": 1.01 * fit.values["mu_c"]})
    assert check(bench, other).state.cost > check(bench, fit).state.cost


def test_a_gain_is_that_of_the_parameters_as_fitted_where_it_is_enough(bench):
    fit = bench.base()
    wrong = off(fit, "sigma_2", 1.5, known=True)
    plain = check(bench, wrong).state.cost - check(bench, fit).state.cost
    assert held_out_gain(bench, wrong, fit, 1.0) == pytest.approx(plain)
    assert held_out_gain(bench, fit, wrong, 1.0) < -50
    assert held_out_gain(bench, fit, off(fit, "sigma_2", 1.5, known=False), 1.0) > -15


def test_rivals_are_compared_with_what_the_fitted_trials_leave_open_free_to_move(bench):
    fit = bench.base()
    open_, told = (off(fit, "sigma_2", 1.5, known=known) for known in (False, True))
    assert held_out_gain(bench, told, open_, -1.0) == pytest.approx(0.0, abs=1e-6)  # the same parameters
    (gain, none), (loss,) = compared_gains(bench, told, [open_, told]), compared_gains(bench, open_, [told])
    assert gain > 50 and none == 0.0
    assert loss == pytest.approx(-gain)


def test_without_held_out_trials_there_is_nothing_to_say(bench):
    empty = Bench.__new__(Bench)
    empty.__dict__ |= bench.__dict__ | {"checked": None}
    fit = bench.base()
    assert held_out_gain(empty, fit, fit, 1.0) is None and surprise(empty, fit) is None
    assert compared_gains(empty, fit, [fit]) == [0.0]


def test_a_lower_minimum_that_the_held_out_trials_contradict_is_bent_and_one_that_they_bear_out_is_not(bench):
    fit = bench.base()
    wrong = off(fit, "sigma_2", 1.5, known=True)
    assert bent(bench, fit, wrong) and not bent(bench, wrong, fit) and not bent(bench, fit, fit)
    bare = SimpleNamespace(checked=None)
    assert not bent(bare, fit, wrong)


@pytest.mark.parametrize("contradicted", [True, False])
def test_a_fit_settles_in_a_lower_minimum_unless_the_held_out_trials_contradict_it(contradicted):
    def stub(cost):
        return Fit(("mu_c",), {"mu_c": 0.3}, (), State(np.zeros(1), (), (Piece(cost, {}),)), {"v": 0.1})

    own, refitted, lower = stub(105.0), stub(100.0), stub(90.0)
    asked = []
    made = SimpleNamespace(
        problem=SimpleNamespace(loss=SimpleNamespace(sigma=lambda r, n: 0.1)),
        refit=lambda *a: refitted,
        _anew=lambda fit, thorough, starts: lower,
    )
    found = Bench.settle(made, own, lambda old, new: asked.append((old, new)) or contradicted)
    assert asked == [(refitted, lower)]
    assert found.state.cost == (100.0 if contradicted else 90.0)
