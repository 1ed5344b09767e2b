"""What the functions return is readable: a short text, a page for notebooks, figures, plain types, files."""

from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.figure import Figure

import frictionpinn as fp
from frictionpinn.errors import UserError
from frictionpinn.identify import Estimate
from frictionpinn.report.words import span
from frictionpinn.show import estimated, interval

VALUES = {"mu_c": 3.0, "sigma_2": 2.0}
TRIALS = [{"duration": 1.0, "force": "8*sin(2*pi*t)"}, {"duration": 1.0, "force": "9*sin(3*pi*t)"}]


@pytest.mark.parametrize(
    ("ends", "told"),
    [
        ((0.019996, 0.020004), "0.019996 to 0.020004"),
        ((0.29991, 0.30003), "0.29991 to 0.30003"),
        ((2.9, 3.1), "2.9 to 3.1"),
        ((-1.234567, 1.0), "-1.235 to 1"),
        ((0.0, 2.0), "0 to 2"),
        ((5.0, 5.0), "5 to 5"),
        ((1.0, np.inf), "1 to inf"),
        ((None, None), ""),
    ],
)
def test_the_ends_of_a_narrow_interval_are_told_apart(ends, told):
    assert interval(ends) == told
    assert span(ends) == (told or "not told by these data")


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_trials_named_by_numbers_with_leading_zeros_keep_their_names_when_saved(model, tmp_path, ending):
    made = fp.simulate(model, VALUES, [trial | {"name": f"00{k}"} for k, trial in enumerate(TRIALS)], rate_hz=100)
    assert fp.read(made.save(tmp_path / f"log{ending}"), model.system).names == ["000", "001"]


def test_an_estimate_is_told_with_as_many_digits_as_its_interval():
    assert estimated(0.30003, (0.30001, 0.30005)) == "0.30003" and estimated(3.0001, (2.9, 3.1)) == "3"
    assert estimated(0.123456, (None, np.nan)) == "0.1235"


@pytest.fixture(scope="module")
def model():
    return fp.mechanism(fp.system("drive", M=2.0), "coulomb_viscous")


@pytest.fixture(scope="module")
def log(model):
    return fp.simulate(model, VALUES, TRIALS, rate_hz=200, noise=0.01)


@pytest.fixture(scope="module")
def results(model, log, tmp_path_factory):
    """One of each kind."""
    short = {"trainer": {"max_epochs": 2, "progress_bar": False}}
    run = fp.train(fp.mechanism(model.system), log, model="pe1", folder=tmp_path_factory.mktemp("run") / "run", **short)
    return {
        "recording": log,
        "check": fp.check(log, model.system),
        "mechanism": model,
        "fit": fp.fit(model, log),
        "bound": fp.bound(model, log, VALUES),
        "diagnosis": fp.diagnose(model, log, effects=["constant_force"]),
        "run": run,
        "evaluation": fp.evaluate(run, identify=False, grid=5),
    }


KINDS = ["recording", "check", "mechanism", "fit", "bound", "diagnosis", "run", "evaluation"]


class Page(HTMLParser):
    """Counts tags, and those that are open at the end."""

    def __init__(self, text: str):
        super().__init__()
        self.seen: list[str] = []
        self.open: list[str] = []
        self.heads: list[dict] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.seen.append(tag)
        if tag == "th":
            self.heads.append(dict(attrs))
        if tag != "img":
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_prints_as_a_few_short_lines(results, kind):
    text = repr(results[kind])
    assert len(text) < 4000 and len(text.splitlines()) <= 40 and max(map(len, text.splitlines())) <= 120
    assert "array(" not in text and "object at" not in text


def test_of_many_parameters_each_is_printed_and_of_many_trials_the_first_ones(results, log):
    fit = results["fit"]
    names = tuple(f"joint_{k}.mu_c" for k in range(20))
    alike = {kind: dict.fromkeys(names, getattr(fit, kind)["mu_c"]) for kind in ("values", "units", "ci95")}
    many = replace(fit, names=names, covariance=np.eye(20), **alike)
    assert all(name in str(many) for name in names) and str(many) == repr(many)
    session = replace(log, trials=tuple(replace(log.trials[0], name=f"run_{k}") for k in range(20)))
    assert "run_0" in str(session) and "run_19" not in str(session) and "and 8 more" in str(session)


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_is_a_page_in_a_notebook_with_its_figures(results, kind):
    page = Page(results[kind]._repr_html_())
    assert not page.open and page.seen.count("table") >= 1
    assert page.heads and all(head["scope"] == "col" for head in page.heads)
    assert page.seen.count("img") == len(results[kind].figures())


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "mechanism"])
def test_a_result_is_plotted_by_name_and_a_wrong_name_is_told(results, kind):
    names = list(results[kind].figures())
    assert all(isinstance(results[kind].plot(name), Figure) for name in [None, *names])
    with pytest.raises(fp.UserError, match=f"unknown option: figure is 'nothing'; allowed: .*{names[0]}"):
        results[kind].plot("nothing")


