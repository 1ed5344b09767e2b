"""Every system in SYSTEMS: names, units and dimensions, and what a user may get wrong."""

from __future__ import annotations

import math

import pytest
import sympy as sp
from system_cases import (
    built,
    every_kind,
    residuals,
)

import frictionpinn as fp
from frictionpinn.data.units import registry
from frictionpinn.errors import UserError
from frictionpinn.physics import SYSTEMS
from frictionpinn.physics.base import Parameter
from frictionpinn.physics.system import Coordinate, Input, System
from frictionpinn.show import readable_unit
from frictionpinn.workflow.build import build_system
from frictionpinn.workflow.options import composed

# ---- units and names


@every_kind
def test_a_system_is_named_documented_and_its_units_parse(kind):
    system, ureg = built(kind), registry()
    assert SYSTEMS[kind.name] is kind and kind.title
    assert "Units:" in kind.__doc__ and "Source:" in kind.__doc__
    for unit in (*system.signal_units.values(), *(par.unit for par in system.parameters)):
        ureg.Unit("dimensionless" if unit == "1" else unit)
    signals = [name for c in system.moving for name in c.signals] + [item.name for item in system.inputs]
    assert len(set(signals)) == len(signals) and set(system.signal_units) == {"t", *signals}
    for par in system.parameters:
        assert par.value is not None and par.low <= par.value <= par.high and par.text


@every_kind
def test_every_equation_has_one_dimension(kind):
    system, ureg = built(kind), registry()
    units = {par.symbol: par.unit for par in system.parameters} | {i.symbol: i.unit for i in system.inputs}
    for c in system.moving:
        units.update(zip(c.symbols, c.units, strict=True))

    def has_unit(expr: sp.Expr, unit: str) -> bool:
        symbols = sorted(expr.free_symbols, key=str)
        terms = sp.Add.make_args(sp.expand(expr))
        quantities = [ureg.Quantity(0.7, units[symbol]) for symbol in symbols]
        results = [sp.lambdify(symbols, term, "numpy")(*quantities) for term in terms]
        return all(ureg.Quantity(result).is_compatible_with(unit) for result in results)

    for at in system.each:
        assert has_unit(at.v_slip, f"{at.slip_unit}/s")
        assert has_unit(at.a_slip, f"{at.slip_unit}/s^2")
        assert has_unit(at.a_frictionless, f"{at.slip_unit}/s^2")
        assert has_unit(at.N, at.force_unit)
        assert has_unit(at.friction_implied, at.force_unit)
    for c in system.moving:
        assert has_unit(residuals(system)[c.name], "N*m" if c.units[0] == "rad" else "N")


# ---- what a user may get wrong


def one_line(error: pytest.ExceptionInfo, *parts: str) -> bool:
    message = str(error.value)
    return "\n" not in message and all(part in message for part in parts)


@every_kind
@pytest.mark.parametrize("bad", [-0.5, 0.0, math.nan, "heavy", None], ids=str)
def test_an_impossible_mass_is_refused_with_its_place_and_its_range(kind, bad):
    for par in kind.parameters:
        if "kg" in par.unit:
            with pytest.raises(UserError) as error:
                kind(**{par.name: bad})
            assert one_line(
                error, f"system.parameters.{par.name} is {bad} {readable_unit(par.unit)}", "allowed:", "not 0"
            )


@every_kind
def test_a_mistyped_parameter_is_refused_and_the_nearest_name_is_given(kind):
    for par in kind.parameters:
        wrong = par.name + "x" if len(par.name) > 1 else par.name * 2
        with pytest.raises(UserError) as error:
            kind(**{wrong: 1.0})
        assert one_line(error, f"system.parameters.{wrong}", f"did you mean '{par.name}'?")


@every_kind
def test_unknown_equations_are_refused_and_the_nearest_form_is_given(kind):
    with pytest.raises(UserError) as error:
        kind(equations="lagrang")
    assert one_line(error, "system.equations is 'lagrang'", "did you mean 'lagrange'?")


