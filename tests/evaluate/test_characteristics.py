"""Friction characteristics: the steady force of laws, of models, and the figure of both."""

from __future__ import annotations

import numpy as np
import pytest
from test_in_simulation import model_of

from frictionpinn.data.contact import ContactTrial
from frictionpinn.evaluate.characteristics import Characteristics, characteristics, mobility, steady_force
from frictionpinn.evaluate.draw import characteristics_figure
from frictionpinn.physics import LAWS, SYSTEMS

TRUTH = {"sigma_0": 1e5, "sigma_1": 316.23, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3}


@pytest.fixture
def trial() -> ContactTrial:
    t = np.arange(50) / 100
    signals = {"v_slip": 0.5 * np.sin(9 * t), "normal_force": 10 + 5 * np.cos(9 * t), "a_frictionless": np.cos(t)}
    return ContactTrial("1", t, signals, signals, {})


@pytest.mark.filterwarnings("error")
def test_steady_lugre_friction_is_the_stribeck_curve_with_viscous_friction():
    v, N = np.array([-0.8, -1e-3, 1e-4, 0.5]), np.array([5.0, 10.0, 20.0, 12.0])
    curve = N * (0.3 + 0.3 * np.exp(-((v / 1e-3) ** 2)))
    force = steady_force(LAWS["lugre"](), TRUTH, v, N)
    np.testing.assert_allclose(force, curve * np.sign(v) + 0.4 * v, rtol=1e-6)


def test_a_law_without_memory_is_steady_as_it_is():
    law = LAWS["coulomb_viscous"]()
    force = steady_force(law, {"mu_c": 0.3, "sigma_2": 0.4, "v_t": 1e-3}, np.array([0.5]), np.array([10.0]))
    np.testing.assert_allclose(force, 3.2)


@pytest.mark.parametrize("name", ["bb2", "pe2"])
def test_the_grid_spans_the_training_data_and_the_force_is_odd(name, trial):
    found = characteristics(model_of(name), SYSTEMS["pob"](), [trial], LAWS["lugre"](), TRUTH, 21)
    assert found.model.shape == found.truth.shape == (len(found.N), len(found.v))
    assert found.v[-1] == pytest.approx(np.abs(trial.offline["v_slip"]).max()) and 0.0 not in found.v
    assert found.N[0] == pytest.approx(trial.offline["normal_force"].min())
    np.testing.assert_allclose(found.model, -found.model[:, ::-1], atol=1e-6)
    assert found.rms == pytest.approx(np.sqrt(np.mean((found.model - found.truth) ** 2)))


def test_mobility_is_one_over_the_mass_that_slides():
    assert mobility(SYSTEMS["pob"]()) == pytest.approx(1 / 1.5)
    assert mobility(SYSTEMS["damper"]()) == 0.0


@pytest.mark.parametrize("models", [["PE1"], ["PE1", "BB1"]])
def test_three_panels_with_units(models, trial):
    surface = characteristics(model_of("pe2"), SYSTEMS["pob"](), [trial], LAWS["lugre"](), TRUTH, 11)
    units = {"unit": "N", "v_slip": {"unit": "m/s"}, "normal_force": {"unit": "N"}}
    figure = characteristics_figure(dict.fromkeys(models, surface), units)
    panels = [axes for axes in figure.axes if axes.get_title()]  # colour bars have none
    assert len(panels) == 3 and all(axes.get_xlabel() == "slip velocity (m/s)" for axes in panels)
    assert panels[0].get_ylabel() == "normal force (N)"
    assert any("friction force (N)" in axes.get_xlabel() for axes in figure.axes)  # of a colour bar, below the panels


def test_over_a_normal_force_that_never_changed_they_are_curves_in_one_panel(trial):
    whole = characteristics(model_of("pe2"), SYSTEMS["pob"](), [trial], LAWS["lugre"](), TRUTH, 11)
    surface = Characteristics(whole.v, whole.N[:1], whole.model[:1], whole.truth[:1])
    units = {"unit": "N", "v_slip": {"unit": "m/s"}, "normal_force": {"unit": "N"}}
    figure = characteristics_figure({"PE2": surface}, units)
    (axis,) = figure.axes
    np.testing.assert_array_equal([line.get_ydata() for line in axis.lines[:2]], [whole.truth[0], whole.model[0]])
    assert axis.get_ylabel() == "friction force (N)" and f"normal force of {whole.N[0]:.3g} N" in figure.get_suptitle()
