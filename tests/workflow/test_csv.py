"""A user's own recording: the same data give the same training, however the file is written."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from frictionpinn.data.recording import Recording, Trial
from frictionpinn.errors import UserError
from frictionpinn.workflow.build import build_system
from frictionpinn.workflow.diagnose import split
from frictionpinn.workflow.experiment import build_data
from frictionpinn.workflow.train import announce


@pytest.fixture
def contact(configure, tmp_path):
    """The training trial's signals for data=csv with overrides."""

    def read(path, *overrides):
        cfg = configure("data=csv", f"data.path={path}", "smoothing=none", *overrides)
        data = build_data(cfg, build_system(cfg["system"]))
        return data, data.by_name["1"].offline

    return read


def same(one, other):
    for name, values in one.items():
        np.testing.assert_allclose(other[name], values, rtol=1e-9, atol=1e-12, err_msg=name)


def test_units_and_gains_are_understood(contact, csv):
    _, plain = contact(csv())
    scaled = csv(lambda table: table.assign(v=table.v * 1e3, omega=np.rad2deg(table.omega), a=table.a / 2))
    _, read = contact(scaled, "data.units={v: mm/s, omega: deg/s, default: SI}", "data.gains={a: 2.0}")
    same(plain, read)


def test_one_unit_can_be_added_on_the_command_line(contact, csv, check, tmp_path):
    path = csv(lambda table: table.assign(x=table.x * 1e3))
    override = "data.units={x: mm, default: SI}"
    check(tmp_path / "run", "data=csv", f"data.path={path}", override)


def test_decimal_commas_that_no_early_row_shows_are_read_once_the_mark_is_given(contact, csv):
    def in_whole_ms(table):
        at_rest = table[table.trial == 1].iloc[:60] * [1, 1, *[0] * 6]
        moving = table.assign(t=table.t + np.where(table.trial == 1, 0.3, 0.0))
        return pd.concat([at_rest, moving]).assign(t=lambda both: (1e3 * both.t).round())

    _, plain = contact(csv(in_whole_ms), "data.units={t: ms, default: SI}")
    path = csv(lambda _: None)
    in_whole_ms(pd.read_csv(path)).map(lambda x: f"{x:.17g}".replace(".", ",")).to_csv(path, sep=";", index=False)
    with pytest.raises(UserError, match="where commas mark decimals"):
        contact(path, "data.units={t: ms, default: SI}")
    _, read = contact(path, "data.units={t: ms, default: SI}", 'data.decimal=","', 'data.delimiter=";"')
    same(plain, read)


@pytest.mark.parametrize("mark", ["data.decimal=x", "data.delimiter=ab", 'data.decimal=","'])
def test_a_mark_that_no_text_file_has_is_refused_in_a_line(contact, csv, mark):
    with pytest.raises(UserError, match=mark.partition("=")[0]):
        contact(csv(), mark, *(['data.delimiter=","'] if "," in mark else []))


def test_columns_that_are_not_needed_are_ignored(contact, csv):
    _, plain = contact(csv())
    _, read = contact(csv(lambda table: table.assign(comment="hot", temperature=20.0)[table.columns[::-1].tolist()]))
    same(plain, read)


@pytest.mark.parametrize("option", ["data.columns={a: null}", "data.columns={a: ''}"])
def test_a_column_is_left_out_and_the_others_are_found_by_name(contact, csv, option):
    data, _ = contact(csv(), option)
    assert "a" not in data.recording.trials[0].signals
    assert {"x", "v", "theta", "omega", "alpha"} <= set(data.recording.trials[0].signals)


@pytest.mark.parametrize("kind", ["a flag that rises", "text", "a gap"])
def test_a_column_called_start_that_is_no_time_of_a_trial_is_ignored(contact, csv, kind):
    _, plain = contact(csv())
    late = {"a flag that rises": (0, 1), "text": ("idle", "run"), "a gap": (np.nan, 1.0)}[kind]
    data, read = contact(csv(lambda table: table.assign(start=np.where(table.t > 0.2, late[1], late[0]))))
    same(plain, read)
    assert "ignored: start" in data.recording.notes[0]


def test_a_column_called_start_that_is_a_time_of_each_trial_is_read(contact, csv):
    data, _ = contact(csv(lambda table: table.assign(start=60.0 * (table.trial == table.trial.iloc[-1]))))
    assert [trial.start for trial in data.recording.trials][-1] == 60.0


def test_missing_velocities_and_accelerations_are_derived(contact, csv):
    data, read = contact(csv(lambda table: table[["trial", "t", "x", "theta"]]))
    assert set(data.recording.trials[0].signals) == {"x", "theta"}
    assert np.isfinite(read["friction_force"]).all() and read["v_slip"].std() > 0


def test_without_a_trial_column_each_file_is_a_trial(contact, configure, measured_table, tmp_path):
    for number, table in measured_table.groupby("trial"):
        table.drop(columns="trial").to_csv(tmp_path / f"{number}.csv", index=False)
    data, _ = contact(tmp_path)
    assert data.splits == {"train": ["1"], "validation": [], "held_out": ["2"]}
    assert "samples of 1 trial; held out: 2" in announce({"model": {"name": "pe2"}}, data)


def test_a_single_recording_trains_though_nothing_is_held_out(quick, csv, tmp_path):
    path = csv(lambda table: table[table.trial == 1].drop(columns="trial"))
    result = quick(tmp_path / "run", "data=csv", f"data.path={path}", "model=bb1")
    assert result["force_error"]["on"] == "training trials (none held out)"
    assert result["data"]["trials"]["train"] == ["run"]


def test_the_shortest_allowed_trials_train(quick, csv, tmp_path):
    path = csv(lambda table: table.groupby("trial").head(10))
    for smoothing in ("kalman", "savgol", "spline", "none"):
        result = quick(tmp_path / smoothing, "data=csv", f"data.path={path}", "model=pe2", f"smoothing={smoothing}")
        assert np.isfinite(result["force_error"]["model"]["rmse"])


def test_uneven_sampling_trains(quick, csv, tmp_path):
    path = csv(lambda table: table.sample(frac=0.8, random_state=1).sort_index())
    result = quick(tmp_path / "run", "data=csv", f"data.path={path}", "model=pe2")
    assert np.isfinite(result["force_error"]["model"]["rmse"])


def test_noise_is_not_added_to_a_measurement_unless_asked_for(contact, csv):
    _, plain = contact(csv())
    _, noisy = contact(csv(), "noise=gaussian")
    assert np.abs(noisy["v_slip"] - plain["v_slip"]).max() > 0
    assert contact(csv())[0].recording.checksum == contact(csv(), "noise=gaussian")[0].recording.checksum


def test_a_diagnosis_of_one_trial_holds_out_its_end_unless_told_to_hold_out_nothing():
    t = np.arange(100) / 100
    recording = Recording((Trial("run", t, {"x": t}),), {"x": "m"})
    fitted, held_out = split(recording, {"held_out": None})
    assert fitted.names == ["run (start)"] and held_out.names == ["run (end)"]
    fitted, held_out = split(recording, {"held_out": []})
    assert fitted.names == ["run"] and not held_out.trials
