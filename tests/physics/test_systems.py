"""One suite for every system in SYSTEMS: equations against independent derivations, balances, units, bad values."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.data.units import registry
from frictionpinn.errors import UserError
from frictionpinn.physics import LAWS, SYSTEMS, Coordinate, System
from frictionpinn.physics.mechanism import Mechanism

kinds = list(SYSTEMS.values())
every_kind = pytest.mark.parametrize("kind", kinds, ids=SYSTEMS.keys())
every_form = pytest.mark.parametrize(
    ("kind", "form", "driven"),
    [(kind, form, driven) for kind in kinds for form in kind.equations_allowed for driven in sorted({kind.driven, ()})],
    ids=lambda item: (" ".join(item) or "none driven") if isinstance(item, tuple) else getattr(item, "name", item),
)
some = settings(max_examples=25, deadline=None, derandomize=True)
seeds = st.integers(0, 2**32 - 1)


@functools.cache
def built(kind: type[System], form: str = "lagrange", driven: tuple[str, ...] | None = None) -> System:
    return kind(equations=form, driven=driven)


@functools.cache
def compiled(system: System, expr: sp.Expr) -> Callable:
    """A function of a state: a value for each symbol by name."""
    symbols = sorted(expr.free_symbols, key=str)
    function = sp.lambdify(symbols, expr, modules="math")
    return lambda state: function(*(state[symbol.name] for symbol in symbols))


@functools.cache
def residuals(system: System) -> dict[str, sp.Expr]:
    """The equation of every moving coordinate: kept, since deriving one takes a good part of a second."""
    return {c.name: system.residual(c) for c in system.moving}


@functools.cache
def lagrangian(system: System) -> dict[str, sp.Expr]:
    return {c.name: system.euler_lagrange(c) for c in system.coordinates}


def value(system: System, expr: sp.Expr, state: dict[str, float]) -> float:
    return compiled(system, sp.sympify(expr))(state)


def random_state(system: System, seed: int) -> dict[str, float]:
    """A random motion of the moving coordinates, random inputs, and parameters around the system's own."""
    rng = np.random.default_rng(seed)
    names = [s.name for c in system.moving for s in c.symbols] + [item.symbol.name for item in system.inputs]
    state = {name: rng.uniform(-3, 3) for name in names}
    state |= {s.name: 0.0 for c in system.coordinates if c.constrained for s in c.symbols}
    return state | {name: own * rng.uniform(0.5, 1.5) for name, own in system.values.items()}


def balance(system: System, coordinate: Coordinate, state: dict[str, float], friction: float) -> float:
    """E + J F_f of a coordinate."""
    jacobian = value(system, system.jacobian[coordinate.name], state)
    return value(system, residuals(system)[coordinate.name], state) + jacobian * friction


def forced(system: System, state: dict[str, float], friction: float) -> dict[str, float]:
    """The state with the accelerations of the free coordinates (or the measured force) that this friction gives."""
    names = [system.inputs[0].symbol.name] if system.massless else [c.symbols[2].name for c in system.free]

    def rows(unknowns: np.ndarray) -> np.ndarray:
        trial = state | dict(zip(names, unknowns, strict=True))
        return np.array([balance(system, c, trial, friction) for c in system.free])

    zero, eye = np.zeros(len(names)), np.eye(len(names))
    slopes = np.column_stack([rows(column) - rows(zero) for column in eye])
    return state | dict(zip(names, np.linalg.solve(slopes, -rows(zero)), strict=True))


def moved(system: System, state: dict[str, float], h: float) -> dict[str, float]:
    """The state h seconds later, at constant acceleration."""
    later = dict(state)
    for q, qd, qdd in (c.symbols for c in system.coordinates):
        later[q.name] += h * state[qd.name] + h * h * state[qdd.name] / 2
        later[qd.name] += h * state[qdd.name]
    return later


def rate_of(system: System, expr: sp.Expr, state: dict[str, float], h: float = 1e-5) -> float:
    """Time derivative along the motion, by central differences of fourth order."""
    at = [value(system, expr, moved(system, state, k * h)) for k in (-2, -1, 1, 2)]
    return (at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * h)


near = functools.partial(pytest.approx, rel=1e-6, abs=1e-6)


# ---- the equations


def pob_rows(s: dict[str, float]) -> tuple[dict[str, float], float]:
    sine, cosine, lever = math.sin(s["theta"]), math.cos(s["theta"]), s["m_L"] * s["d"]
    omega, alpha, a = s["theta_dot"], s["theta_ddot"], s["x_ddot"]
    x = (s["m_b"] + s["m_L"]) * a + lever * (alpha * cosine - omega**2 * sine)
    theta = (s["J_L"] + lever * s["d"]) * alpha + lever * a * cosine - lever * s["g"] * sine - s["tau_in"]
    return {"x": x, "theta": theta}, (s["m_b"] + s["m_L"]) * s["g"] - lever * (alpha * sine + omega**2 * cosine)


