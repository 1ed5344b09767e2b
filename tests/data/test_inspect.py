"""The check before any fit: clean recordings pass in silence, wrong ones are told what is wrong of them."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from wrong_log_kinds import KINDS, measured_folder
from wrong_logs import MEASURED, ended

from frictionpinn.data.filters import noises, sampled
from frictionpinn.data.inspect import inspect
from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.errors import UserError
from frictionpinn.identify import Problem
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

CONF = Path(__file__).resolve().parents[2] / "conf"
# One kind of each fault; benchmarks/wrong_logs.py has all of them.
SOME = [
    "pob: x in mm", "pob: a in g", "pob: the whole link in degrees", "pob: time in ms", "drive: force in kN",
    "pob: sign of v", "pob: sign of the whole link", "damper: sign of the force", "pendulum: angle from hanging",
    "pob: v and a swapped", "pob: v and omega swapped", "drive: a and force swapped", "drive: v is a copy of x",
    "pob: a clipped", "pob: v late by 20 ms", "drive: a with gravity in it", "pob: theta in 12 steps",
    "pob: sampled unequally", "pob: rows come late", "pob: a gap", "pendulum: angle wrapped in degrees",
    "pob: files of different rates", "pob: noise where the box should move", "pob: no alpha", "pob: positions alone",
    "pob: velocities alone", "drive: no force", "drive: no header", "a pendulum on a box as a pendulum",
    "a drive as a damper", "a joint's arm left out", "drive: mass a tenth", "UR10e, joint 2, as it is",
    "EMPS: sign of the force", "joint, positions alone: sign of tau", "sdob, positions alone: x and y in mm",
    "pendulum, positions alone: sign of tau", "drive, positions alone: x in mm",
]  # fmt: skip


@pytest.mark.parametrize("name", SOME)
def test_a_wrong_log_ends_in_a_right_answer_or_in_a_line_that_names_the_fault(name):
    if KINDS[name].base in MEASURED and measured_folder() is None:
        pytest.skip("the measured recordings are not on this machine (FRICTIONPINN_DATA)")
    end = ended(KINDS[name])
    assert end.how in ("right", "named"), end.line


def test_the_noise_of_a_trial_is_that_of_its_recording_though_its_clock_jitters():
    rng = np.random.default_rng(0)
    t = np.arange(4000) / 1000 + rng.uniform(0, 0.6e-3, 4000)
    recording = Recording((Trial("1", t, {"x": np.sin(t) + 0.01 * rng.standard_normal(4000)}),), {"x": "m"})
    trials, sigmas = sampled(recording, ["x"])
    assert noises(trials) == sigmas and sigmas["x"] == pytest.approx(0.01, rel=0.1)


def clean(name: str, rate: float, noise: float, seed: int) -> tuple[Recording, object]:
    conf = OmegaConf.to_container(OmegaConf.load(CONF / "system" / f"{name}.yaml"))
    system, own = SYSTEMS[name](**conf["parameters"]), conf["simulate"]
    recording = simulate_recording(system, own["friction"], own["truth"], own["trials"], rate)
    return GaussianNoise(noise)(recording, seed), system


@pytest.mark.parametrize("name", SYSTEMS)
@settings(max_examples=3, derandomize=True, deadline=None)
@given(rate=st.floats(100, 2000), noise=st.floats(0.01, 0.1), seed=st.integers(0, 1000))
def test_a_clean_recording_raises_no_finding_at_any_rate_and_noise(name, rate, noise, seed):
    recording, system = clean(name, rate, noise, seed)
    assert [str(f) for f in inspect(recording, system)] == []


def test_findings_do_not_depend_on_the_rate():
    for rate in (100.0, 400.0, 1600.0):
        recording, system = clean("pob", rate, 0.03, 1)
        late = []
        for trial in recording.trials:
            v = np.interp(trial.t - 0.03, trial.t, trial.signals["v"])
            late.append(Trial(trial.name, trial.t, trial.signals | {"v": v}))
        (found,) = inspect(Recording(tuple(late), recording.units), system)
        assert "v comes" in str(found), rate
        told = float(str(found).split("v comes ")[1].split(" ms")[0])
        assert told == pytest.approx(30, rel=0.15), rate


def test_a_mass_that_is_to_be_estimated_is_not_held_against_a_recording():
    recording, _ = clean("drive", 400.0, 0.02, 0)
    heavy = SYSTEMS["drive"](M=10.0)
    assert any("declared inertia" in str(f) for f in inspect(recording, heavy))
    assert inspect(recording, heavy, inertia_free=True) == []


def pushed_or_sliding(force: str, noise: float, kept: tuple[str, ...]) -> list[str]:
    """Findings of a drive that a force pushes, or that slides from a speed, with no force in its log."""
    drive = SYSTEMS["drive"](M=2.0)
    trials = [{"duration": 1.0, "force": force, "initial": {"v": v}} for v in (1.0, -1.2, 0.7)]
    made = simulate_recording(drive, "coulomb_viscous", {"mu_c": 3.0, "sigma_2": 2.0}, trials, 200.0)
    noisy = GaussianNoise(noise)(made, seed=0)
    bare = [Trial(t.name, t.t, {n: y for n, y in t.signals.items() if n in kept}) for t in noisy.trials]
    return [str(f) for f in inspect(Recording(tuple(bare), noisy.units), drive)]


@pytest.mark.parametrize("kept", [("x", "v", "a"), ("x", "v"), ("x",)], ids=" ".join)
def test_a_motion_that_speeds_up_without_a_force_is_told_and_a_free_slide_is_not(kept):
    for noise in (0.0, 0.01):
        (told,) = pushed_or_sliding("8*sin(2*pi*t)", noise, kept)
        assert told.startswith("the motion speeds up without force") and "data.columns={..., force: ...}" in told
        assert pushed_or_sliding("0*t", noise, kept) == []  # where it ends at rest the position is not clipped


def test_a_coordinate_of_which_nothing_was_recorded_is_named_by_the_check_and_by_a_fit():
    recording, system = clean("two_mass", 200, 0.02, 0)
    motor = [{n: x for n, x in t.signals.items() if not n.endswith("_l")} for t in recording.trials]
    pairs = zip(recording.trials, motor, strict=True)
    recording = replace(recording, trials=tuple(replace(t, signals=own) for t, own in pairs))
    (finding,) = [f for f in inspect(recording, system) if f.grave]
    assert "nothing of load was recorded" in str(finding) and "omega_l" in str(finding)
    with pytest.raises(UserError, match="nothing of load was recorded"):
        Problem(Mechanism(system, LAWS["coulomb_viscous"]()), recording)


def test_a_contact_that_slips_one_way_is_told_and_is_no_fault():
    from frictionpinn.data.simulated import simulate_recording

    drive = SYSTEMS["drive"](M=2.0)
    for force, told in (("9 + 5*sin(4*t)", True), ("9*sin(4*t)", False)):
        truth = {"mu_c": 3.0, "sigma_2": 10.0}
        recording = simulate_recording(drive, "coulomb_viscous", truth, [{"duration": 8.0, "force": force}], 200.0)
        findings = inspect(GaussianNoise(0.005)(recording, 0), drive)
        assert any("slips one way only" in f.what and not f.grave for f in findings) == told, findings


PUSHES = [{"duration": 2.0, "force": force} for force in ("5*sin(2*pi*t)", "7*sin(3*pi*t)", "9*sin(2*pi*t)")]


def drive_log(*more: dict, noise: float = 0.005, rate: float = 200.0) -> Recording:
    truth = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 5e-3}
    made = simulate_recording(SYSTEMS["drive"](M=2.0), "lugre", truth, [*PUSHES, *more], rate)
    return GaussianNoise(noise)(made, seed=0)


def with_trial(recording: Recording, name: str, signal: str, changed) -> list[str]:
    """Findings where ``changed`` makes something else of a signal in one trial."""

    def own(trial: Trial) -> Trial:
        return replace(trial, signals=trial.signals | {signal: changed(trial.signals[signal])})

    trials = tuple(own(t) if t.name == name else t for t in recording.trials)
    return [str(f) for f in inspect(replace(recording, trials=trials), SYSTEMS["drive"](M=2.0)) if f.grave]


@pytest.mark.parametrize("signal", ["force", "x", "v", "a"])
@pytest.mark.parametrize("noise", [0.0, 0.005, 0.05])
def test_a_channel_that_is_dead_in_one_trial_is_told_with_the_trial(signal, noise):
    recording = drive_log(noise=noise)
    for name in recording.names:
        for value in (0.0, 2.0):
            (told,) = with_trial(recording, name, signal, lambda y, value=value: np.full(len(y), value))
            assert f"trial '{name}'" in told and f"{signal} is {value:g} in every row" in told


@pytest.mark.parametrize(("signal", "noise"), [("x", 0.005), ("v", 0.005), ("a", 0.005), ("x", 0.05), ("v", 0.05)])
def test_a_channel_that_dies_within_a_trial_is_told_with_the_time_for_which_it_is_dead(signal, noise):
    recording = drive_log(noise=noise)
    for trial in recording.trials:
        live = round(0.6 * len(trial))
        (told,) = with_trial(
            recording, trial.name, signal, lambda y, live=live: np.where(np.arange(len(y)) < live, y, y[live])
        )
        dead = f"in the last {0.4 * trial.t[-1]:.2g}"
        assert told.startswith(f"{signal} is ") and dead in told and f"trial '{trial.name}', where" in told


@pytest.mark.parametrize("rounded", [0.0, 1e-3])
def test_a_body_that_comes_to_rest_for_the_rest_of_a_trial_is_no_dead_channel(rounded):
    recording = drive_log({"duration": 3.0, "force": "8*sin(6*t)*exp(-t**4)"}, noise=0.0)
    trial = recording.trials[-1]
    signals = {n: rounded * np.round(y / rounded) if rounded else y for n, y in trial.signals.items()}
    assert np.ptp(signals["x"][-100:]) < 1e-3
    trials = (*recording.trials[:-1], replace(trial, signals=signals))
    assert [f for f in inspect(replace(recording, trials=trials), SYSTEMS["drive"](M=2.0)) if f.grave] == []


@pytest.mark.parametrize(
    "last",
    [{"force": "0*t"}, {"force": "0*t", "initial": {"v": 1.0}}, {"force": "2 + 0*t"}, {"force": "2*sin(6*t)"},
     {"force": "3.5 + 0*t", "initial": {"v": -0.5}}],
    ids=["at rest", "coasts", "held", "below breakaway", "slides against a force"],
)  # fmt: skip
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_trial_that_rests_or_coasts_is_no_fault(last, noise):
    recording = drive_log({"duration": 2.0} | last, noise=noise)
    assert [str(f) for f in inspect(recording, SYSTEMS["drive"](M=2.0))] == []


@pytest.mark.parametrize(("signal", "factor", "said"), [
    ("force", 1000.0, "1000"), ("force", -1.0, "opposite signs"), ("x", 1000.0, "x is too large by 1000"),
    ("v", -1.0, "v has its sign turned"), ("a", 1e-3, "a is too small by 1000")])  # fmt: skip
def test_one_trial_of_another_unit_or_sign_is_told_with_its_name(signal, factor, said):
    recording = drive_log()
    for name in recording.names:
        (told,) = with_trial(recording, name, signal, lambda y: factor * y)
        assert told.startswith(f"in trial '{name}' ") and said in told


@pytest.mark.parametrize(
    ("factor", "said"),
    [(0.77, "a is too small by 1.3,"), (1.3, "a is too large by 1.3,"), (-0.9, "a has its sign turned: it is -0.9")],
)
def test_a_sign_is_told_to_be_turned_only_where_it_is(factor, said):
    recording = drive_log()
    trials = [t.with_signals(a=factor * t.signals["a"]) for t in recording.trials]
    (told,) = inspect(replace(recording, trials=tuple(trials)), SYSTEMS["drive"](M=2.0))
    assert said in str(told) and ("data.gains={a: -1}" in str(told)) == (factor < 0)


@pytest.mark.parametrize("signal", ["x", "v", "a"])
def test_what_follows_from_a_clipped_signal_is_not_told_beside_it(signal):
    def clipped(trial: Trial, factor: float) -> Trial:
        values = trial.signals[signal]
        low, high = np.quantile(values, [0.15, 0.85])
        turned = {"v": factor * trial.signals["v"]} if signal == "x" else {}
        return trial.with_signals(**{signal: np.clip(values, low, high)} | turned)

    for factor in (1.0, -1.0):
        trials = tuple(clipped(t, factor) for t in drive_log().trials)
        told = [str(f) for f in inspect(Recording(trials, {}), SYSTEMS["drive"](M=2.0))]
        assert signal in told[0] and "clipped" in told[0]
        turned = signal == "x" and factor < 0  # another fault is still told
        assert len(told) == 1 + turned and ("sign" in told[-1]) == turned, told


def test_a_trial_that_the_equation_explains_worse_than_the_others_is_named():
    recording = drive_log()
    first, second, third = recording.trials
    other = third.signals | {"force": 5 + np.sin(40 * third.t)}  # of another motion
    (told,) = inspect(
        replace(recording, trials=(first, second, replace(third, signals=other))), SYSTEMS["drive"](M=2.0)
    )
    assert "trial '3' is unlike the others" in str(told)
