"""One suite for every friction law in LAWS: symmetry, dissipation, memory, units, and the torch functions of it."""

from __future__ import annotations

import functools
import math
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.data.units import registry
from frictionpinn.numerics.torch_functions import LawFunctions, numpy_function
from frictionpinn.physics import CONTACT, LAWS, SYSTEMS, FrictionLaw

TYPICAL = {"mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3, "sigma_0": 1e5, "sigma_1": 316.23, "sigma_2": 0.4}
SPREAD = 1.4
SPEEDS = (0.0, 1e-30, 1e-12, 1e-6, 1e-3, 1.0, 1e3)

laws = [kind() for kind in LAWS.values()]
every_law = pytest.mark.parametrize("law", laws, ids=lambda law: law.name)
memory_law = pytest.mark.parametrize("law", [law for law in laws if law.memory], ids=lambda law: law.name)
static_law = pytest.mark.parametrize("law", [law for law in laws if not law.memory], ids=lambda law: law.name)
both_precisions = pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=["float32", "float64"])
few = settings(max_examples=10, deadline=None, derandomize=True)
many = settings(max_examples=60, deadline=None, derandomize=True)

speed = st.one_of(st.just(0.0), st.floats(-8.0, 1.0).map(lambda e: 10.0**e))
velocity = st.tuples(speed, st.sampled_from([-1.0, 1.0])).map(math.prod)
load = st.floats(-1.0, 4.0).map(lambda e: 10.0**e)
fraction = st.floats(-1.0, 1.0)


def typical(law: FrictionLaw) -> list[float]:
    """Values in the middle of the field, in the order of the law's parameters."""
    return [TYPICAL.get(par.name, 1.0 if par.value is None else par.value) for par in law.parameters]


@st.composite
def contacts(draw, law: FrictionLaw) -> SimpleNamespace:
    """Velocity, load, parameters around the typical ones, and for a law with memory a bristle within its capacity."""
    factors = draw(st.lists(st.floats(1 / SPREAD, SPREAD), min_size=len(law.parameters), max_size=len(law.parameters)))
    p = [value * factor for value, factor in zip(typical(law), factors, strict=True)]
    c = SimpleNamespace(p=p, v=draw(velocity), N=draw(load), z=0.0, zdot=0.0)
    if law.memory:
        c.z = draw(fraction) * functions(law.name).capacity(c.v, c.N, *p) / stiffness(law, p)
        c.zdot = draw(fraction) * abs(c.v)
    return c


@functools.cache
def functions(name: str) -> SimpleNamespace:
    """Plain functions of the law's equations; ``slope`` is the derivative of z' in z."""
    law, c = LAWS[name](), CONTACT
    p = [par.symbol for par in law.parameters]
    made = SimpleNamespace(force=numpy_function([c.v, c.N, c.z, c.zdot, *p], law.force(c, law.symbols)))
    if law.memory:
        rate = law.bristle_rate(c, law.symbols)
        made.capacity = numpy_function([c.v, c.N, *p], law.capacity(c, law.symbols))
        made.rate = sp.lambdify([c.v, c.N, c.z, *p], rate, modules="math", cse=True)
        made.slope = sp.lambdify([c.v, c.N, c.z, *p], sp.diff(rate, c.z), modules="math", cse=True)
    return made


def stiffness(law: FrictionLaw, p: list[float]) -> float:
    return p[[par.name for par in law.parameters].index("sigma_0")]


def implicit_step(law: FrictionLaw, c: SimpleNamespace, v: float, z: float, h: float) -> float:
    """The bristle after h seconds at constant v, by backward Euler, which keeps the bounds of the equation."""
    made, new = functions(law.name), z
    for _ in range(20):
        change = (new - z - h * made.rate(v, c.N, new, *c.p)) / (1 - h * made.slope(v, c.N, new, *c.p))
        new -= change
        if abs(change) <= 1e-15 * abs(new):
            break
    return new


