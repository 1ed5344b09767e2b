"""What trials that no fit saw say where the fitted ones leave a parameter open, and where they do not."""

from __future__ import annotations

from dataclasses import replace

import pytest
from test_diagnosis import recorded

from frictionpinn.diagnose.bench import Bench
from frictionpinn.diagnose.fit import Fit
from frictionpinn.diagnose.held_out import check, surprise
from frictionpinn.physics import LAWS
from frictionpinn.physics.mechanism import Mechanism


def bench_of(held_out: int) -> Bench:
    system, made = recorded()
    declared = Mechanism(system, LAWS["lugre"]())
    tested = Mechanism(system, declared.law, ("constant_force",))
    return Bench(declared, tested, tested, made.select(made.names[:2]), made.select(made.names[3 - held_out :]))


@pytest.fixture(scope="module")
def bench() -> Bench:
    return bench_of(1)


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
    fit = bench.base
    plain = check(bench, fit).state.cost
    wrong = off(fit, "sigma_2", 1.5, known=False)
    assert check(bench, wrong).state.cost > plain + 50
    assert surprise(bench, wrong).moved < surprise(bench, fit).moved + 15  # the price of one unknown more


def test_what_the_fitted_trials_tell_is_held_against_the_fit(bench):
    fit = bench.base
    assert surprise(bench, off(fit, "sigma_2", 1.5, known=True)).moved > surprise(bench, fit).moved + 50


def test_checking_a_fit_leaves_its_parameters_as_they_are(bench):
    fit = bench.base
    judged = check(bench, fit)
    assert judged.values == fit.values and len(judged.models) == 1
    other = replace(fit, values=fit.values | {"mu_c": 1.01 * fit.values["mu_c"]})
    assert check(bench, other).state.cost > judged.state.cost


def test_without_held_out_trials_there_is_nothing_to_say():
    bench = bench_of(0)
    assert check(bench, bench.base) is None and surprise(bench, bench.base) is None
