"""One suite for every effect in EFFECTS, on every system and law where it applies; a new effect is tested by itself."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from effect_cases import (
    alone,
    cases,
    every_effect,
    every_pair,
    everything,
    function,
    plain,
    random_values,
    strengths,
)
from short_paths import ALL

from frictionpinn.data.units import registry
from frictionpinn.errors import UserError
from frictionpinn.physics import EFFECTS, LAWS, SYSTEMS, Effect
from frictionpinn.physics.base import TRIAL
from frictionpinn.physics.effects import effects_for
from frictionpinn.physics.mechanism import REQUIRED, Mechanism
from frictionpinn.physics.scan import SCALES, Scan, data_scales

# ---- what an effect says of itself


def test_the_effects_are_those_that_reports_may_name():
    assert len(EFFECTS) == 28
    assert all(kind.name == name and issubclass(kind, Effect) for name, kind in EFFECTS.items())


@every_effect
def test_an_effect_is_documented(name):
    said = EFFECTS[name].said()
    assert set(said) == {"equation", "units", "neutral", "occurs", "experiment"} and all(said.values())
    assert any(word in said["equation"] for word in ("=", "becomes", "sees", "makes its force from"))
    assert "= 0" in said["neutral"]


@every_effect
def test_an_effect_has_sound_parameters_wherever_it_applies(name):
    assert cases(name)
    for system, law in cases(name):
        mechanism = alone(name, system, law)
        effect = next(e for e in mechanism.effects if e.name == name)
        parameters = effect.parameters_on(mechanism.system, mechanism.law)
        own = {par.name for par in (*mechanism.system.parameters, *mechanism.law.parameters)}
        assert not own & {par.name for par in parameters}
        for par in parameters:
            assert par.text and par.low <= par.value <= par.high
            assert par.hidden == (par.neutral is None) and (par.hidden or par.value == par.neutral)
            registry().parse_units(mechanism.units[par.name].replace("1/", "dimensionless/"))
        tested = [n for group in effect.groups(mechanism.system, mechanism.law).values() for n in group]
        assert tested == [par.name for par in parameters if not par.hidden] != []


def test_no_two_effects_share_a_strength():
    for pair in ALL:
        mechanism = everything(*pair)
        names = [n for e in mechanism.effects for n in strengths(mechanism, e.name)]
        assert len(names) == len(set(names))


# ---- neutral values


@every_effect
def test_neutral_values_give_the_equations_without_the_effect(name):
    for system, law in cases(name):
        mechanism, base = alone(name, system, law), plain(system, law)
        for seed in range(3):
            values = random_values(mechanism, seed)
            own, expected = function(mechanism)(values), function(base)(values)
            rows = len(mechanism.free)
            kept = [*range(rows), *([len(mechanism.residuals) - 1] if base.law.memory else [])]
            kept += range(len(mechanism.residuals), len(own))
            np.testing.assert_allclose(own[kept], expected, rtol=1e-14, atol=1e-14 * np.abs(expected).max())


@every_effect
def test_derivatives_at_neutral_values_are_finite_and_not_zero(name):
    for system, law in cases(name):
        mechanism = alone(name, system, law)
        values = {"presliding": 1.0} if name == "backlash" else {}  # a gap shows only where a bristle carries force
        for strength in strengths(mechanism, name):
            if name == "trial_level":
                values["trial"] = int(strength.rpartition("_")[2])
            symbol = getattr(mechanism.p, strength)
            expressions = (*mechanism.residuals, mechanism.friction, *mechanism.outputs.values())
            slopes = [sp.diff(expr, symbol) for expr in expressions]
            late = any(strength in terms for terms in mechanism.delays.values())
            found = []
            for slip in (0.0, 1e-4, 2e-3, 0.1):
                slow = {c.symbols[1].name: slip for c in mechanism.system.moving} | {REQUIRED.name: 1.0}
                state = random_values(mechanism, 1) | values | slow
                found += list(function(mechanism, *slopes)(state)[-len(slopes) :])
            assert np.isfinite(found).all(), strength
            assert late or np.abs(found).max() > 1e-9, strength


@every_pair
def test_all_effects_together_reduce_to_the_mechanism_without_them(system, law):
    mechanism, base = everything(system, law), plain(system, law)
    for seed in range(5):
        values = random_values(mechanism, seed)
        own, expected = function(mechanism)(values)[-3:], function(base)(values)[-3:]
        np.testing.assert_allclose(own, expected, rtol=1e-14, atol=1e-13)
    assert mechanism.parameters[: len(base.parameters)] == base.parameters
    neutral = {par.symbol: par.neutral for par in mechanism.parameters if par.neutral is not None}
    for signal, truth in mechanism.predictions.items():
        assert sp.simplify(mechanism.outputs[signal].subs(neutral) - truth) == 0


# ---- units


@every_effect
def test_an_effect_is_consistent_in_its_units(name):
    ureg = registry()

    def quantity(value, unit):
        return ureg.Quantity(value, "dimensionless" if unit == "1" else unit.replace("1/", "dimensionless/"))

    for system, law in cases(name):
        mechanism = alone(name, system, law)
        force, slip = mechanism.system.force_unit, mechanism.system.slip_unit
        units = mechanism.units | {"z": slip, "zdot": f"{slip}/s", "age": slip, "age_dot": f"{slip}/s"}
        units |= {"t": "s", "t_session": "s"}
        units |= {s.name: u for c in mechanism.system.moving for s, u in zip(c.symbols, c.units, strict=True)}
        units |= {item.symbol.name: item.unit for item in mechanism.system.inputs} | {REQUIRED.name: force}
        values = random_values(mechanism, 0) | {REQUIRED.name: 1.0}
        values |= dict.fromkeys(strengths(mechanism, name), 0.01) | {"presliding": 0.5}
        result = mechanism.system.signal_units
        wanted = {mechanism.friction: force, mechanism.contact[sp.Symbol("N", real=True)]: force}
        wanted |= {expr: result[signal] for signal, expr in mechanism.outputs.items()}
        wanted |= dict.fromkeys(mechanism.residuals[len(mechanism.free) :], f"{slip}/s")
        for expr, unit in wanted.items():
            expr = sp.sympify(expr).xreplace({TRIAL: sp.Integer(1)})
            symbols = sorted(expr.free_symbols, key=str)
            made = sp.lambdify(symbols, expr, "numpy")
            found = made(*(quantity(values[s.name], units[s.name]) for s in symbols))
            assert found.is_compatible_with(quantity(1.0, unit)), expr


# ---- scans


def test_scans_cover_the_data():
    t = np.linspace(0, 2, 201)
    scales = data_scales([t], [0.1 + 0.2 * np.sin(9 * t)], [1.8 * np.cos(9 * t)], [np.full(201, 5.0)])
    assert set(scales) == set(SCALES)
    places = Scan("place", 0.0, 1.0, 3, "linear").values(scales)
    np.testing.assert_allclose(places, [-0.1, 0.1, 0.3], atol=1e-3)
    np.testing.assert_allclose(Scan("interval", 1, 10, 2).values(scales), [0.01, 0.1])
    for name, of in ((par.name, par.scan.of) for pair in ALL for par in everything(*pair).parameters if par.scan):
        assert of in SCALES, name


@pytest.mark.parametrize(
    ("effects", "word"),
    [(("dragg",), "'drag'"), (("drag", "drag"), "twice"), (("viscous",), "cannot act"), (("presliding",), "cannot")],
)
def test_mistakes_are_named_in_one_line(effects, word):
    with pytest.raises(UserError, match=word) as caught:
        Mechanism(SYSTEMS["pob"](), LAWS["lugre"](), effects)
    assert "\n" not in str(caught.value)


def test_effects_act_in_one_order_whatever_the_order_given():
    system, law = SYSTEMS["pob"](), LAWS["lugre"]()
    forward, backward = (Mechanism(system, law, names) for names in (("adhesion", "drift"), ("drift", "adhesion")))
    assert forward.name == backward.name == "pob+lugre+adhesion+drift"
    assert forward.friction == backward.friction


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("asymmetry@hnge", "effect at no such contact.*allowed: asymmetry@box, asymmetry@hinge"),
        ("payload@box", "effect at no such contact.*allowed: payload"),  # it acts on the whole mechanism
        ("asymetry", "did you mean 'asymmetry'"),
        (
            "stribeck",
            "effect cannot act on system pob_hinge with friction lugre: effects is stribeck; allowed: adhesion",
        ),
        ("friction@hinge", "effect cannot act .*: effects is friction@hinge"),
    ],
)
def test_an_effect_that_is_to_be_tried_where_there_is_no_such_one_is_refused(name, said):
    with pytest.raises(UserError, match=said):
        effects_for(SYSTEMS["pob_hinge"](), LAWS["lugre"](), [name])
