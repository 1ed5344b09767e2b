"""Diagnoses of recordings with an effect that the declared model lacks, with none, and with one that has no name."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import sympy as sp
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from pages import assert_reads_everywhere
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.diagnose.diagnosis import diagnose
from frictionpinn.diagnose.select import Settings
from frictionpinn.errors import UserError
from frictionpinn.export.augmented import folded, load_augmented, save_augmented
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import EFFECTS, LAWS, SYSTEMS, extensions
from frictionpinn.physics.effect import Effect, strength
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.report import diagnosis as report
from frictionpinn.report.diagnosis import evidence_so_far, headline
from frictionpinn.workflow import diagnose as workflow

ROOT = Path(__file__).resolve().parents[2]
TRUTH = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 5e-3}
TRIALS = [
    {"duration": 2.0, "force": "5*sin(2*pi*t)"},
    {"duration": 2.0, "force": "8*sin(3*pi*t)"},
    {"duration": 2.0, "force": "6*sin(2*pi*t + 0.5*sin(2*pi*t))"},
]


def recorded(acting=(), values=None, seed=0, level=0.02):
    system = SYSTEMS["drive"](M=1.0)
    clean = simulate_recording(system, "lugre", TRUTH | (values or {}), TRIALS, 300.0, acting)
    return system, GaussianNoise(level)(clean, seed)


def diagnosed(acting=(), values=None, seed=0, **options):
    system, made = recorded(acting, values, seed)
    mechanism = Mechanism(system, LAWS["lugre"]())
    return diagnose(mechanism, made.select(made.names[:2]), made.select(made.names[2:]), **options)


def test_a_number_of_training_trials_is_heeded():
    _, made = recorded()
    fitted, held_out = workflow.split(made, {"held_out": ["3"], "training_trials": 1})
    assert len(fitted.names) == 1 and list(held_out.names) == ["3"]
    with pytest.raises(UserError, match="impossible number of trials"):
        workflow.split(made, {"held_out": ["3"], "training_trials": ["1"]})


class Waves(Effect):
    """A force that no name covers: it comes and goes with the position."""

    name = "waves"
    parameters = (strength("waves", "{F}", "size"),)

    def force(self, c, p, law):
        return p.waves * sp.tanh((c.s - 0.02) / 0.01)


def test_an_undeclared_constant_force_is_named_measured_and_proved():
    d = diagnosed(["constant_force"], {"constant_force": 0.15})
    assert d.verdict == "effect found"
    (found,) = d.accepted
    assert found.candidate.effect == "constant_force"
    low, high = d.ci95["constant_force"]
    assert low <= 0.15 <= high and high - low < 0.05
    entry = d.errors[d.main]
    assert entry["after"] < 1.1 * entry["noise_floor"] and entry["after"] < entry["before"]
    before, after = entry["excess_before"], entry["excess_after"]
    assert after["ci95"][0] <= after["value"] <= after["ci95"][1] < before["ci95"][0] <= before["value"]
    assert before["value"] == pytest.approx(np.sqrt(entry["before"] ** 2 - entry["noise_floor"] ** 2))
    assert all(e["noise_from"].startswith("differences") for e in d.errors.values())
    assert found.evidence["gain_held_out"] > 0
    t, gained = evidence_so_far(d, 0)
    assert gained[0] == 0 and gained[-1] > 0.8 * found.evidence["gain_held_out"]
    assert d.gain_within_errors == pytest.approx(gained[-1], rel=0.1)
    assert (t[0], t[-1]) == (d.before.models[0].t[0], d.before.models[0].t[-1])
    assert f"trials that no fit saw {gained[-1]:+.0f}" in headline(d)


def test_where_held_out_trials_are_predicted_badly_as_fitted_the_headline_says_what_the_errors_allow(monkeypatch):
    d = SimpleNamespace(
        accepted=[1],
        scored="held-out trials",
        before=SimpleNamespace(models=[0, 1]),
        settings=Settings(),
        gain_within_errors=75.2,
    )  # fmt: skip
    gained = {0: -380.0, 1: 9.0}
    monkeypatch.setattr(report, "evidence_so_far", lambda d, k: (np.zeros(2), np.array([0.0, gained[k]])))
    assert report.gain_in_words(d) == (
        " (log-likelihood of trials that no fit saw -371, +75 with parameters moved within their errors)"
    )
    gained[0] = 380.0
    assert report.gain_in_words(d) == " (log-likelihood of trials that no fit saw +389)"


def test_of_a_long_recording_windows_are_looked_at_and_the_whole_is_kept(tmp_path):
    system, made = recorded(("constant_force",), {"constant_force": 0.5})
    again = [replace(trial, name=f"{trial.name}{turn}", start=None) for turn in "abc" for trial in made.trials]
    fitted, held_out = (replace(made, trials=tuple(part)) for part in (again[:6], again[6:]))
    d = diagnose(Mechanism(system, LAWS["lugre"]()), fitted, held_out, settings=Settings(samples=2700),
                 effects=["constant_force", "drag"])  # fmt: skip
    assert len(d.fitted) + len(d.held_out) == 3000 and set(d.held_out.names) < set(held_out.names)
    assert [a.candidate.name for a in d.accepted] == ["constant_force"]
    assert "Looked at 3000 of 5400 samples" in headline(d)
    d.save(tmp_path)
    assert len(pd.read_parquet(tmp_path / "recording.parquet")) == 5400
    told = json.loads((tmp_path / "result.json").read_text())["data"]
    assert (told["samples"], told["samples_given"]) == (3000, 5400)


def test_nothing_is_found_where_nothing_is_missing():
    d = diagnosed(seed=3)
    assert d.verdict == "nothing missing" and d.accepted == ()
    assert all(reason.why for reason in d.refused) and len(d.refused) > 10


def test_a_force_without_a_name_is_unexplained_its_variable_is_said_and_a_network_takes_its_place(tmp_path):
    d = diagnosed([Waves()], {"waves": 0.4}, effects=["drag", "drift"], network=True)
    assert d.verdict == "unexplained"
    assert "position" in d.unexplained.depends_on[:2]
    assert d.unexplained.share > 0.5
    for entry in d.network.errors.values():
        assert entry["after"] < 1.15 * min(entry["noise_floor"], entry["before"]), d.network.errors
    save_augmented(tmp_path / "augmented.yaml", d)
    mechanism, values = load_augmented(tmp_path / "augmented.yaml")
    assert [e.name for e in mechanism.effects] == ["remainder_position"]
    assert set(d.network.values) <= set(values)
    folded(tmp_path / "augmented.yaml")


def test_the_command_reads_a_file_and_writes_what_it_promises(tmp_path):
    _, made = recorded(["asymmetric_viscous"], {"asymmetric_viscous": 1.2}, seed=1)
    rows = [pd.DataFrame({"trial": t.name, "t": t.t, **t.signals}) for t in made.trials]
    pd.concat(rows).to_csv(tmp_path / "run.csv", index=False)
    command = [sys.executable, str(ROOT / "diagnose.py"), "system=drive", "data=csv", "data.path=run.csv"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (folder,) = (tmp_path / "outputs" / "drive" / "diagnosis").iterdir()
    result = json.loads((folder / "result.json").read_text())
    assert result["verdict"] == "effect found" and [e["name"] for e in result["effects"]] == ["asymmetric_viscous"]
    (effect,) = result["effects"]
    entry = effect["parameters"]["asymmetric_viscous"]
    assert entry["ci95"][0] <= 1.2 <= entry["ci95"][1] and entry["unit"] == "N*s/m"
    assert {"quantity", "unit", "before", "after", "noise_floor", "noise_from"} <= set(result["error"])
    assert {"value", "ci95"} == set(result["error"]["excess_before"]) == set(result["errors"]["x"]["excess_after"])
    assert result["data"]["held_out"] == ["3"] and result["unexplained"] is None
    assert all({"name", "why"} == set(entry) for entry in result["refused"])
    assert "Missing: asymmetric_viscous" in done.stdout
    page = (folder / "report.html").read_text()
    assert_reads_everywhere(page)
    assert "<math" in page and page.count("data:image/png") == 5 and "http" not in page.replace("http://www.w3", "")
    events = EventAccumulator(str(folder / "tensorboard")).Reload()
    assert {event.step: event.value for event in events.Scalars("error/x")}[1] == pytest.approx(
        result["errors"]["x"]["after"]
    )
    assert events.Scalars("evidence/asymmetric_viscous")[0].value > 4
    assert len(events.Tags()["images"]) == 5 and events.Images("diagnosis/error")[0].width > 300
    (verdict,) = events.Tensors("verdict/text_summary")
    assert verdict.tensor_proto.string_val[0].decode().startswith("Missing: asymmetric_viscous")
    mechanism, values = load_augmented(folder / "augmented.yaml")
    t = np.arange(300) / 300.0
    run = Simulator(mechanism).simulate(t, {"force": 5 * np.sin(6 * t)}, values)
    assert np.isfinite(run.F).all() and values["asymmetric_viscous"] == pytest.approx(entry["value"])


def test_a_saved_model_names_the_files_of_its_own_effects_and_is_read_where_they_are_not_loaded(tmp_path, monkeypatch):
    file = tmp_path / "syrup.py"
    file.write_text(
        "from frictionpinn.physics.effect import Effect, strength\n\n\nclass Syrup(Effect):\n    name = 'syrup'\n"
        "    parameters = (strength('syrup', '{F}*s**3/{L}**3', 'cubic drag'),)\n\n"
        "    def force(self, c, p, law):\n        return p.syrup * c.v**3\n"
    )
    monkeypatch.setitem(EFFECTS, "syrup", None)
    monkeypatch.delitem(EFFECTS, "syrup")  # as it is now it is again after the test
    extensions.load([file])
    mechanism = Mechanism(SYSTEMS["drive"](M=1.0), LAWS["coulomb"](), ("syrup",))
    values = {"mu_c": 3.0, "syrup": 2.0, **mechanism.system.values}
    d = SimpleNamespace(bench=SimpleNamespace(mechanism=mechanism), accepted=(), network=None,
                        after=SimpleNamespace(values=values))  # fmt: skip
    save_augmented(tmp_path / "augmented.yaml", d)
    del EFFECTS["syrup"]
    extensions._from_file.cache_clear()
    again, told = load_augmented(tmp_path / "augmented.yaml")
    assert [effect.name for effect in again.effects] == ["syrup"] and told["syrup"] == 2.0


@pytest.fixture
def measured(tmp_path) -> Path:
    """A folder with a recording, as a user would have it."""
    _, made = recorded()
    rows = [pd.DataFrame({"trial": t.name, "t": t.t, **t.signals}) for t in made.trials]
    pd.concat(rows).to_csv(tmp_path / "run.csv", index=False)
    return tmp_path


@pytest.mark.parametrize(
    ("override", "words"), [("diagnose.effects=[dragg]", "did you mean 'drag'"), ("preset=emp", "emps")]
)
def test_the_command_tells_an_impossible_option_in_one_line(measured, override, words):
    command = [sys.executable, str(ROOT / "diagnose.py"), "system=drive", "data=csv", "data.path=run.csv", override]
    done = subprocess.run(command, cwd=measured, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.count("error: ") == 1 and words in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("diagnose.log10_p=3", "a negative number"),
        ("diagnose.most=0", "at least 1"),
        ("diagnose.samples=10", "at least 1000"),
        ("diagnose.worth=2", "a share of the friction force"),
        ("diagnose.loss=square", "gaussian"),
        ("diagnose.fallback=net", "did you mean 'network'"),
        ("diagnose.signals=[velocity]", "diagnose.signals"),
        ("friction.tie_sigma1=true", "friction=lugre_tied"),
    ],
)
def test_impossible_options_are_told_before_anything_is_fitted(measured, override, words):
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        cfg = compose("diagnose", ["system=drive", "data=csv", f"data.path={measured}/run.csv", override])
    with pytest.raises(UserError) as told:
        workflow.diagnose(OmegaConf.to_container(cfg, resolve=True), measured / "out")
    assert words in str(told.value) and "\n" not in str(told.value)


def test_a_file_that_is_no_augmented_model_is_refused(tmp_path):
    with pytest.raises(UserError, match="no such friction model"):
        load_augmented(tmp_path / "none.yaml")
    (tmp_path / "other.yaml").write_text("name: lugre\n")
    with pytest.raises(UserError, match="not a friction model"):
        load_augmented(tmp_path / "other.yaml")


def test_a_diagnosis_starts_without_loading_what_only_a_training_needs():
    code = "import sys, frictionpinn.workflow.diagnose; sys.exit(bool({'torch', 'lightning'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
