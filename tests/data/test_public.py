"""The public sets: fetching, checksums and customary preparation."""

import functools
import http.server
import itertools
import json
import os
import threading
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from frictionpinn.data import public
from frictionpinn.data.prepare import decimate, differentiate, lowpass, resample, thin
from frictionpinn.data.public import DATASETS, fetch, read_brfd
from frictionpinn.data.recording import Trial
from frictionpinn.data.sets import FIT, HELD_OUT, LOADERS, load_brfd, load_emps, load_multiarm_pendulum, load_public
from frictionpinn.errors import UserError
from frictionpinn.numerics.torch_functions import contact_signals
from frictionpinn.physics import SYSTEMS

FOLDER = Path(os.environ.get("FRICTIONPINN_DATA") or Path(__file__).parents[3] / "shared" / "measured").expanduser()
measured = pytest.mark.skipif(
    not all((FOLDER / dataset.folder).is_dir() for dataset in DATASETS.values()),
    reason=f"no recordings in {FOLDER}: set FRICTIONPINN_DATA to the folder of emps/, multiarm_pendulum/ and brfd/",
)


@pytest.fixture(autouse=True)
def _data_folder(monkeypatch):
    monkeypatch.setenv("FRICTIONPINN_DATA", str(FOLDER))


@functools.cache
def recording(name):
    return LOADERS[name]()


# ---- fetching


@measured
@pytest.mark.parametrize("name", DATASETS)
def test_files_at_hand_are_verified_and_used_as_they_are(name, monkeypatch):
    monkeypatch.setattr(public, "_download", lambda *_: pytest.fail("downloaded a file that is there"))
    files = fetch(name)
    assert set(files) == set(DATASETS[name].files)
    assert all(path.is_relative_to(FOLDER) for path in files.values())


@pytest.mark.parametrize(("name", "stored"), [("emps", "DATA_EMPS.mat"), ("brfd", "dataset3_1Hz_30lb_1in.csv.gz")])
def test_a_file_that_is_not_the_published_one_is_refused_and_kept(name, stored, tmp_path, monkeypatch):
    monkeypatch.setenv("FRICTIONPINN_DATA", str(tmp_path))
    path = tmp_path / name / stored
    path.parent.mkdir()
    path.write_bytes(b"something else")
    with pytest.raises(UserError, match=r"wrong checksum: .*delete the file") as caught:
        fetch(name, ["fit" if name == "emps" else "dataset3_1Hz_30lb_1in"])
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    assert path.read_bytes() == b"something else"


class Server:
    """A web server on this machine that answers every request with ``body``, or with its first half alone."""

    def __init__(self, body, cut=False):
        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                self.send_response(200)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body[: len(body) // 2] if cut else body)

            def log_message(self, *_):
                pass

        self.http = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)

    def __enter__(self):
        threading.Thread(target=self.http.serve_forever, daemon=True).start()
        return f"http://127.0.0.1:{self.http.server_port}/file"

    def __exit__(self, *_):
        self.http.shutdown()
        self.http.server_close()


def from_url(monkeypatch, folder, name, key, url):
    """Let the file come from ``url`` into an empty ``folder``."""
    for variable in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("FRICTIONPINN_DATA", str(folder))
    monkeypatch.setitem(DATASETS[name].files, key, replace(DATASETS[name].files[key], url=url))


@pytest.mark.parametrize(("name", "key"), [("emps", "fit"), ("brfd", "dataset3_1Hz_30lb_1in")])
@pytest.mark.parametrize(("body", "cut"), [(b"<html>not found</html>", False), (b"0123456789" * 9999, True)])
def test_a_wrong_or_interrupted_download_is_a_user_error_and_leaves_nothing(
    name, key, body, cut, tmp_path, monkeypatch
):
    with Server(body, cut) as url, pytest.raises(UserError, match=r"download failed|wrong checksum") as caught:
        from_url(monkeypatch, tmp_path, name, key, url)
        fetch(name, [key])
    assert "\n" not in str(caught.value)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_download_that_broke_off_succeeds_at_the_second_call(tmp_path, monkeypatch):
    body = b"0123456789" * 9999
    with Server(body, cut=True) as url, pytest.raises(UserError, match="download failed") as caught:
        from_url(monkeypatch, tmp_path, "emps", "fit", url)
        monkeypatch.setitem(
            DATASETS["emps"].files, "fit", replace(DATASETS["emps"].files["fit"], sha256=sha256(body).hexdigest())
        )
        fetch("emps", ["fit"])
    assert url in str(caught.value) and "\n" not in str(caught.value)
    with Server(body) as url:
        monkeypatch.setitem(DATASETS["emps"].files, "fit", replace(DATASETS["emps"].files["fit"], url=url))
        path = fetch("emps", ["fit"])["fit"]
    assert path.read_bytes() == body and list(path.parent.iterdir()) == [path]


def test_without_network_the_error_says_where_to_put_the_file(tmp_path, monkeypatch):
    with Server(b"") as url:
        pass
    from_url(monkeypatch, tmp_path, "emps", "fit", url)
    with pytest.raises(UserError, match=r"download failed: .* put DATA_EMPS\.mat into .*emps .*FRICTIONPINN_DATA"):
        fetch("emps", ["fit"])


