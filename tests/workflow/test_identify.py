"""Estimators beside each other: one draw for all, the published protocol, measured data, mistakes in one line."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from frictionpinn.errors import UserError
from frictionpinn.evaluate.estimate_figures import residuals_figure
from frictionpinn.evaluate.estimators import rows, table
from frictionpinn.workflow.estimate import default_config
from frictionpinn.workflow.identify import bounds_of, identify, start_within

DRIVE = [
    "system=drive",
    "data.rate_hz=200",
    "data.trials=[{duration: 2.0, force: '5*sin(2*pi*t)'}, {duration: 2.0, force: '8*sin(3*pi*t)'}]",
    "data.held_out=[2]",
    "noise.level=0.02",
    "epochs=20",
    "simulations=40",
]


@pytest.fixture(scope="module")
def compared(tmp_path_factory) -> dict:
    folder = tmp_path_factory.mktemp("identify")
    methods = "methods=[maximum_likelihood,pe1,least_squares,nelder_mead,genetic]"
    result = identify(default_config([*DRIVE, methods, "bounds=near", "friction=lugre_tied"], "identify"), folder)
    assert json.loads((folder / "result.json").read_text())["methods"] == json.loads(json.dumps(result["methods"]))
    assert (folder / "error_against_time.png").stat().st_size > 10_000
    assert (folder / "fit.png").stat().st_size > 10_000
    return result


def test_one_method_and_seed_draw_the_fit_and_no_figure_of_a_single_dot(tmp_path, caplog):
    options = ["system=drive", "friction=coulomb_viscous", "methods=[maximum_likelihood]", "bounds=data"]
    (tmp_path / "error_against_time.png").write_bytes(b"of an earlier run")
    with caplog.at_level("INFO"):
        identify(default_config([*DRIVE[1:4], *options], "identify"), tmp_path)
    assert {item.name for item in tmp_path.iterdir()} == {"fit.png", "result.json"}
    assert f"fit.png (the fit over the measurement) and result.json are in {tmp_path}" in caplog.text


def test_a_search_alone_draws_its_fit_over_the_measurement(tmp_path, monkeypatch):
    made = []

    def kept(found, recording):
        made.append(residuals_figure(found, recording))
        return made[-1]

    monkeypatch.setattr("frictionpinn.workflow.identify.residuals_figure", kept)
    options = ["system=drive", "friction=coulomb_viscous", "methods=[least_squares]", "bounds=data"]
    identify(default_config([*DRIVE[1:4], *options], "identify"), tmp_path)
    assert (tmp_path / "fit.png").stat().st_size > 10_000
    measured, model = made[0].axes[0].lines
    assert made[0].axes[0].get_ylabel() == "x (m)" and np.ptp(measured.get_ydata()) > 0
    assert np.std(model.get_ydata() - measured.get_ydata()) < 0.2 * np.std(measured.get_ydata())


def test_every_estimator_has_the_same_bounds_and_start(compared):
    runs = [entry for runs in compared["methods"].values() for entry in runs]
    assert all(run["bounds"] == runs[0]["bounds"] and run["start"] == runs[0]["start"] for run in runs)
    for name, (low, high) in runs[0]["bounds"].items():
        assert low == pytest.approx(0.8 * compared["truth"][name]) and low <= runs[0]["start"][name] <= high


def test_the_tie_gives_the_damping_from_the_stiffness(compared):
    for runs in compared["methods"].values():
        values = runs[0]["values"]
        assert values["sigma_1"] == pytest.approx(math.sqrt(values["sigma_0"]))


def test_the_way_of_a_search_ends_at_its_estimate(compared):
    for method, (run,) in compared["methods"].items():
        times, errors = zip(*run["trace"], strict=True)
        assert list(times) == sorted(times) and errors[-1] == run["force_mse"], method
    likely = compared["methods"]["maximum_likelihood"][0]
    assert likely["force_mse"] < 0.01 and likely["simulations"] > 0


def test_the_table_names_units_estimators_and_the_truth(compared):
    told = table(compared)
    assert "sigma_0 (N/m)" in told and "maximum likelihood" in told and max(map(len, told.splitlines())) <= 120
    cells = list(rows(compared))
    assert cells[-1][0] == "truth" and float(cells[-1][1]) == compared["truth"]["sigma_0"]


def test_a_decade_of_bounds_holds_the_truth_somewhere_else_for_every_seed():
    cfg = default_config(["bounds=decade"], "identify")
    truth, places = cfg["data"]["truth"], []
    for seed in range(20):
        bounds = bounds_of(cfg, seed)
        start = start_within(bounds, seed)
        assert start["mu_s"] > start["mu_c"]
        for name, (low, high) in bounds.items():
            assert high / low == pytest.approx(10) and low < truth[name] < high
            assert low <= start[name] <= high or name == "mu_c"
        places.append(math.log10(truth["sigma_0"] / bounds["sigma_0"][0]))
    assert np.ptp(places) > 0.3


def test_a_recording_of_ones_own_is_identified_without_a_truth(csv, tmp_path):
    options = ["data=csv", f"data.path={csv()}", "bounds=data", "methods=[maximum_likelihood]"]
    options += ["friction.fixed.mu_s=0.6", "friction.fixed.v_s=1e-3"]
    result = identify(default_config(options, "identify"), tmp_path)
    (run,) = result["methods"]["maximum_likelihood"]
    assert result["truth"] is None and run["values"]["mu_c"] == pytest.approx(0.3, rel=0.1)
    assert run["force_mse"] > 0 and run["start"] == {}


@pytest.fixture(scope="module")
def trained(quick, tmp_path_factory):
    """A short training of PE2 on the mechanism of ``DRIVE``, and one of BB1."""
    folders = {}
    for model in ("pe2", "bb1"):
        folders[model] = tmp_path_factory.mktemp(model)
        quick(folders[model], f"model={model}", *DRIVE[:-2])
    return folders


def test_every_estimator_starts_where_a_trained_network_ended(trained, tmp_path):
    options = [*DRIVE, "bounds=data", "methods=[maximum_likelihood,nelder_mead]", f"start={trained['pe2']}"]
    result = identify(default_config(options, "identify"), tmp_path)
    found = json.loads((trained["pe2"] / "result.json").read_text())["parameters"]
    for runs in result["methods"].values():
        assert runs[0]["start"]["mu_c"] == pytest.approx(found["mu_c"]["value"], rel=1e-6)
        assert runs[0]["start"]["sigma_2"] == pytest.approx(found["sigma_2"]["value"], rel=1e-6)
    assert str(trained["pe2"]) in table(result)


def test_a_network_is_trained_once_and_the_others_start_from_it(tmp_path):
    options = [*DRIVE, "methods=[maximum_likelihood,pe2,nelder_mead]", "start=pe2"]
    methods = identify(default_config(options, "identify"), tmp_path)["methods"]
    assert list(methods) == ["maximum_likelihood", "pe2", "nelder_mead"]
    network = methods["pe2"][0]
    for name in ("maximum_likelihood", "nelder_mead"):
        assert methods[name][0]["start"] != network["start"]
        assert methods[name][0]["start"]["mu_c"] == network["values"]["mu_c"]


def test_a_start_may_be_given_by_name_and_is_moved_inside_the_bounds(tmp_path):
    options = [*DRIVE, "bounds=near", "methods=[least_squares]", "start={mu_c: 1.0, v_s: 5e-3}"]
    (run,) = identify(default_config(options, "identify"), tmp_path)["methods"]["least_squares"]
    assert run["start"]["v_s"] == 5e-3 or run["start"]["v_s"] in run["bounds"]["v_s"]
    assert run["start"]["mu_c"] == run["bounds"]["mu_c"][0]


def test_a_start_that_cannot_be_is_told_in_one_line(trained, tmp_path):
    for start, told in {
        "start=pe3": "did you mean 'pe2'|did you mean 'pe1'",
        "start={mu_k: 0.3}": "did you mean 'mu_",
        "start={mu_c: -0.3}": "impossible value: start.mu_c is -0.3",
        "start={mu_c: high}": "impossible value: start.mu_c",
        f"start={trained['bb1']}": "train one: python train.py model=pe2",
        f"start={tmp_path}": "no result.json: start is",
    }.items():
        with pytest.raises(UserError, match=told) as caught:
            identify(default_config([*DRIVE, "methods=[nelder_mead]", start], "identify"), tmp_path)
        assert "\n" not in str(caught.value)
    other = [start for start in DRIVE if not start.startswith(("system", "data"))] + ["system=pob"]
    with pytest.raises(UserError, match="say system=drive"):
        identify(default_config([*other, f"start={trained['pe2']}"], "identify"), tmp_path)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (["methods=[nelder_meed]"], "did you mean 'nelder_mead'"),
        (["methods=[]"], "no estimators"),
        (["seeds=[]"], "impossible seeds"),
        (["jobs=0"], "impossible number of processes"),
        (["data=csv", "data.path=run.csv"], "add bounds=data"),
        (["simulations=few"], "impossible number: simulations is 'few'; allowed: at least 1"),
        (["simulations=-5"], "impossible number: simulations is -5"),
        (["friction=coulomb"], "leave pe1 out, or choose friction=lugre"),
        (["friction.bounds.mu_c=[0.5,0.2]"], "impossible bounds: friction.bounds.mu_c"),
        ([*DRIVE, "friction.fixed.mu_c=-1", "methods=[nelder_mead]"], "impossible value: fixed.mu_c is -1; allowed: a"),
    ],
)
def test_a_mistake_is_told_in_one_line(wrong, told, tmp_path):
    with pytest.raises(UserError, match=told) as caught:
        identify(default_config(wrong, "identify"), tmp_path)
    assert "\n" not in str(caught.value)
