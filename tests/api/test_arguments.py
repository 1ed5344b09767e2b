"""What is no mechanism, recording, table or number is told in one line by every function."""

from __future__ import annotations

import numpy as np
import pytest

import frictionpinn as fp

VALUES = {"mu_c": 3.0, "sigma_2": 2.0}
TRIALS = [{"duration": 1.0, "force": "8*sin(2*pi*t)"}, {"duration": 1.0, "force": "9*sin(3*pi*t)"}]


@pytest.fixture(scope="module")
def model():
    return fp.mechanism("drive", "coulomb_viscous")


@pytest.fixture(scope="module")
def log(model):
    return fp.simulate(model, VALUES, TRIALS, rate_hz=np.float32(200), noise=0.01)


@pytest.mark.parametrize("given", ["drive", None, fp.system("drive")], ids=["a name", "nothing", "a system"])
@pytest.mark.parametrize(
    "call",
    [
        lambda m, log: fp.fit(m, log),
        lambda m, log: fp.diagnose(m, log),
        lambda m, log: fp.bound(m, log, VALUES),
        lambda m, log: fp.online(m, VALUES, log),
        lambda m, log: fp.train(m, log),
        lambda m, log: fp.simulate(m, VALUES, TRIALS),
    ],
    ids=["fit", "diagnose", "bound", "online", "train", "simulate"],
)
def test_what_is_no_mechanism_is_refused_with_how_to_make_one(log, call, given):
    with pytest.raises(fp.UserError, match=r"no mechanism: mechanism is .*fp\.mechanism\('drive', 'lugre'\)"):
        call(given, log)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda m, log: fp.fit(m, "log.csv"), "not a recording: recording is 'log.csv'; .*fp.read"),
        (lambda m, log: fp.check("log.csv", m.system), "not a recording"),
        (lambda m, log: fp.fit(m, log, free="mu_c"), r"not a list of names: free is 'mu_c'; allowed: \['mu_c'\]"),
        (lambda m, log: fp.fit(m, log, fixed=3), "no table: fixed is 3"),
        (lambda m, log: fp.fit(m, log, fixed={"mu_c": "a"}), "not a number: fixed.mu_c is 'a'"),
        (lambda m, log: fp.fit(m, log, bounds={"mu_c": 3}), r"impossible bounds: bounds.mu_c is 3; .*\[low, high\]"),
        (lambda m, log: fp.fit(m, log, bounds={"mu_c": ["a", 1]}), "not a number: bounds.mu_c is 'a'"),
        (lambda m, log: fp.fit(m, log, sigmas={"y": 1.0}), "unknown name: sigmas is 'y'; allowed: force, x, v, a"),
        (lambda m, log: fp.fit(m, log, windows=0), "not a number: windows is 0; allowed: a finite number above 0"),
        (lambda m, log: fp.fit(m, log, epochs=3), "method='maximum_likelihood' does not read: fit.epochs. is 3; .*pe1"),
        (lambda m, log: fp.fit(m, log, simulations=9), "does not read: fit.simulations. is 9.*nelder_mead"),
        (lambda m, log: fp.fit(m, log, method="pe1", epochs=2.5), "not a whole number: epochs is 2.5"),
        (lambda m, log: fp.fit(m, log, seed=-1), "impossible seed: seed is -1; allowed: a whole number from 0"),
        (lambda m, log: fp.simulate(m, VALUES, TRIALS, seed=1.5), "impossible seed: seed is 1.5"),
        (lambda m, log: fp.fit(m, log, free=["mu_c"]), r"neither free nor fixed: sigma_2 .*fixed={'sigma_2': ...}"),
        (
            lambda m, log: fp.simulate(m, VALUES, [TRIALS[0] | {"initial": {"q": 1}}]),
            r"unknown name: data.trials\[0\].initial.q; allowed: x, v",
        ),
        (lambda m, log: fp.read("run.csv", m), r"not a System: read is drive\+coulomb_viscous: .*mechanism\.system"),
        (lambda m, log: fp.diagnose(m, log, held_out="10"), r"not a list of names: held_out is '10'"),
        (lambda m, log: fp.diagnose(m, log, start={"mu_c": -1}), "impossible value: start.mu_c is -1"),
        (lambda m, log: fp.diagnose(m, log, start={"foo": 1}), "unknown parameter: start.foo"),
        (lambda m, log: fp.diagnose(m, log, signals="x"), "not a list of signals"),
        (lambda m, log: fp.diagnose(m, log, free="mu_c"), r"not a list of names: diagnose.free is 'mu_c'; .*\[mu_c\]"),
        (lambda m, log: fp.simulate(m, 3, TRIALS), "no table: truth is 3"),
        (lambda m, log: fp.simulate(m, VALUES, 3), "no trials to simulate"),
        (lambda m, log: fp.simulate(m, VALUES, TRIALS, rate_hz=None), "not a number: rate_hz is None"),
        (lambda m, log: fp.simulate(m, VALUES, TRIALS, noise="a"), "not a number: noise is 'a'"),
        (lambda m, log: fp.read("log.csv", "drive", held_out=["2"]), "unknown option: read is held_out; .*fp.diagnose"),
        (lambda m, log: fp.read("log.csv", "drive", name="emps"), "unknown option: read is name; allowed: columns, "),
        (lambda m, log: fp.online(m, VALUES, log, adapt=["mu_c"]), "no table: adapt is"),
        (lambda m, log: fp.mechanism("drive", "lugre", "drag"), "not a list of effects: effects is 'drag'"),
        (lambda m, log: fp.effects("drive"), "no mechanism"),
        (lambda m, log: log.select(["1", "10"]), "no such trial: select is '10'; allowed: 1, 2"),
        (lambda m, log: log.select("12"), r"not a list of names: select is '12'; allowed: \['12'\]"),
        (lambda m, log: fp.system("drive", imposed="no"), "not a switch: system.imposed is 'no'"),
        (lambda m, log: fp.system("double_pendulum", driven=1), "not a list of names: system.driven is 1"),
        (lambda m, log: fp.read([], "drive"), "not a file"),
        (lambda m, log: fp.train(m, log, model="pe1", friction="lugre"), "those of the mechanism: friction is .?lugre"),
        (
            lambda m, log: fp.train(m, log, system={"parameters": {"M": 7.0}}),
            "those of the mechanism: system.parameters",
        ),
        (lambda m, log: fp.export(3, "c"), "no run: run is 3"),
        (lambda m, log: fp.export("nowhere", 3), "not a list of names: form is 3"),
    ],
)
def test_a_value_of_the_wrong_kind_is_told_in_one_line(model, log, workdir, call, said):
    with pytest.raises(fp.UserError, match=said) as caught:
        call(model, log)
    assert "\n" not in str(caught.value) and not list(workdir.iterdir())


