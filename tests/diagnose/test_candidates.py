"""Candidates and remainders on every system: what is tried, and that neutral strengths change nothing."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from frictionpinn.diagnose.candidates import candidates
from frictionpinn.errors import UserError
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.effects import effects_for
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.remainder import BUMPS, places, remainders
from frictionpinn.physics.scan import SCALES

ONE = dict.fromkeys(SCALES, (0.0, 1.0))


@pytest.mark.parametrize("law", ["lugre", "coulomb_viscous"])
@pytest.mark.parametrize("name", SYSTEMS)
def test_every_strength_of_every_effect_is_tried_once(name, law):
    system, friction = SYSTEMS[name](), LAWS[law]()
    effects = effects_for(system, friction)
    made = candidates(effects, system, friction, {"": ONE} | {contact.name: ONE for contact in system.contacts})
    strengths = [n for c in made for n in c.strengths]
    assert len(strengths) == len(set(strengths))
    known = {par.name for e in effects for par in e.parameters_on(system, friction) if not par.hidden}
    assert set(strengths) == known
    assert all(set(c.hidden) <= set(c.grid[0]) for c in made)


def test_a_gradient_is_about_the_middle_of_the_stroke_wherever_positions_are_counted_from():
    system, friction = SYSTEMS["pendulum"](), LAWS["coulomb_viscous"]()
    covered = dict.fromkeys(("", *(contact.name for contact in system.contacts)), ONE | {"place": (2.7, 0.8)})
    made = candidates(effects_for(system, friction, ["position_friction"]), system, friction, covered)
    (gradient,) = [c for c in made if c.group == "gradient"]
    assert gradient.hidden == () and [list(point.values()) for point in gradient.grid] == [[pytest.approx(3.1)]]


def test_named_effects_alone_are_tried():
    system, friction = SYSTEMS["pob"](), LAWS["lugre"]()
    assert [e.name for e in effects_for(system, friction, ["drag", "ripple"])] == ["ripple", "drag"]


@pytest.mark.parametrize("name", SYSTEMS)
def test_remainders_at_neutral_leave_the_equations_as_they_are(name):
    system, law = SYSTEMS[name](), LAWS["lugre"]()
    made = remainders(system)
    with_, without = Mechanism(system, law, made), Mechanism(system, law)
    strengths = {par.symbol: 0 for r in made for par in r.parameters_on(system, law) if not par.hidden}
    for row, plain in zip(with_.residuals, without.residuals, strict=True):
        assert sp.simplify(row.xreplace(strengths) - plain) == 0


def test_a_force_on_the_hinge_may_depend_on_the_swing_and_on_nothing_that_does_not_act():
    found = {r.variable for r in remainders(SYSTEMS["pob"]())}
    assert {"time", "position", "velocity", "acceleration", "normal_force", "theta", "omega", "alpha"} == found
    assert "force" in {r.variable for r in remainders(SYSTEMS["drive"]())}


def test_bumps_cover_the_range_of_their_variable():
    (r,) = [r for r in remainders(SYSTEMS["drive"]()) if r.variable == "velocity"]
    first, step = r.place
    spread = places(r, np.linspace(-2.0, 3.0, 1000))
    assert spread[first] == pytest.approx(-2.0, abs=0.05)
    assert spread[first] + (BUMPS - 1) * spread[step] == pytest.approx(3.0, abs=0.05)


def test_the_motion_of_one_coordinate_can_be_imposed_and_then_requires_the_force_of_its_inertia():
    system = SYSTEMS["drive"](imposed=True, M=2.0)
    force = Mechanism(system, LAWS["coulomb_viscous"]()).required
    assert sp.diff(force, system.coordinates[0].symbols[2]) == sp.Symbol("M", real=True)
    with pytest.raises(UserError, match="cannot be imposed"):
        SYSTEMS["pob"](imposed=True)


def test_a_slip_position_that_no_expression_gives_is_in_metres_at_any_rate():
    from types import SimpleNamespace

    from frictionpinn.numerics.along import samples
    from frictionpinn.physics.base import CONTACT

    for rate in (50, 400):
        t = np.arange(2 * rate + 1) / rate
        run = SimpleNamespace(t=t, v_slip=np.full(len(t), 0.3), N=np.ones(len(t)), signals={})
        run.at = lambda _, run=run: run
        system = SimpleNamespace(contacts=[SimpleNamespace(name="")], slip_position=None)
        assert np.ptp(samples(system, run, CONTACT.s)) == pytest.approx(0.6)