def steady_bristle(law: FrictionLaw, c: SimpleNamespace) -> float:
    return math.copysign(functions(law.name).capacity(c.v, c.N, *c.p), c.v) / stiffness(law, c.p)


# ---- what any friction does


@every_law
@many
@given(data=st.data())
def test_friction_is_odd_in_the_motion(law, data):
    c, force = data.draw(contacts(law)), functions(law.name).force
    assert force(-c.v, c.N, -c.z, -c.zdot, *c.p) == -force(c.v, c.N, c.z, c.zdot, *c.p)


@every_law
@many
@given(data=st.data())
def test_steady_sliding_dissipates(law, data):
    c = data.draw(contacts(law))
    z = steady_bristle(law, c) if law.memory else 0.0
    power = functions(law.name).force(c.v, c.N, z, 0.0, *c.p) * c.v
    assert power > 0 if c.v else power == 0


@every_law
@few
@given(data=st.data(), amplitude=st.floats(-7.0, -1.0), frequency=st.floats(-1.0, 1.0))
def test_a_closed_cycle_dissipates(law, data, amplitude, frequency):
    """Midpoint steps: a bristle that is only a spring would give exactly nothing over a period."""
    c, force = data.draw(contacts(law)), functions(law.name).force
    c.z, n, reach, omega = 0.0, 800, 10.0**amplitude, 2 * math.pi * 10.0**frequency
    h, energy, work = 2 * math.pi / omega / n, 0.0, 0.0
    for i in range(2 * n):
        v = reach * omega * math.cos(omega * (i + 0.5) * h)
        zdot = 0.0
        if law.memory:
            middle = implicit_step(law, c, v, c.z, h / 2)
            zdot, c.z = (middle - c.z) / (h / 2), 2 * middle - c.z
        power = force(v, c.N, c.z - zdot * h / 2, zdot, *c.p) * v
        if i >= n:
            energy, work = energy + power * h, work + abs(power) * h
    assert energy >= -1e-9 * work


@every_law
@few
@given(data=st.data(), factor=st.floats(1.1, 2.0))
def test_a_contact_pressed_harder_resists_more(law, data, factor):
    c, resistance = data.draw(contacts(law)), []
    c.v = c.v or 1e-4
    for _ in range(2):
        z = steady_bristle(law, c) if law.memory else 0.0
        resistance.append(abs(functions(law.name).force(c.v, c.N, z, 0.0, *c.p)))
        c.N *= factor
    assert resistance[1] > resistance[0]


@static_law
def test_a_law_without_memory_ignores_the_bristle(law):
    assert not law.force(CONTACT, law.symbols).free_symbols & {CONTACT.z, CONTACT.zdot}


# ---- laws with memory


@memory_law
@many
@given(data=st.data())
def test_the_bristle_equation_is_odd_and_rests_when_the_contact_rests(law, data):
    c, rate = data.draw(contacts(law)), functions(law.name).rate
    assert rate(-c.v, c.N, -c.z, *c.p) == -rate(c.v, c.N, c.z, *c.p)
    assert rate(0.0, c.N, c.z, *c.p) == 0


@memory_law
@many
@given(data=st.data())
def test_the_bristle_settles_at_the_capacity_in_steady_sliding(law, data):
    c = data.draw(contacts(law))
    c.v = c.v or 1e-4
    steady = steady_bristle(law, c)
    assert functions(law.name).rate(c.v, c.N, steady, *c.p) == pytest.approx(0, abs=1e-9 * abs(c.v))
    z = c.z
    for _ in range(60):
        z = implicit_step(law, c, c.v, z, abs(steady / c.v))
    assert z == pytest.approx(steady, rel=1e-9)