def test_a_fit_is_drawn_over_the_measurement_with_units_and_what_is_left_below(results, log):
    fit, (first, second) = results["fit"], log.trials
    figure = fit.plot("residuals")
    grid = np.reshape(figure.axes, (-1, 2))
    assert [axes.get_ylabel() for axes in grid[:-1, 0]] == ["x (m)", "v (m/s)", "a (m/s²)"]
    assert [axes.get_title() for axes in grid[0]] == [
        "trial 1",
        "trial 2",
    ] and "converged" in figure._suptitle.get_text()
    for axes, trial in zip(grid[0], (first, second), strict=True):
        measured, model = axes.lines
        assert np.array_equal(measured.get_xdata(), trial.t) and np.array_equal(
            measured.get_ydata(), trial.signals["x"]
        )
        assert np.allclose(model.get_ydata(), trial.signals["x"] + fit.residuals[trial.name]["x"])
    assert all(axes.get_xlabel() == "time (s)" for axes in grid[-1])
    searched = replace(fit, minimum=None).plot("residuals").axes  # what a search keeps
    assert len(searched) == 2 and searched[0].get_xlabel() == "sample"


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_is_plain_types_and_saves_itself(results, kind, tmp_path):
    assert json.loads(json.dumps(results[kind].to_dict()))
    path = results[kind].save(tmp_path / ("log.csv" if kind == "recording" else "folder"))
    assert path.is_file() if kind == "recording" else (path / "result.json").is_file()
    assert kind in ("recording", "mechanism") or len(list(path.rglob("*.png"))) >= len(results[kind].figures())


@pytest.mark.parametrize("kind", ["recording", "check", "fit", "bound", "diagnosis"])
def test_a_place_that_cannot_be_written_is_one_line(results, kind, tmp_path):
    (tmp_path / "taken").write_text("a file")
    (tmp_path / "taken.csv").mkdir()
    place = tmp_path / ("taken.csv" if kind == "recording" else "taken")
    with pytest.raises(fp.UserError, match=r"cannot write: .*taken.* name another"):
        results[kind].save(place)


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_saved_recording_is_read_back_as_it_was(model, log, tmp_path, ending):
    first, second = log.trials
    log = replace(log, trials=(first, replace(second, start=60.0)))  # after a pause
    again = fp.read(log.save(tmp_path / f"log{ending}"), model.system)
    assert again.names == log.names
    for old, new in zip(log.trials, again.trials, strict=True):
        assert (new.start, new.number) == (old.start, old.number) and np.array_equal(new.t, old.t)
        assert all(np.array_equal(new.signals[name], old.signals[name]) for name in old.signals)


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_what_cannot_be_saved_is_told_in_a_line(log, tmp_path, ending):
    with pytest.raises(UserError, match="nothing to save"):
        log.select([]).save(tmp_path / f"log{ending}")
    with pytest.raises(UserError, match=r"cannot write: .*name another file"):
        log.save(tmp_path / f"{300 * 'x'}{ending}")
    with pytest.raises(UserError, match=r"cannot write: .*name another folder"):
        log.save(tmp_path / (300 * "x") / f"log{ending}")


def test_a_recording_of_nothing_is_told_by_the_check(model, log):
    (told,) = fp.check(log.select([]), model.system).findings
    assert told.startswith("wrong: the recording has no trial")
    bare = replace(log, trials=tuple(replace(trial, signals={}) for trial in log.trials))
    (told,) = fp.check(bare, model.system).findings
    assert told.startswith("wrong: nothing of x was recorded")


def test_a_fit_that_fails_to_tell_shows_so_and_not_nan(results):
    fit: Estimate = results["fit"]
    nothing = dict.fromkeys(fit.names, (float("nan"), float("nan")))
    shown = Estimate(**{name: getattr(fit, name) for name in fit.__dataclass_fields__} | {"ci95": nothing})
    assert "nan" not in repr(shown) and isinstance(shown.plot(), Figure)


def test_a_diagnosis_saves_what_the_command_writes_and_its_model_can_be_trained(results, tmp_path):
    folder = results["diagnosis"].save(tmp_path / "diagnosis")
    assert {"result.json", "report.html", "augmented.yaml", "figures", "recording.parquet"} <= {
        item.name for item in folder.iterdir()
    }
    assert fp.read(folder / "recording.parquet", fp.system("drive")).names == ["1", "2"]


def test_a_run_is_trained_on_the_recording_that_it_was_given(results, log):
    run = results["run"]
    assert run.result["data"]["samples"] == {"train": 200, "validation": 0, "held_out": 200}
    assert run.result["config"]["system"]["parameters"]["M"] == 2.0
    assert run.parameters.keys() >= {"mu_c", "sigma_0"} and "mu_c" in repr(run)
    assert results["evaluation"].report.is_file()