def sdob_rows(s: dict[str, float]) -> tuple[dict[str, float], float]:
    spring = s["k"] * (s["rest"] - s["y"]) - s["c"] * s["y_dot"]
    x = (s["m_1"] + s["m_2"]) * s["x_ddot"] - s["force_in"]
    return {"x": x, "y": s["m_2"] * (s["y_ddot"] + s["g"]) - spring}, s["m_1"] * s["g"] + spring


def drive_rows(s: dict[str, float]) -> tuple[dict[str, float], float]:
    return {"x": s["M"] * s["x_ddot"] - s["force_in"]}, s["preload"]


def pendulum_rows(s: dict[str, float]) -> tuple[dict[str, float], float]:
    inertia, weight = s["J"] + s["m"] * s["l"] ** 2, s["m"] * s["g"] * s["l"]
    return {"theta": inertia * s["theta_ddot"] - weight * math.sin(s["theta"]) - s["tau_in"]}, s["preload"]


def damper_rows(s: dict[str, float]) -> tuple[dict[str, float], float]:
    return {"x": -s["force_in"]}, s["preload"]


BY_HAND = {"pob": pob_rows, "sdob": sdob_rows, "drive": drive_rows, "pendulum": pendulum_rows, "damper": damper_rows}


@pytest.mark.parametrize("name", BY_HAND)
@some
@given(seed=seeds)
def test_the_equations_and_the_normal_force_are_those_derived_by_hand(name, seed):
    system = built(SYSTEMS[name])
    state = random_state(system, seed)
    rows, normal = BY_HAND[name](state)
    assert {name: value(system, row, state) for name, row in residuals(system).items()} == near(rows, rel=1e-9)
    assert value(system, system.N, state) == near(normal, rel=1e-9)


@every_kind
@some
@given(seed=seeds)
def test_the_equations_follow_from_the_energies_by_finite_differences(kind, seed):
    system, h = built(kind), 1e-4
    state, s, p = random_state(system, seed), system.s, system.p
    kinetic, potential, dissipation = system.kinetic(s, p), system.potential(s, p), system.dissipation(s, p)

    def slope(expr: sp.Expr, name: str, at: dict[str, float]) -> float:
        up, down = at | {name: at[name] + h}, at | {name: at[name] - h}
        return (value(system, expr, up) - value(system, expr, down)) / (2 * h)

    for coordinate in system.coordinates:
        q, qd, _ = (symbol.name for symbol in coordinate.symbols)
        momentum = [slope(kinetic, qd, moved(system, state, k * h)) for k in (-1, 1)]
        expected = (momentum[1] - momentum[0]) / (2 * h) - slope(kinetic, q, state) + slope(potential, q, state)
        expected += slope(dissipation, qd, state) - value(system, system.applied(s, p).get(coordinate.name, 0), state)
        assert value(system, lagrangian(system)[coordinate.name], state) == near(expected, rel=1e-4, abs=1e-4)


@some
@given(seed=seeds)
def test_the_published_pendulum_on_a_box_differs_in_inertia_velocity_term_and_normal_force(seed):
    derived, published = built(SYSTEMS["pob"]), built(SYSTEMS["pob"], "published")
    s = random_state(derived, seed)

    def difference(name: str) -> float:
        return value(published, residuals(published)[name], s) - value(derived, residuals(derived)[name], s)

    lever, sine, alpha = s["m_L"] * s["d"], math.sin(s["theta"]), s["theta_ddot"]
    assert difference("x") == 0
    assert difference("theta") == near(lever * (1 - s["d"]) * alpha - lever * s["x_dot"] * s["theta_dot"] * sine)
    assert value(published, published.N, s) - value(derived, derived.N, s) == near(lever * alpha * sine)


# ---- friction in the equations


@every_form
@some
@given(seed=seeds, friction=st.floats(-20, 20))
def test_the_implied_friction_inverts_the_equations_of_motion(kind, form, driven, seed, friction):
    system = built(kind, form, driven)
    state = forced(system, random_state(system, seed), friction)
    assert value(system, system.friction_implied, state) == near(friction)


@every_form
@some
@given(seed=seeds)
def test_the_frictionless_acceleration_is_that_of_no_friction(kind, form, driven, seed):
    system = built(kind, form, driven)
    state = forced(system, random_state(system, seed), 0.0)
    assert value(system, system.a_frictionless, state) == near(value(system, system.a_slip, state))


