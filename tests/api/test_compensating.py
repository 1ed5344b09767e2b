"""An identified mechanism as a compensator: from an estimate, as C99, and what cannot be in one line."""

from __future__ import annotations

import numpy as np
import pytest

import frictionpinn as fp
from frictionpinn.control.compensator import Compensator

VALUES = {"mu_c": 3.0, "sigma_2": 2.0}
TRIALS = [{"duration": 1.0, "force": "8*sin(2*pi*t)"}, {"duration": 1.0, "force": "9*sin(3*pi*t)"}]


@pytest.fixture(scope="module")
def model():
    return fp.mechanism(fp.system("drive", M=2.0), "coulomb_viscous")


def test_an_estimate_from_an_imposed_motion_compensates_the_axis_with_its_motion_free(model):
    log = fp.simulate(model, VALUES, TRIALS, rate_hz=200, noise=0.01)
    imposed = fp.mechanism(fp.system("drive", M=2.0, imposed=True), "coulomb_viscous")
    fitted = fp.fit(imposed, log)
    made = fp.compensate(imposed, fitted, delay=1e-3)
    assert isinstance(made, Compensator) and not made.mechanism.system.imposed
    assert made.parameters["M"] == 2.0 and made.parameters["mu_c"] == pytest.approx(3.0, rel=0.05)


def test_options_of_the_configuration_are_those_of_the_function(model):
    made = fp.compensate(model, VALUES, limit=2.0, adapt={"mu_c": 0.2}, spread={"mu_c": 0.1})
    assert made.adapt == {"mu_c": 0.2} and made.spread == {"mu_c": 0.1}
    assert made.plan.limit == pytest.approx(2.0 * 3.0)


def test_what_the_controller_does_not_know_is_added_too(model):
    plain = fp.compensate(model, VALUES, control="feedforward")
    loaded = fp.compensate(model, VALUES | {"M": 3.0}, control="feedforward", known=VALUES | {"M": 2.0})
    torques = [made.update((0.0, 0.1, 4.0), 0.0, 0.0).torque for made in (plain, loaded)]
    assert np.diff(torques) == pytest.approx([4.0], rel=1e-3)


def test_the_inertia_of_the_axis_adapts_as_the_command_has_it(model):
    assert fp.compensate(model, VALUES, adapt={"M": 0.01}, spread={"M": 0.3}).adapt == {"M": 0.01}
    assert "M" in fp.compensate(model, VALUES).adapt


def test_a_folder_receives_the_c_code(model, tmp_path):
    fp.compensate(model, VALUES, folder=tmp_path / "controller")
    assert sorted(path.name for path in (tmp_path / "controller").iterdir()) == ["compensator.c", "compensator.h"]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda m: fp.compensate(m, VALUES, control="estimater"), "did you mean 'estimator'"),
        (lambda m: fp.compensate(m, VALUES, control="none"), "a controller alone needs none"),
        (lambda m: fp.compensate(m, VALUES, bandwith=30.0), "did you mean 'bandwidth'"),
        (lambda m: fp.compensate(m, VALUES | {"mu_d": 1.0}), "parameters.mu_d"),
        (lambda m: fp.compensate(m, {"mu_c": 3.0}), "sigma_2"),
        (lambda m: fp.compensate(m, VALUES, adapt={"mu": 0.1}), "compensate.adapt.mu"),
        (lambda m: fp.compensate(m, VALUES, interval=0.0), "interval is 0"),
        (lambda m: fp.compensate(m, VALUES, interval=1000.0), "below 0.00556 s, two cycles"),
        (lambda m: fp.compensate(m, VALUES, delay=1.5), "below 0.0111 s, one period"),
        (lambda m: fp.compensate(m, VALUES, stroke=5e-3), "stroke is 0.005"),
        (lambda m: fp.compensate(m, VALUES, cells=2.5), "cells is 2.5"),
        (lambda m: fp.compensate(m, VALUES, adapt=["mu_c"]), "control.adapt is"),
        (lambda m: fp.compensate(m, VALUES, folder=__file__), "no folder"),
        (lambda m: fp.compensate(m, VALUES | {"mu_c": "3"}), "parameters.mu_c is 3"),
        (lambda m: fp.compensate(m, VALUES | {"sigma_2": -1.0}), "N s/m"),
        (lambda m: fp.compensate(m, [3.0, 2.0]), "no parameters"),
        (lambda m: fp.compensate("drive", VALUES), "no mechanism"),
        (lambda m: fp.compensate(m, VALUES).update((0.0, 0.0, 0.0), None, 0.0), "no reading"),
        (lambda m: fp.compensate(m, VALUES, limit=-1.0), "limit is -1.0; allowed: a number above 0"),
        (lambda m: fp.compensate(m, VALUES, disturbance=-1.0), "disturbance is -1.0; allowed: a number from 0"),
        (lambda m: fp.compensate(m, VALUES, transition=-1), "transition is -1; allowed: a number above 0"),
        (lambda m: fp.compensate(m, VALUES, transition=0.3), "an option that nothing reads: transition is 0.3"),
        (lambda m: fp.compensate(m, VALUES, control="feedforward", bandwidth=9.0), "nothing reads: bandwidth is 9.0"),
        (lambda m: fp.compensate(m, VALUES, cells=8), "nothing reads: cells is 8; allowed: with a stroke"),
        (lambda m: fp.compensate(m, VALUES, uneven=0.3), "nothing reads: uneven is 0.3; allowed: with a stroke"),
        (lambda m: fp.compensate(m, VALUES, adapt={}, spread={"mu_c": 0.3}), "of parameters in adapt, not of mu_c"),
        (
            lambda m: fp.compensate(m, {"mu_c": 3.0, "sigma_2": 0.0}, adapt={"sigma_2": 0.1}),
            "nothing reads: adapt is .*; allowed: of parameters above 0 that the compensator has, not of sigma_2",
        ),
        (
            lambda m: fp.compensate(fp.mechanism(m.system, "stribeck"), VALUES | {"mu_s": 2.0, "v_s": 1e-3}),
            "static below Coulomb friction: parameters.mu_s is 2.0; allowed: at least mu_c = 3",
        ),
        (lambda m: fp.compensate(m, VALUES, limit=None), "impossible value: limit; allowed: a number above 0"),
        (lambda m: fp.compensate(m, VALUES, limit="a"), "not a number: limit is 'a'"),
        (lambda m: fp.compensate(m, VALUES, known=3), "no table: known is 3"),
        (lambda m: fp.compensate(m, VALUES, folder=3), "no folder"),
        (lambda m: fp.compensate(m, VALUES | {"mu_c": 0.0}), "no dry friction: parameters is 0 N"),
        (lambda m: fp.compensate(fp.mechanism("pob", "lugre"), {}), "drive, joint, pendulum"),
        (lambda m: fp.compensate(m, VALUES, control="stribeck"), "mu_s, v_s were not"),
    ],
)
def test_what_cannot_be_is_told_in_one_line(model, call, said):
    with pytest.raises(fp.UserError, match=said) as caught:
        call(model)
    assert "\n" not in str(caught.value)
