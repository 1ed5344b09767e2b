"""Figures: axes with units, the model and the baseline beside the reference, errors below."""

from __future__ import annotations

import io

import numpy as np
import pytest

from frictionpinn.data.contact import ContactTrial
from frictionpinn.evaluate.draw import errors_figure, headline
from frictionpinn.evaluate.estimators import error_against_time, table
from frictionpinn.evaluate.figures import force_over_time, force_over_velocity


@pytest.fixture(params=["true", "implied"])
def trial(request) -> ContactTrial:
    t = np.linspace(0, 1, 50)
    signals = {"v_slip": np.sin(t), "friction_force": np.sign(np.sin(7 * t)) * 3}
    truth = {"friction_force": signals["friction_force"]} if request.param == "true" else {}
    return ContactTrial("1", t, signals, signals, {}, truth)


def texts(axes) -> str:
    return " ".join([axes.get_xlabel(), axes.get_ylabel(), axes.get_title()])


def drawn(figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()


def test_force_over_time_shows_both_models_the_reference_and_the_errors(trial):
    force = trial.offline["friction_force"]
    figure = force_over_time(trial, {"model": force + 0.5, "fit": force - 1}, "N m", "a title")
    top, bottom = figure.axes
    assert "friction force (N m)" in texts(top) and "a title" in texts(top)
    assert "time (s)" in texts(bottom) and "error (N m)" in texts(bottom)
    labels = [text.get_text() for text in top.get_legend().get_texts()]
    assert labels[1:] == ["model", "fit"] and "friction force" in labels[0]
    np.testing.assert_allclose(bottom.lines[0].get_ydata(), 0.5)
    low, high = top.get_ylim()
    assert low < force.min() and high > force.max()
    assert drawn(figure).startswith(b"\x89PNG")


def test_force_over_velocity_has_every_sample_of_every_trial(trial):
    force = trial.offline["friction_force"]
    figure = force_over_velocity([trial, trial], {"model": [force, force]}, ("N", "m/s"), "a title")
    (axes,) = figure.axes
    assert "slip velocity (m/s)" in texts(axes) and "friction force (N)" in texts(axes)
    assert [len(line.get_xdata()) for line in axes.lines] == [100, 100]
    assert drawn(figure).startswith(b"\x89PNG")


def test_a_force_that_never_changes_can_be_drawn(trial):
    flat = ContactTrial("1", trial.t, {**trial.offline, "friction_force": np.zeros(50)}, {}, {}, {})
    assert drawn(force_over_time(flat, {"model": np.zeros(50)}, "N", "flat"))


@pytest.mark.parametrize("panels", [1, 2])
def test_titles_of_the_figure_of_estimators_fit_into_it(panels):
    result = {"methods": {"maximum_likelihood": [{"trace": [(0.5, 2.0), (1.5, 0.3)]}], "genetic": [{"trace": []}]}}
    figure = error_against_time({f"bounds {k}": result | {"units": {"force_mse": "N^2"}} for k in range(panels)})
    drawn(figure)
    box, canvas = figure._suptitle.get_window_extent(), figure.bbox
    assert box.x0 >= canvas.x0 and box.x1 <= canvas.x1
    legend = figure.legends[0].get_window_extent()
    assert legend.x0 >= canvas.x0 and legend.x1 <= canvas.x1


def test_the_figure_of_estimators_shows_short_times_as_they_are_and_a_percent_as_a_percent():
    runs = {"least_squares": [{"trace": [(0.0, 0.0204), (0.02, 0.0203)]}], "genetic": [{"trace": [(0.5, 0.0202)]}]}
    figure = error_against_time({"bounds: data": {"methods": runs, "units": {"force_mse": "N^2"}}})
    (axes,) = figure.axes
    assert axes.lines[0].get_xdata().tolist() == [0.02, 0.02] and axes.lines[2].get_xdata().tolist() == [0.5]
    low, high = axes.get_ylim()
    assert high / low >= 10 * (1 - 1e-9) and low < 0.0202 and high > 0.0204


def test_the_table_of_estimators_tells_how_large_the_force_itself_is():
    run = {"values": {"mu_c": 0.3}, "seconds": 1.0, "processor_seconds": 1.0, "simulations": 5, "force_mse": 0.02}
    result = {"methods": {"maximum_likelihood": [run | {"force_mean_square": 4.1}]}, "seeds": [0], "truth": None}
    assert "(mean square of the force itself: 4.1 N²)" in table(result | {"units": {"mu_c": "1", "force_mse": "N^2"}})


def test_a_simulation_that_failed_is_marked_and_told_in_the_title():
    def entry(simulated):
        return {"label": "a model", "online": {"force_mse": {"value": 0.1, "unit": "N^2"}}, "in_simulation": simulated}

    fine = entry({"force_mse": {"value": 0.2, "unit": "N^2"}})
    errors = {"1": {"model": entry({"failed": "contact lost"}), "coulomb_viscous": fine},
              "2": {"model": fine, "coulomb_viscous": fine}}  # fmt: skip
    result = {"errors": errors, "system": "pob", "trained_on": "pob", "model": "pe2"}
    assert headline(result).endswith("; in simulation it failed on 1 of 2")
    first, second, *_ = errors_figure(result).axes
    assert "failed" in [text.get_text() for text in first.texts]
    assert "failed" not in [text.get_text() for text in second.texts]


def test_the_interval_of_an_ensemble_is_seen_whole(trial):
    force = trial.offline["friction_force"]
    figure = force_over_time(trial, {"PE1": force, "fit": force}, "N", "title", (force - 9.0, force + 9.0))
    low, high = figure.axes[0].get_ylim()
    assert low < -12.0 and high > 12.0