def test_a_given_value_replaces_the_default_of_this_system_alone():
    heavy, usual = SYSTEMS["pob"](m_b=2), SYSTEMS["pob"]()
    assert heavy.values["m_b"] == 2.0 and usual.values["m_b"] == 0.5


def test_coordinates_that_are_taken_as_measured_are_an_option_of_a_system_and_of_its_configuration():
    made = fp.system("double_pendulum", driven=["theta_1"])
    assert made.driven == ("theta_1",) and [c.name for c in made.free] == ["theta_2"]
    asked = ["system=double_pendulum", "system.driven=[theta_1]", "data.path=recording"]
    assert build_system(composed("diagnose", asked)["system"]).driven == ("theta_1",)
    assert build_system(composed("diagnose", ["system=pob", "data.path=recording"])["system"]).driven == ("theta",)
    with pytest.raises(UserError, match=r"system\.driven.*theta_1, theta_2"):
        fp.system("double_pendulum", driven=["theta_3"])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"applied": lambda self, s, p: {"y": s.force}}, "force on no coordinate .*: applied is 'y'; allowed: x"),
        ({"slip_velocity": lambda self, s, p: s.x}, r"no velocity in the slip velocity .* is x; .*s\.x_dot"),
        ({"coordinates": (Coordinate("x", ("x", "v", "v")),)}, "two signals of one name .* is 'v'"),
        ({"inputs": (Input("x", "N", ""), Input("force", "N", ""))}, "two signals of one name .* is 'x'"),
        ({"kinetic": lambda self, s, p: p.m * s.x_dot**2}, r"unknown name in kinetic .*: p\.m; .*did you mean 'p\.M'"),
        ({"kinetic": lambda self, s, p: p.M * s.xdot**2}, r"unknown name in kinetic .*: s\.xdot; .*'s\.x_dot'"),
        ({"kinetic": lambda self, s, p: p.M["x"] * s.x_dot**2}, "kinetic of system drive fails: received TypeError"),
        ({"kinetic": lambda self, s, p: sp.Symbol("M") * s.x_dot**2}, r"unknown symbol .* is M; .*p\.M"),
        ({"kinetic": lambda self, s, p: -p.M * s.x_dot**2}, "negative kinetic energy .*least inertia is -2"),
        ({"kinetic": lambda self, s, p: sp.Integer(0)}, r"coordinate x .* without kinetic energy.*s\.x_dot"),
        ({"applied": lambda self, s, p: s.force}, "no table of forces .*: applied is force_in; .*return {'x': ...}"),
        ({"applied": lambda self, s, p: {}}, "acts on nothing: inputs is 'force'; .*s.force"),
        ({"slip_velocity": System.slip_velocity}, "system drive without slip_velocity: Mine; define slip_velocity"),
        (
            {"slip_velocity": lambda self, s, p: {"hinge": s.x_dot}},
            "slip_velocity .* not of its contacts.* is hinge; .*one",
        ),
        ({"normal_force": System.normal_force}, "system drive without a normal force: Mine"),
        ({"coordinates": (Coordinate("x", ("x", "v")),)}, r"without three signals: signals is \('x', 'v'\)"),
        ({"inputs": Input("force", "N", "")}, r"not a tuple of Input .*allowed: \(Input\(...\),\)"),
        ({"parameters": (*SYSTEMS["drive"].parameters, Parameter("mu_c", "1", "", 0.1))}, "like one of a friction law"),
    ],
    ids=lambda item: "-".join(item) if isinstance(item, dict) else "",
)
def test_a_system_that_would_leave_out_what_it_says_is_refused(change, said):
    with pytest.raises(UserError, match=said) as error:
        type("Mine", (SYSTEMS["drive"],), change)()
    assert one_line(error)


def test_units_read_as_powers_however_they_are_written():
    assert readable_unit("N*s**3/m**2") == readable_unit("N*s^3/m^2") == "N s^3/m²"