@memory_law
@few
@given(data=st.data(), path=st.lists(velocity, min_size=5, max_size=60), h=st.floats(-6.0, -1.0))
def test_the_bristle_force_never_exceeds_the_largest_capacity(law, data, path, h):
    c, made = data.draw(contacts(law)), functions(law.name)
    largest = max(float(made.capacity(v, c.N, *c.p)) for v in (0.0, *path))
    z = 0.0
    for v in path:
        z = implicit_step(law, c, v, z, 10.0**h)
        assert abs(stiffness(law, c.p) * z) <= largest * (1 + 1e-9)


@memory_law
@many
@given(data=st.data())
def test_the_capacity_is_positive_and_even_in_velocity(law, data):
    c, capacity = data.draw(contacts(law)), functions(law.name).capacity
    assert capacity(c.v, c.N, *c.p) == capacity(-c.v, c.N, *c.p) > 0


# ---- parameters and units


@every_law
def test_a_law_is_named_documented_and_has_sound_parameters(law):
    assert LAWS[law.name] is type(law)
    assert "Units:" in law.__doc__ and "Source:" in law.__doc__
    assert len({par.name for par in law.parameters}) == len(law.parameters)
    for par in law.parameters:
        assert par.text and par.low < par.high
        assert par.value is None or par.low <= par.value <= par.high
    values = dict(zip((par.symbol for par in law.parameters), typical(law), strict=True))
    assert all(constraint.subs(values) >= 0 for constraint in law.constraints(law.symbols))


@every_law
@pytest.mark.parametrize("kind", SYSTEMS.values(), ids=SYSTEMS.keys())
def test_the_force_has_the_dimension_of_the_system_s_force(law, kind):
    ureg, c, (system, *_) = registry(), CONTACT, kind().each
    units = {par.name: system.unit(par) for par in law.parameters}
    p = [ureg.Quantity(value, units[par.name]) for par, value in zip(law.parameters, typical(law), strict=True)]
    slip, load_ = ureg.Quantity(1e-6, system.slip_unit), ureg.Quantity(10.0, system.force_unit)
    slip_rate = slip / ureg.second
    symbols = [par.symbol for par in law.parameters]
    force = sp.lambdify([c.v, c.N, c.z, c.zdot, *symbols], law.force(c, law.symbols), "numpy")
    assert force(slip_rate, load_, slip, slip_rate, *p).is_compatible_with(load_)
    if law.memory:
        capacity = sp.lambdify([c.v, c.N, *symbols], law.capacity(c, law.symbols), "numpy")
        rate = sp.lambdify([c.v, c.N, c.z, *symbols], law.bristle_rate(c, law.symbols), "numpy")
        assert capacity(slip_rate, load_, *p).is_compatible_with(load_)
        assert rate(slip_rate, load_, slip, *p).is_compatible_with(slip_rate)


@every_law
@few
@given(data=st.data(), units=st.sampled_from([("kN", "mm"), ("lbf", "inch"), ("mN", "km")]))
def test_a_change_of_units_leaves_the_law_as_it_is(law, data, units):
    c, made, ureg = data.draw(contacts(law)), functions(law.name), registry()

    def converted(value: float, unit: str) -> float:
        return ureg.Quantity(value, unit.format(F="N", L="m")).m_as(unit.format(F=units[0], L=units[1]))

    p = [converted(value, par.unit) for par, value in zip(law.parameters, c.p, strict=True)]
    v, z, zdot = converted(c.v, "{L}/s"), converted(c.z, "{L}"), converted(c.zdot, "{L}/s")
    load_, force = converted(c.N, "{F}"), made.force(c.v, c.N, c.z, c.zdot, *c.p)
    near = functools.partial(pytest.approx, rel=1e-9, abs=1e-12)
    assert made.force(v, load_, z, zdot, *p) == near(converted(force, "{F}"))
    if law.memory:
        assert made.rate(v, load_, z, *p) == near(converted(made.rate(c.v, c.N, c.z, *c.p), "{L}/s"))


# ---- torch


