"""``python check.py`` and the check that every run on measured data begins with."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import call

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from wrong_log_kinds import measured_folder

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.errors import UserError
from frictionpinn.export.augmented import data_of
from frictionpinn.identify import maximum_likelihood
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow import cli
from frictionpinn.workflow.build import build_recording, build_system
from frictionpinn.workflow.check import check
from frictionpinn.workflow.diagnose import checked
from frictionpinn.workflow.estimate import default_config
from frictionpinn.workflow.result import doubts
from frictionpinn.workflow.train import train
from frictionpinn.workflow.vet import assumptions, measured_well, vet

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "examples" / "swing.csv"
QUICK = ["trainer.max_epochs=2", "trainer.progress_bar=false", "trainer.accelerator=cpu", "model.network.width=8"]


def drive(noise: float = 0.02) -> pd.DataFrame:
    trials = [{"duration": 2.0, "force": f"{a}*sin({w}*t)"} for a, w in ((5, 6), (8, 9), (6, 7))]
    made = simulate_recording(SYSTEMS["drive"](), "coulomb_viscous", {"mu_c": 3.0, "sigma_2": 2.0}, trials, 200.0)
    noisy = GaussianNoise(noise)(made, 0)
    return pd.concat([pd.DataFrame({"trial": t.name, "t": t.t, **t.signals}) for t in noisy.trials])


def written(folder: Path, table: pd.DataFrame) -> Path:
    table.to_csv(folder / "run.csv", index=False)
    return folder / "run.csv"


def test_the_sample_recording_passes_and_what_is_assumed_is_printed(tmp_path):
    done = call("check.py", "system=pob", f"data.path={SAMPLE}", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for text in ("1050 samples in 4 trials", "m_b = 0.5 kg", "columns used: t, x, v, a", "nothing speaks against"):
        assert text in done.stdout
    assert list(tmp_path.iterdir()) == [], "a check leaves nothing behind"


def test_a_wrong_recording_ends_in_one_line_for_each_finding_and_exit_code_2(tmp_path):
    table = pd.read_csv(SAMPLE).assign(v=lambda d: -d.v, theta=lambda d: np.rad2deg(d.theta))
    done = call("check.py", "system=pob", f"data.path={written(tmp_path, table)}", cwd=tmp_path)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    told = [line for line in done.stdout.splitlines() if line.startswith("wrong: ")]
    assert len(told) == 2
    assert "v has its sign turned" in told[0] and "data.gains={v: -1}" in told[0]
    assert "theta is too large by 57.3" in told[1] and "data.units={theta: deg, default: SI}" in told[1]


def test_the_fixes_that_are_told_mend_the_recording(tmp_path):
    table = pd.read_csv(SAMPLE).assign(v=lambda d: -d.v, theta=lambda d: np.rad2deg(d.theta))
    fixes = ["data.gains={v: -1}", "data.units={theta: deg, default: SI}"]
    done = call("check.py", "system=pob", f"data.path={written(tmp_path, table)}", *fixes, cwd=tmp_path)
    assert done.returncode == 0 and "nothing speaks against" in done.stdout


@pytest.mark.parametrize(
    ("script", "further"), [("diagnose.py", []), ("identify.py", ["bounds=data"]), ("train.py", [])]
)
def test_a_wrong_recording_is_refused_before_any_fit(tmp_path, script, further):
    path = written(tmp_path, drive().assign(a=lambda d: -d.a))
    done = call(script, "system=drive", "data=csv", f"data.path={path}", *further, cwd=tmp_path, timeout=60)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "no answer from this recording has a sense: a has its sign turned" in line and "data.check=warn" in line


def test_a_training_that_is_told_to_go_on_warns_and_says_that_its_model_is_none(tmp_path, caplog):
    table = pd.read_csv(SAMPLE).assign(a=lambda d: -d.a)
    cfg = default_config(["data=csv", f"data.path={written(tmp_path, table)}", "data.check=warn", *QUICK], "train")
    with caplog.at_level("INFO"):
        train(cfg, tmp_path / "run")
    assert "wrong: a has its sign turned" in caplog.text
    assert "no better than Coulomb + viscous friction" in caplog.text or "% of the force: check" in caplog.text


def test_a_model_that_is_worth_it_raises_no_doubt_but_of_what_a_training_cannot_tell():
    error = {"model": {"rmse": 0.1, "relative": 0.1}, "coulomb_viscous": {"rmse": 0.3, "relative": 0.3}}
    assert doubts({"force_error": error, "parameters": {}}) == []
    (said,) = doubts({"force_error": error, "parameters": {"mu_c": {}, "v_s": {}}})
    assert "v_s" in said and "refine=true" in said
    error["model"] |= {"rmse": 0.6, "relative": 0.6}
    assert "train longer" in doubts({"force_error": error, "parameters": {}})[1]
    error["coulomb_viscous"] |= {"rmse": 0.7, "relative": 0.7}
    assert "tells of signs, units and masses" in doubts({"force_error": error, "parameters": {}})[0]


def test_a_parameter_that_a_training_leaves_at_its_bound_is_told():
    error = {"model": {"rmse": 0.1, "relative": 0.1}, "coulomb_viscous": {"rmse": 1.0, "relative": 1.0}}
    at_its_bound = {"value": 0.0501, "bounds": [0.05, 5.0]}
    (said,) = doubts({"force_error": error, "parameters": {"mu_c": at_its_bound, "sigma_2": {"value": 1.0}}})
    assert said.startswith("mu_c ended at its bound, 0.0501: give friction.bounds.mu_c more room")
    assert doubts({"force_error": error, "parameters": {"mu_c": at_its_bound | {"value": 0.3}}}) == []


@pytest.mark.parametrize(
    ("system", "columns", "imposed"),
    [
        ("pob", ["x", "v", "a", "theta", "omega"], False),
        ("pob", ["x", "v", "a", "theta", "alpha"], False),
        ("pob", ["v", "a", "theta", "omega", "alpha"], False),
        ("pob", ["x", "theta"], False),
        ("drive", ["x", "v", "force"], True),
        ("drive", ["v", "a", "force"], True),
        ("drive", ["x", "force"], True),
        ("drive", ["v", "force"], False),
    ],
)
def test_signals_that_were_not_recorded_are_derived(tmp_path, system, columns, imposed):
    table = drive() if system == "drive" else pd.read_csv(SAMPLE).query("trial <= 3")
    path = written(tmp_path, table[["trial", "t", *columns]])
    cfg = default_config([f"system={system}", f"data.path={path}", f"system.imposed={str(imposed).lower()}"], "check")
    made = build_system(cfg["system"])
    recording = build_recording(cfg["data"], made)
    found = maximum_likelihood(Mechanism(made, LAWS["coulomb_viscous"]()), recording, profiles=False)
    # The sample is LuGre and asymmetric; a motion that is imposed is taken with its noise.
    wide = 0.15 if imposed else 0.1
    assert found.values["mu_c"] == pytest.approx(3.0 if system == "drive" else 0.3, rel=wide)


@pytest.mark.parametrize(("noise", "wanted"), [(0.001, True), (0.05, False)])
def test_a_motion_that_was_measured_well_is_told_and_simulated_all_the_same(tmp_path, noise, wanted):
    cfg = default_config(["system=drive", f"data.path={written(tmp_path, drive(noise))}"], "check")
    system = build_system(cfg["system"])
    recording = build_recording(cfg["data"], system)
    assert measured_well(system, recording) is wanted and not system.massless


def test_the_diagnosed_recording_travels_with_the_augmented_model(tmp_path):
    path = written(tmp_path, drive())
    options = [
        "system=drive",
        "friction=coulomb_viscous",
        f"data.path={path}",
        "data.held_out=[3]",
        "data.units={x: m, default: SI}",
    ]
    done = call("diagnose.py", *options, "diagnose.effects=[drag]", "hydra.run.dir=found", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    model = tmp_path / "found" / "augmented.yaml"
    assert data_of(model)["held_out"] == ["3"] or data_of(model)["held_out"] == [3]
    given = cli.saved_friction(["model=bb1", f"friction={model}"])
    cfg = default_config(given, "train")
    assert cfg["data"]["name"] == "csv" and cfg["data"]["path"] == [str(path)]
    assert cfg["data"]["units"] == {"x": "m", "default": "SI"}
    assert not any(item.startswith("data") for item in cli.saved_friction(["data=simulated", f"friction={model}"])[1:2])


def test_options_that_would_be_read_nowhere_are_refused(tmp_path):
    with pytest.raises(UserError, match=r"a diagnosis does not smooth.*smoothing is savgol"):
        checked(default_config(["data.path=run.csv", "smoothing=savgol"], "diagnose"))
    cfg = default_config(["system=drive", f"data.path={written(tmp_path, drive())}", "data.trial_column=lap"], "check")
    with pytest.raises(UserError, match=r"unknown column: data.trial_column is 'lap'; allowed: trial, t, force"):
        build_recording(cfg["data"], build_system(cfg["system"]))


def test_trials_to_hold_out_that_there_are_not_are_refused_by_the_check_too(tmp_path):
    given = ["system=drive", f"data.path={written(tmp_path, drive())}", "data.held_out=[9]"]
    with pytest.raises(UserError, match=r"no such trial: data.held_out is 9; allowed: 1, 2, 3"):
        check(default_config(given, "check"))


def test_a_file_without_a_header_is_read_by_the_places_of_its_columns(tmp_path):
    drive()[["t", "x", "v", "force"]].iloc[:300].to_csv(tmp_path / "run.csv", index=False, header=False)
    options = ["system=drive", f"data.path={tmp_path / 'run.csv'}"]
    cfg = default_config(options, "check")
    with pytest.raises(
        UserError, match=r"no header row: .* 4 columns; .*c1 is the first; say data.columns=\{t: c1, x: c2"
    ):
        build_recording(cfg["data"], build_system(cfg["system"]))
    cfg = default_config([*options, "data.columns={t: c1, v: c3, force: c4}"], "check")
    recording = build_recording(cfg["data"], build_system(cfg["system"]))
    assert len(recording) == 300 and "ignored: c2" in recording.notes[0]


def test_the_check_refuses_a_smoothing_that_it_would_not_read():
    with pytest.raises(UserError, match=r"the check does not smooth: .*smoothing is savgol; .*leave smoothing= out"):
        check(default_config(["smoothing=savgol", f"data.path={SAMPLE}"], "check"))


def test_brackets_in_a_path_are_told_to_be_quoted():
    with pytest.raises(UserError, match=r"is data.path=run\[1\].csv; quote it: .data.path='run\[1\].csv'"):
        cli.check_command_line(ROOT / "conf", "check", ["data.path=run[1].csv"])
    cli.check_command_line(ROOT / "conf", "check", ["data.path='run[1].csv'"])


def test_the_recordings_of_an_arm_are_read_as_they_are():
    if measured_folder() is None:
        pytest.skip("the measured recordings are not on this machine (FRICTIONPINN_DATA)")
    files = sorted((measured_folder() / "ur10e").glob("*.csv.gz"))
    assert len(files) == 7
    for file in files:
        columns = "data.columns={t: c1, theta: c3, omega: c9, tau: c15}"
        cfg = default_config(["system=joint", f"data.path='{file}'", columns, "data.gains={tau: 13.26}"], "check")
        recording = build_recording(cfg["data"], build_system(cfg["system"]))
        assert len(recording) > 3000
        assert any("sampled unequally" in note for trial in recording.trials for note in trial.notes)


def test_a_start_that_cannot_be_simulated_names_the_culprit():
    table = pd.read_csv(SAMPLE)
    from frictionpinn.data.recording import Recording, Trial

    trials = [Trial(str(k), d.t.to_numpy(), {n: d[n].to_numpy() for n in ("x", "v", "a")} | {
        n: 60 * d[n].to_numpy() for n in ("theta", "omega", "alpha")}) for k, d in table.groupby("trial")]  # fmt: skip
    mechanism = Mechanism(SYSTEMS["pob"](), LAWS["coulomb_viscous"]())
    found = maximum_likelihood(mechanism, Recording(tuple(trials), {}))
    assert found.outcome == "failed"
    assert "degrees" in found.advice[0] and "trial 1" in found.advice[0]


def test_findings_of_public_sets_are_none(caplog):
    from frictionpinn.data.sets import load_public

    try:
        recording = load_public("brfd")
    except UserError:
        pytest.skip("the measured recordings are not on this machine")
    cfg = default_config(["system=damper", "data=brfd"], "check")
    with caplog.at_level("WARNING"):
        vet(cfg, build_system(cfg["system"]), recording)
    assert caplog.text == ""


def test_where_every_parameter_of_a_system_is_estimated_none_is_told_as_assumed():
    t = np.linspace(0.0, 1.0, 101)
    signals = {"x": np.sin(t), "force": np.cos(t)}
    recording = Recording((Trial("1", t, signals),), {"x": "m", "force": "N"})
    system = SYSTEMS["drive"]()
    assert "preload is 1" in assumptions(system, recording, ["M"])[0]
    assert not any("assumed" in line for line in assumptions(system, recording, ["M", "preload"]))


def test_a_table_with_units_is_quoted_in_its_texts_and_works_so():
    from frictionpinn.workflow.options import composed

    with pytest.raises(UserError, match=r"quote the texts in it: 'data\.units=") as caught:
        composed("check", ["system=joint", "data.units={theta: deg, alpha: deg/s^2, tau: N*m}"])
    advised = str(caught.value).partition("quote the texts in it: '")[2].rstrip("'")
    cfg = composed("check", ["system=joint", "data.path=run.csv", advised])
    assert cfg["data"]["units"] == {"theta": "deg", "alpha": "deg/s^2", "tau": "N*m"}


def test_columns_with_their_unit_in_brackets_are_used_and_not_ignored(tmp_path):
    import frictionpinn as fp

    t = np.arange(300) / 100
    table = pd.DataFrame({"Time [ms]": 1e3 * t, "x[mm]": np.sin(t), "F": np.cos(t), "lap": 1})
    table.to_csv(tmp_path / "run.csv", index=False)
    columns, units = {"t": "Time [ms]", "x": "x[mm]", "force": "F"}, {"t": "ms", "x": "mm", "default": "SI"}
    notes = fp.read(tmp_path / "run.csv", "drive", columns=columns, units=units, trial_column="lap").notes[0]
    assert "x from x[mm]" in notes and "ignored" not in notes
    with pytest.raises(UserError, match=r"no signal of coordinate x .*columns Time \[ms\], x\[mm\], F, lap"):
        fp.read(tmp_path / "run.csv", "drive")
    with pytest.raises(UserError, match="not a file: read is DataFrame"):
        fp.read(table, "drive")
