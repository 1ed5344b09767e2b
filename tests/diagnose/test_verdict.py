"""The four verdicts: what effects take off, and whether what is left matters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from test_diagnosis import Waves, diagnosed, recorded

from frictionpinn.diagnose import verdict as verdicts
from frictionpinn.diagnose.diagnosis import diagnose
from frictionpinn.diagnose.scan import Remaining
from frictionpinn.diagnose.select import Settings
from frictionpinn.diagnose.verdict import judge, size
from frictionpinn.physics import LAWS
from frictionpinn.physics.base import CONTACT
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.remainder import BUMPS, Remainder
from frictionpinn.report.diagnosis import further_off, headline
from frictionpinn.workflow.diagnose import as_dict, next_step


@pytest.fixture(scope="module")
def partly():
    """Asymmetric viscous friction, which has a name, and a small force over the position, which has none."""
    acting = {"asymmetric_viscous": 2.0, "waves": 0.15}
    return diagnosed(["asymmetric_viscous", Waves()], acting, effects=["asymmetric_viscous", "drag"])


def judged(d, **options):
    return judge(d.bench, d.selection, Settings(**options))


def test_a_name_that_held_out_trials_confirm_beside_a_remainder_is_part_of_the_answer(partly):
    d = partly
    assert d.verdict == "partly explained"
    assert [a.candidate.effect for a in d.accepted] == ["asymmetric_viscous"]
    assert "position" in d.unexplained.depends_on[:2] and d.unexplained.size > 0.02
    (share,) = d.shares
    assert share["value"] > 0.2 and share["value"] + d.left["value"] == pytest.approx(1.0)
    assert share["ci95"][0] < share["value"] < share["ci95"][1]
    said = headline(d)
    assert (
        f"asymmetric_viscous took off {100 * share['value']:.0f} %" in said
        and "is left, a force that depends on" in said
    )
    result = as_dict(d)
    assert result["effects"][0]["share_of_excess"] == share and result["left"] == d.left
    assert result["unexplained"]["size"] == d.unexplained.size and result["negligible"] is None


def test_what_is_significant_but_smaller_than_asked_for_changes_no_verdict_and_is_said(partly):
    found = judged(partly, worth=0.9)
    assert found.verdict == "effect found" and found.unexplained is None and "position" in found.trifle.depends_on[:2]
    said = headline(replace(partly, verdict=found.verdict, unexplained=None, trifle=found.trifle))
    assert "Significant but small: " in said and f"{100 * found.trifle.size:.2g} % of the friction force" in said


@pytest.mark.parametrize(("least", "name", "effects"), [(0.2, "partly explained", 1), (0.9999, "unexplained", 0)])
def test_names_that_take_off_less_than_asked_for_leave_it_unexplained(partly, monkeypatch, least, name, effects):
    monkeypatch.setattr(verdicts, "FIFTH", least)
    found = judged(partly)
    assert found.verdict == name and len(found.shares) == effects
    assert (found.fit is partly.selection.fit) == bool(effects)
    if not effects:
        assert found.after is found.before and found.left["value"] == 1.0


def test_the_size_of_a_remainder_is_its_share_of_the_friction_force_without_what_its_errors_make():
    x, forces = np.linspace(0.0, 1.0, 200), 3.0 * np.ones(200)
    where = {"position_from": 0.0, "position_step": 1.0 / (BUMPS - 1)}
    bumps = Remainder("position", CONTACT.s).bumps(x, where)
    c, none = 0.3 * np.ones(BUMPS), np.zeros((BUMPS, BUMPS))
    force, friction = (Remaining("position", kind, -9.0, c, none, ()) for kind in ("force", "friction"))
    assert size(friction, bumps, forces) == pytest.approx(3.0 * size(force, bumps, forces), rel=1e-6)
    assert 0.1 < size(force, bumps, forces) < 0.2
    loose = replace(force, errors=np.diag(c**2) * 100)
    assert size(loose, bumps, forces) == 0.0


def test_a_fit_that_ends_at_a_bound_that_was_given_gets_no_verdict():
    import frictionpinn as fp

    model = fp.mechanism("drive", "coulomb_viscous")
    trials = [{"duration": 1.0, "force": "8*sin(2*pi*t)"}, {"duration": 1.0, "force": "9*sin(3*pi*t)"}]
    log = fp.simulate(model, {"mu_c": 3.0, "sigma_2": 2.0}, trials, rate_hz=200, noise=0.01)
    found = fp.diagnose(model, log, effects=["drag"], bounds={"mu_c": [1.0, 2.0]})
    assert found.verdict == "no verdict" and "mu_c of the fit ended at its bound, 2: widen" in headline(found)
    assert fp.diagnose(model, log, effects=["drag"], bounds={"mu_c": [1.0, 5.0]}).verdict == "nothing missing"


def test_a_motion_that_is_lost_on_held_out_trials_is_said_beside_a_headline_that_does_not_show_it():
    def entry(value, low, high, floor):
        return {"excess_after": {"value": value, "ci95": [low, high]}, "noise_floor": floor, "unit": "m"}

    errors = {
        "force": entry(0.0, 0.0, 0.1, 0.3),
        "x": entry(0.031, 0.012, 0.05, 0.005),
        "v": entry(0.2, 0.1, 0.3, 0.15),
    }
    errors["friction_force"] = entry(3.0, 2.0, 4.0, 1.0)  # no signal: its noise is that of several together
    assert further_off(errors, "force") == ["Beside that the model is off by more than the noise: x by 0.031 m."]
    assert further_off(errors, "x") == []


def test_the_headline_of_a_diagnosis_has_what_is_further_off(partly):
    lost = partly.errors["x"] | {"excess_after": {"value": 0.031, "ci95": [0.012, 0.05]}, "noise_floor": 0.005}
    said = headline(replace(partly, errors=partly.errors | {"x": lost}))
    assert partly.main != "x" and "off by more than the noise: x by 0.031" in said
    assert "x by 0.031" not in headline(partly)


def test_an_effect_that_no_error_shows_for_certain_is_said_to_show_in_the_likelihood_instead_of_a_share(partly):
    main = partly.errors[partly.main]
    hidden = main | {"excess_before": main["excess_before"] | {"ci95": [0.0, main["excess_before"]["ci95"][1]]}}
    said = headline(replace(partly, errors=partly.errors | {partly.main: hidden}))
    gain = partly.accepted[0].evidence["gain_fitted"]
    assert f"shows in the log-likelihood of the fitted trials ({gain:+.0f})" in said and "took off" not in said


def test_beside_nothing_missing_it_is_said_that_what_is_left_is_no_white_noise(tmp_path):
    (system, clean), (_, made) = recorded(level=0.0), recorded(seed=3)

    def filtered(trial, true):
        away = trial.signals["a"] - true.signals["a"]
        return replace(trial, signals=trial.signals | {"a": true.signals["a"] + lfilter([0.8], [1, -0.6], away)})

    hummed = replace(made, trials=tuple(map(filtered, made.trials, clean.trials)))
    for recording, white in ((made, True), (hummed, False)):
        fitted, held_out = recording.select(made.names[:2]), recording.select(made.names[2:])
        d = diagnose(Mechanism(system, LAWS["lugre"]()), fitted, held_out, effects=["constant_force", "drag"])
        assert d.verdict == "nothing missing"
        assert ("no white noise" in headline(d)) is not white
        assert ("the model is complete" in next_step(d, tmp_path)) is white