@measured
def test_a_sound_download_is_stored_and_fetched_once(tmp_path, monkeypatch):
    body = (FOLDER / "emps" / "DATA_EMPS.mat").read_bytes()
    with Server(body) as url:
        from_url(monkeypatch, tmp_path, "emps", "fit", url)
        first = fetch("emps", ["fit"])["fit"]
    assert first.read_bytes() == body
    assert fetch("emps", ["fit"])["fit"] == first


@measured
def test_the_damper_files_count_as_the_same_whether_json_or_csv(tmp_path, monkeypatch):
    key = "dataset3_1Hz_30lb_1in"
    rows = read_brfd(fetch("brfd", [key])[key])
    # The public files carry more digits than the checksum is taken of.
    public_rows = rows * (1 + 1e-10)
    with Server(json.dumps({"data": public_rows.tolist()}).encode()) as url:
        from_url(monkeypatch, tmp_path, "brfd", key, url)
        path = fetch("brfd", [key])[key]
    assert path.name == f"{key}.json"
    np.testing.assert_array_equal(read_brfd(path), rows)


def test_an_unknown_set_or_file_suggests_the_nearest():
    with pytest.raises(UserError, match="did you mean 'emps'"):
        fetch("emp")
    with pytest.raises(UserError, match="did you mean 'pulses'"):
        fetch("emps", ["pulse"])
    with pytest.raises(UserError, match="did you mean 'brfd'"):
        load_public("brdf")
    with pytest.raises(UserError, match="brfd dataset is 4; allowed: 2, 3"):
        load_brfd(4)


def test_every_file_has_a_pinned_address_and_a_checksum():
    files = [file for dataset in DATASETS.values() for file in dataset.files.values()]
    assert len({file.url for file in files}) == len({file.sha256 for file in files}) == len(files) == 32
    assert all(len(file.sha256) == 64 and "/main/" not in file.url and " " not in file.url for file in files)


# ---- preparation