@both_precisions
@every_law
def test_a_torch_batch_equals_a_loop_and_the_plain_equations(law, dtype):
    rng, made, plain = np.random.default_rng(0), LawFunctions(law), functions(law.name)
    v = np.concatenate([[0.0], 10.0 ** rng.uniform(-6, 0, 24) * rng.choice([-1, 1], 24)])
    rows = [v, 10 ** rng.uniform(-1, 3, 25), rng.uniform(-1e-5, 1e-5, 25), v * rng.uniform(-1, 1, 25)]
    p = [value * rng.uniform(0.9, 1.1, 25) for value in typical(law)]
    columns = {"force": rows, "capacity": rows[:2], "rate": rows[:3]} if law.memory else {"force": rows}
    for name, arguments in columns.items():
        batch = [torch.tensor(column, dtype=dtype) for column in (*arguments, *p)]
        together = getattr(made, name)(*batch)
        alone = torch.stack([getattr(made, name)(*(column[i] for column in batch)) for i in range(25)])
        assert together.dtype == dtype and together.shape == (25,)
        torch.testing.assert_close(together, alone)
        expected = np.array([getattr(plain, name)(*(float(column[i]) for column in batch)) for i in range(25)])
        scale = 2e-5 if dtype == torch.float32 else 1e-12
        np.testing.assert_allclose(together.double(), expected, rtol=scale, atol=scale * np.abs(expected).max())


@every_law
def test_scalar_parameters_broadcast_over_any_batch_shape(law):
    made, p = LawFunctions(law), [torch.tensor(value) for value in typical(law)]
    assert made.names == [par.name for par in law.parameters]
    v = torch.linspace(-1, 1, 12).reshape(3, 4)
    assert made.force(v, torch.tensor(10.0), torch.zeros(3, 4), torch.zeros(1), *p).shape == (3, 4)
    if law.memory:
        assert made.rate(v[:1], torch.tensor(10.0), torch.zeros(3, 1), *p).shape == (3, 4)


def gradients_are_finite(law: FrictionLaw, p: list[float], dtype: torch.dtype) -> bool:
    made = LawFunctions(law)
    v = torch.tensor([*SPEEDS, *(-s for s in SPEEDS)], dtype=dtype, requires_grad=True)
    rows = [v, *(torch.full_like(v, x, requires_grad=True) for x in (10.0, 1e-5, 1e-3))]
    leaves = [torch.tensor(value, dtype=dtype, requires_grad=True) for value in p]
    results = [made.force(*rows, *leaves)]
    if law.memory:
        results += [made.capacity(*rows[:2], *leaves), made.rate(*rows[:3], *leaves)]
    slopes = torch.autograd.grad(sum(r.sum() for r in results), [*rows, *leaves], allow_unused=True)
    finite = [torch.isfinite(x).all() for x in (*results, *(slope for slope in slopes if slope is not None))]
    return all(map(bool, finite)) and all(slope is not None for slope in slopes[len(rows) :])


@both_precisions
@every_law
def test_gradients_are_finite_at_rest_and_at_tiny_and_huge_velocities(law, dtype):
    assert gradients_are_finite(law, typical(law), dtype)


@every_law
def test_gradients_are_finite_at_the_limits_of_every_parameter_that_has_some(law):
    for index, par in enumerate(law.parameters):
        for limit in (par.low, par.high):
            if 0 < limit < math.inf:
                p = [limit if i == index else value for i, value in enumerate(typical(law))]
                assert gradients_are_finite(law, p, torch.float64), (par.name, limit)


def test_breakaway_reaches_the_static_friction_at_a_stribeck_velocity_of_a_millimetre_a_second():
    law = LAWS["stribeck"]()
    p = SimpleNamespace(**{par.name: par.value for par in law.parameters} | TYPICAL | {"sigma_2": 0.0})
    forces = [float(law.force(SimpleNamespace(v=sp.Float(v), N=1), p)) for v in np.geomspace(1e-7, 1e-2, 200)]
    assert 0.99 * TYPICAL["mu_s"] < max(forces) <= TYPICAL["mu_s"]