def test_signals_that_are_compared_leave_the_force_that_moves_the_model(model, log):
    found = fp.diagnose(model, log, signals=["x", "v"], effects=["drag"])
    assert found.verdict == "nothing missing" and found.values["mu_c"] == pytest.approx(3.0, rel=0.02)


def test_start_values_are_given_by_contact_too(monkeypatch):
    cart = fp.mechanism("cartpole", "coulomb_viscous")
    values = {"rail": {"mu_c": 0.1, "sigma_2": 0.5}, "bearing": {"mu_c": 0.05, "sigma_2": 0.01}}
    log = fp.simulate(cart, values, [{"duration": 1.0, "force": "3*sin(9*t)"}] * 2, rate_hz=200, noise=0.01)
    monkeypatch.setattr("frictionpinn.api.estimates.examine", lambda cfg, mechanism, recording: cfg["friction"])
    assert fp.diagnose(cart, log, start=values, check="warn")["start"] == values
    with pytest.raises(fp.UserError, match=r"rail\.mu_d"):
        fp.diagnose(cart, log, start={"rail": {"mu_d": 0.1}}, check="warn")


def test_a_system_says_that_its_motion_is_imposed():
    assert "imposed" in repr(fp.system("drive", imposed=True)) and "imposed" not in repr(fp.system("drive"))