@every_kind
@some
@given(seed=seeds)
def test_the_slip_acceleration_is_the_rate_of_the_slip_velocity(kind, seed):
    system = built(kind)
    state = random_state(system, seed)
    assert value(system, system.a_slip, state) == near(rate_of(system, system.v_slip, state), abs=1e-5)


@pytest.mark.parametrize(
    ("name", "law"), [*((name, "lugre") for name in SYSTEMS), *(("drive", law) for law in LAWS if law != "lugre")]
)
@some
@given(seed=seeds)
def test_a_mechanism_s_residuals_hold_the_law_s_force(name, law, seed):
    mechanism = Mechanism(built(SYSTEMS[name]), LAWS[law]())
    rng, system = np.random.default_rng(seed), mechanism.system
    state = random_state(system, seed) | {"z": rng.uniform(-1, 1), "zdot": rng.uniform(-1, 1)}
    state |= {par.name: rng.uniform(0.5, 1.5) for par in mechanism.law.parameters}
    friction = value(system, mechanism.friction, state)
    rows = [balance(system, c, state, friction) for c in mechanism.free]
    if mechanism.law.memory:
        rows.append(state["zdot"] - value(system, mechanism.bristle_rate, state))
    assert [value(system, row, state) for row in mechanism.residuals] == near(rows, rel=1e-9)


# ---- balances


@pytest.mark.parametrize("kind", [kind for kind in kinds if not kind.massless], ids=lambda kind: kind.name)
@some
@given(seed=seeds, friction=st.floats(-20, 20))
def test_energy_changes_by_what_friction_dampers_and_inputs_do(kind, seed, friction):
    system = built(kind, "lagrange", ())
    state, s, p = forced(system, random_state(system, seed), friction), system.s, system.p
    applied = system.applied(s, p)
    power = sum(value(system, sp.sympify(applied.get(c.name, 0)) * c.symbols[1], state) for c in system.moving)
    power -= friction * value(system, system.v_slip, state) + 2 * value(system, system.dissipation(s, p), state)
    energy = system.kinetic(s, p) + system.potential(s, p)
    assert rate_of(system, energy, state) == near(power, rel=1e-5, abs=1e-4)


def test_the_published_pendulum_on_a_box_breaks_the_energy_balance():
    system = built(SYSTEMS["pob"], "published", ())
    state, s, p = forced(system, random_state(system, 1) | {"tau_in": 0.0}, 0.0), system.s, system.p
    assert abs(rate_of(system, system.kinetic(s, p) + system.potential(s, p), state)) > 0.1


@some
@given(seed=seeds, friction=st.floats(-20, 20))
def test_friction_alone_changes_the_horizontal_momentum_of_the_pendulum_on_a_box(seed, friction):
    system = built(SYSTEMS["pob"])
    s, p = system.s, system.p
    momentum = p.m_b * s.x_dot + p.m_L * (s.x_dot + p.d * sp.cos(s.theta) * s.theta_dot)
    state = forced(system, random_state(system, seed), friction)
    assert rate_of(system, momentum, state) == near(-friction, rel=1e-5, abs=1e-4)


@pytest.mark.parametrize(("name", "masses"), [("pob", ("m_b", "m_L")), ("sdob", ("m_1", "m_2"))])
@some
@given(seed=seeds)
def test_the_ground_carries_the_whole_weight_at_rest(name, masses, seed):
    system = built(SYSTEMS[name])
    state = random_state(system, seed)
    state |= {symbol.name: 0.0 for c in system.moving for symbol in c.symbols[1:]}
    if name == "sdob":
        state["y"] = state["rest"] - state["m_2"] * state["g"] / state["k"]
    assert value(system, system.N, state) == near(sum(state[m] for m in masses) * state["g"], rel=1e-9)


@pytest.mark.parametrize("name", ["drive", "pendulum", "damper"])
def test_the_preload_is_the_normal_force_where_no_weight_rests_on_the_contact(name):
    system = built(SYSTEMS[name])
    assert system.p.preload == system.N


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

    assert has_unit(system.v_slip, f"{system.slip_unit}/s")
    assert has_unit(system.a_slip, f"{system.slip_unit}/s^2")
    assert has_unit(system.a_frictionless, f"{system.slip_unit}/s^2")
    assert has_unit(system.N, system.force_unit)
    assert has_unit(system.friction_implied, system.force_unit)
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
            assert one_line(error, f"system.parameters.{par.name} is {bad} {par.unit}", "allowed:", "not 0")


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
