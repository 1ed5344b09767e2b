"""Conversion of columns to SI."""

import subprocess
import sys

import numpy as np
import pytest

from frictionpinn.data.units import to_si
from frictionpinn.errors import UserError


@pytest.mark.parametrize(
    ("unit", "signal_unit", "factor"),
    [
        ("mm/s", "m/s", 1e-3),
        ("in", "m", 0.0254),
        ("deg", "rad", np.pi / 180),
        ("°", "rad", np.pi / 180),
        ("deg/s", "rad/s", np.pi / 180),
        ("rpm", "rad/s", 2 * np.pi / 60),
        ("rev/s", "rad/s", 2 * np.pi),
        ("m/s2", "m/s^2", 1.0),
        ("Nm", "N*m", 1.0),
        ("kip", "N", 4448.2216152605),
        ("ms", "s", 1e-3),
        ("", "", 1.0),
        ("percent", "", 0.01),
        ("SI", "N*m", 1.0),
    ],
)
def test_a_column_is_converted_to_the_unit_of_its_signal(unit, signal_unit, factor):
    values = np.array([[0.0, 1.0], [-2.0, 3.5]])
    np.testing.assert_allclose(to_si(values, unit, signal_unit, "units.x"), factor * values, rtol=1e-12)


def test_a_pound_is_a_force_where_the_signal_is_a_force_and_a_mass_elsewhere():
    one = np.ones(1)
    assert to_si(one, "lb", "N", "units.force")[0] == pytest.approx(4.4482216152605)
    assert to_si(one, "in*lb", "N*m", "units.torque")[0] == pytest.approx(4.4482216152605 * 0.0254)
    assert to_si(one, "lb", "kg", "units.mass")[0] == pytest.approx(0.45359237)


def test_g_is_standard_gravity_where_the_signal_is_an_acceleration_and_gram_elsewhere():
    assert to_si(np.ones(1), "g", "m/s^2", "units.a")[0] == pytest.approx(9.80665)
    assert to_si(np.ones(1), "g", "kg", "units.m")[0] == pytest.approx(1e-3)


@pytest.mark.parametrize(
    "unit", ["mm/sx", "((", "m/", "in^^2", "", "1/0", "🙂", "2*mm", "x" * 500, "m\nm", "__import__"]
)
def test_text_that_is_no_unit_of_the_signal_is_a_one_line_user_error(unit):
    with pytest.raises(UserError) as caught:
        to_si(np.ones(2), unit, "m/s", "units.v")
    assert "units.v" in str(caught.value) and "\n" not in str(caught.value)


def test_an_unknown_unit_suggests_the_nearest():
    with pytest.raises(UserError, match=r"unknown unit: units\.v is 'mm/sx'; allowed: .*; did you mean 'mm/s'\?"):
        to_si(np.ones(2), "mm/sx", "m/s", "units.v")


def test_a_wrong_dimension_names_both():
    with pytest.raises(UserError, match=r"\[length\] where the signal needs \[mass\] \* \[length\].*'mm'.*kN"):
        to_si(np.ones(2), "mm", "N", "units.force")


@pytest.mark.parametrize(
    ("unit", "signal_unit"),
    [
        ("Hz", "rad/s"),
        ("1/min", "rad/s"),
        ("min^-1", "rad/s"),
        ("Hz/s", "rad/s^2"),
        ("count", "rad"),
        ("percent", "rad"),
    ],
)
def test_a_unit_without_an_angle_is_refused_for_a_signal_that_turns_because_a_factor_of_two_pi_hides_in_it(
    unit, signal_unit
):
    with pytest.raises(UserError, match="a unit without an angle"):
        to_si(np.ones(2), unit, signal_unit, "units.omega")


def test_a_stiffness_may_leave_out_the_angle_that_it_is_divided_by():
    assert to_si(np.ones(1), "N*m", "N*m/rad", "units.k")[0] == 1.0


def test_importing_the_readers_loads_neither_pint_nor_pandas_nor_scipy():
    code = (
        "import sys, frictionpinn.data.read, frictionpinn.data.sets;"
        "print([name for name in ('pint', 'pandas', 'scipy.signal', 'pooch', 'torch') if name in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_unit_of_an_axis_that_turns_names_the_system_that_has_one():
    for unit, signal_unit in (("rad", "m"), ("deg/s", "m/s"), ("N*m", "N")):
        with pytest.raises(UserError, match="in rad and N m, is system=joint"):
            to_si(np.ones(1), unit, signal_unit, "units.x")
    with pytest.raises(UserError) as told:
        to_si(np.ones(1), "kg", "m", "units.x")
    assert "joint" not in str(told.value)