def test_decimation_keeps_constants_and_slow_signals_and_adds_no_delay():
    t = np.arange(5000) / 1000
    slow = 3.0 + np.sin(2 * np.pi * 2 * t)
    for factor in (1, 5, 12, 50):
        np.testing.assert_allclose(decimate(np.full(5000, np.pi), factor), np.pi, rtol=1e-7)
        middle = slice(1000 // factor, 4000 // factor)
        np.testing.assert_allclose(decimate(slow, factor)[middle], slow[::factor][middle], atol=0.012)
    values, linear = np.random.default_rng(0).normal(size=(2, 5000))
    np.testing.assert_allclose(
        decimate(2 * values - linear, 12), 2 * decimate(values, 12) - decimate(linear, 12), atol=1e-12
    )


def test_position_is_differentiated_without_delay():
    t = np.arange(2000) / 1000
    x, v, a = differentiate(t, np.sin(6 * t), 100.0)
    inner = slice(100, -100)
    np.testing.assert_allclose(x[inner], np.sin(6 * t)[inner], atol=1e-5)
    np.testing.assert_allclose(v[inner], 6 * np.cos(6 * t)[inner], atol=1e-3)
    np.testing.assert_allclose(a[inner], -36 * np.sin(6 * t)[inner], atol=1e-2)


def test_uneven_sampling_is_made_even_before_it_is_thinned():
    t = np.cumsum(np.random.default_rng(0).uniform(0.5e-3, 1.5e-3, 3000))
    trial = Trial("a", t, {"x": np.sin(6 * t)})
    even = resample(trial, 1000.0)
    np.testing.assert_allclose(even.signals["x"], np.sin(6 * even.t), atol=1e-4)
    thinned = thin(trial, 100.0)
    assert 90 < 1 / np.diff(thinned.t).mean() < 110
    inner = slice(10, -10)
    np.testing.assert_allclose(thinned.signals["x"][inner], np.sin(6 * thinned.t[inner]), atol=5e-3)


@pytest.mark.parametrize("cutoff_hz", [0.0, 500.0, -1.0, np.nan])
def test_a_cutoff_beyond_half_the_rate_is_refused(cutoff_hz):
    with pytest.raises(UserError, match=r"cutoff out of range: cutoff_hz is .* Hz; allowed: above 0 and below 500 Hz"):
        lowpass(np.ones(100), 1000.0, cutoff_hz)
    with pytest.raises(UserError, match="too few samples to filter"):
        lowpass(np.ones(10), 1000.0, 100.0)


@measured
@pytest.mark.parametrize("name", DATASETS)
def test_the_customary_split_covers_the_set(name):
    loaded = recording(name)
    assert sorted(FIT[name] + HELD_OUT[name]) == sorted(loaded.names)
    for trial in loaded.trials:
        assert set(trial.signals) == set(loaded.units)
        assert all(len(values) == len(trial) and np.isfinite(values).all() for values in trial.signals.values())
        assert (np.diff(trial.t) > 0).all()


def regression(trial, factor):
    """Return the regressors (a, v, sign v, 1) and the force, both passed through the same decimation."""
    v = trial.signals["v"]
    columns = np.stack([trial.signals["a"], v, np.sign(v), np.ones_like(v)], axis=1)
    return decimate(columns, factor), decimate(trial.signals["force"], factor)


@measured
def test_the_published_regression_of_the_drive_is_reproduced():
    fit, pulses = load_emps(rate_hz=None).trials
    columns, force = regression(fit, 10)
    found = np.linalg.lstsq(columns, force, rcond=None)[0]
    np.testing.assert_allclose(found, [95.11, 203.50, 20.39, -3.165], rtol=2e-3)
    error = np.linalg.norm(force - columns @ found) / np.linalg.norm(force)
    assert 100 * error == pytest.approx(4.08, abs=0.1)
    columns, force = regression(pulses, 10)
    error = np.linalg.norm(force - columns @ found) / np.linalg.norm(force)
    assert 100 * error == pytest.approx(5.98, abs=0.1)


@measured
def test_a_pointwise_model_of_the_prepared_drive_comes_close_to_the_published_error():
    fit, pulses = recording("emps").trials
    columns, force = regression(fit, 1)
    found = np.linalg.lstsq(columns, force, rcond=None)[0]
    np.testing.assert_allclose(found, [95.11, 203.50, 20.39, -3.16], rtol=0.03)
    for trial, published in ((fit, 4.08), (pulses, 5.98)):
        columns, force = regression(trial, 1)
        error = np.linalg.norm(force - columns @ found) / np.linalg.norm(force)
        assert 100 * error == pytest.approx(published, abs=0.3)
    assert 1 / np.diff(fit.t).mean() == pytest.approx(80, rel=0.06)


@measured
def test_the_pendulum_is_one_run_cut_in_six_and_a_raw_run_that_sticks():
    trials = recording("multiarm_pendulum").trials
    for before, after in itertools.pairwise(trials[:6]):
        assert after.t[0] - before.t[-1] == pytest.approx(0.005, abs=1e-6)
    for trial in trials:
        t, signals = trial.t, trial.signals
        rate, acceleration = np.gradient(signals["theta"], t), np.gradient(signals["omega"], t)
        assert np.std(rate[2:-2] - signals["omega"][2:-2]) < 0.03 * np.std(rate)
        assert np.std(acceleration[2:-2] - signals["alpha"][2:-2]) < 0.03 * np.std(acceleration)
    raw = trials[-1]
    after = raw.t > 67
    assert np.ptp(raw.signals["theta"][after]) < 1e-3 < 0.1 < np.ptp(raw.signals["theta"])
    assert abs(raw.signals["theta"][after] - np.pi).max() < 2e-3
    assert load_multiarm_pendulum(rate_hz=100.0).trials[0].t[:2].tolist() == pytest.approx([0.08, 0.09])


@pytest.mark.parametrize("cutoff_hz", [None, "abc", 0.0, 0.1, float("nan")])
def test_a_low_pass_that_takes_the_swings_away_is_refused(cutoff_hz):
    with pytest.raises(UserError, match=r"impossible low-pass: multiarm_pendulum cutoff_hz is .*; allowed: a number"):
        load_multiarm_pendulum(cutoff_hz=cutoff_hz)


@measured
@pytest.mark.parametrize("from_angle", [True, False])
def test_the_pendulum_obeys_its_equation_of_motion_up_to_the_ends_of_its_runs(from_angle):
    own = OmegaConf.load(Path(__file__).parents[2] / "conf" / "data" / "multiarm_pendulum.yaml").system.parameters
    system, weight = SYSTEMS["pendulum"](**own), own.m * own.g * own.l
    *run, raw = load_multiarm_pendulum(from_angle=from_angle).trials  # the raw run sticks at its end
    for trial, end in ((run[0], slice(0, 5)), (run[-1], slice(-5, None)), (raw, slice(0, 5))):
        implied = contact_signals(system, trial.signals)["friction_force"]
        assert abs(implied[end]).max() < 0.05 * abs(weight * np.sin(trial.signals["theta"])).max()
    assert run[0].derived == (("omega", "alpha") if from_angle else ("alpha",))
    assert raw.derived == ("omega", "alpha")


@measured
def test_the_damper_is_in_metres_and_newtons_at_the_named_amplitude():
    for trial in recording("brfd").trials:
        frequency, tension, amplitude = trial.name.split("_")
        assert tension == "30lb"
        assert 1 / np.diff(trial.t).mean() == pytest.approx(128)
        x, v, force = (trial.signals[name] for name in ("x", "v", "force"))
        inch = float(amplitude.removesuffix("in")) * 0.0254
        assert abs(x).max() == pytest.approx(inch, rel=0.06)
        assert 10e3 < abs(force).max() < 25e3
        if frequency != "1Hz":
            assert abs(v).max() == pytest.approx(2 * np.pi * float(frequency.removesuffix("Hz")) * inch, rel=0.2)
        # Friction opposes motion, and takes energy.
        assert np.mean(force * v) > 0
    assert len(load_brfd(2).trials) == 10