def test_a_training_that_is_refused_leaves_the_recording_of_the_run_in_its_folder(results, model, log):
    folder = results["run"].folder
    before = (folder / "recording.parquet").read_bytes()
    other = fp.simulate(model, VALUES, TRIALS, rate_hz=100, noise=0.01)
    with pytest.raises(fp.UserError, match="holds a finished run"):
        fp.train(fp.mechanism(model.system), other, model="pe1", folder=folder)
    assert (folder / "recording.parquet").read_bytes() == before


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda m, log: fp.fit(m, log, fre=["mu_c"]), "fit is fre; .*did you mean 'free'"),
        (lambda m, log: fp.fit(m, log, method="magic"), "estimator is 'magic'"),
        (lambda m, log: fp.diagnose(m, log, efects=["drag"]), "diagnose is efects; .*did you mean 'effects'"),
        (lambda m, log: fp.diagnose(m, log, effects=["drga"]), "did you mean 'drag'"),
        (lambda m, log: fp.diagnose(m, log, held_out=["9"]), "no such trial: data.held_out is 9"),
        (lambda m, log: fp.train(m, log, modle="pe1"), "did you mean 'model'"),
        (lambda m, log: fp.train(fp.mechanism("drive", "lugre", ["drag"]), log), "learns the law, not effects"),
        (lambda m, log: fp.train(m, log, model="pe9"), "model is pe9; allowed: bb1, bb2, pe1, pe2"),
        (lambda m, log: fp.evaluate("nowhere"), "no such folder: run is nowhere"),
        (lambda m, log: fp.read("nothing.csv", m.system), "unknown file"),
        (lambda m, log: fp.read("nothing.csv", m.system, unit="mm"), "read is unit; .*did you mean 'units'"),
        (lambda m, log: fp.system("drvie"), "did you mean 'drive'"),
        (lambda m, log: fp.mechanism(3), "not a System: system is 3"),
        (lambda m, log: fp.check(log, 3), "not a System: check is 3"),
        (lambda m, log: fp.simulate(m, {"mu_c": 3.0}, TRIALS), "sigma_2"),
        (lambda m, log: log.save("log.xlsx"), "unknown file format"),
    ],
)
def test_a_mistake_is_told_in_one_line(model, log, workdir, call, said):
    with pytest.raises(fp.UserError, match=said) as caught:
        call(model, log)
    assert "\n" not in str(caught.value) and not list(workdir.iterdir())


def test_a_check_tells_a_constant_signal(model, log):
    still = [trial.with_signals(v=np.zeros(len(trial))) for trial in log.trials]
    found = fp.check(type(log)(tuple(still), log.units, "still"), model.system)
    assert not found.ok and "wrong: v is 0 in every row" in found.findings[0] and "leave the column out" in repr(found)


def test_no_function_learns_from_a_log_that_contradicts_itself(model, log, workdir, caplog):
    wrong = type(log)(tuple(t.with_signals(a=-t.signals["a"]) for t in log.trials), log.units, "log")
    for learn in (
        lambda: fp.fit(model, wrong),
        lambda: fp.diagnose(model, wrong),
        lambda: fp.online(model, VALUES, wrong),
        lambda: fp.train(fp.mechanism(model.system), wrong, model="bb1"),
    ):
        with pytest.raises(fp.UserError, match="no answer from this recording has a sense: a has its sign turned"):
            learn()
    assert "wrong: a has its sign turned" in repr(fp.check(wrong, model.system))
    fp.online(model, VALUES, wrong, check="warn")
    assert "wrong: a has its sign turned" in caplog.text
    holes = type(log)(tuple(t.with_signals(a=np.full(len(t), np.nan)) for t in log.trials), log.units, "log")
    with pytest.raises(fp.UserError, match="missing value: log, column 'a', data row 1"):
        fp.fit(model, holes)


def test_where_nothing_slips_there_is_no_verdict_whatever_check_is_asked_for(model, log, workdir):
    rng = np.random.default_rng(0)
    noise = {"x": 1e-4, "v": 1e-3, "a": 1e-2}
    still = [t.with_signals(**{n: s * rng.standard_normal(len(t)) for n, s in noise.items()}) for t in log.trials]
    still = type(log)(tuple(still), log.units, "still")
    found = fp.diagnose(model, still, check="warn", effects=["constant_force"])
    assert found.verdict == "no verdict" and "nothing slips here" in found.doubts[0]
    assert found.declared.outcome == "no excitation" and "nothing slips here" in found.declared.advice[0]


def test_a_friction_coefficient_that_stands_for_the_friction_says_in_which_unit():
    rows = {name: row["unit"] for name, row in fp.mechanism("joint", "coulomb_viscous").tables()[0].to_dict().items()}
    assert rows["mu_c"] == "N m at a preload of 1" and rows["sigma_2"] == "N m s/rad"
    assert fp.mechanism("pob", "coulomb_viscous").read_in["mu_c"] == "1"
    assert fp.mechanism(fp.system("joint", preload=2.0), "coulomb_viscous").read_in["mu_c"] == "1"
