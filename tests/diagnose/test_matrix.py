"""Every effect on some system with some law: simulated, recorded with noise, and asked for by its name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import pytest

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.diagnose.diagnosis import Diagnosis, diagnose
from frictionpinn.physics import EFFECTS, SYSTEMS
from frictionpinn.physics.contacts import law_named
from frictionpinn.physics.effects import effects_for
from frictionpinn.physics.mechanism import Mechanism

NOISE = 0.03
WIDER = 1.5  # than 95 %: a single draw in twenty misses that
HELD_OUT = 1  # trials, the last


@dataclass(frozen=True)
class Bed:
    """A system with a law, and what is done with it: trials, their rate, the law's parameters."""

    system: str
    law: str | Mapping[str, str]
    rate_hz: float
    truth: Mapping[str, float]
    trials: tuple[Mapping[str, object], ...]

    @property
    def mechanism(self) -> Mechanism:
        return Mechanism(SYSTEMS[self.system](), law_named(self.law, "law"))

    def record(self, values: Mapping[str, float], effects: tuple[str, ...], seed: int) -> Recording:
        system = SYSTEMS[self.system]()
        made = simulate_recording(system, self.law, {**self.truth, **values}, self.trials, self.rate_hz, effects)
        return GaussianNoise(NOISE)(made, seed)


def trials(duration: float, *each: Mapping[str, object]) -> tuple[Mapping[str, object], ...]:
    return tuple({"duration": duration, **trial} for trial in each)


STROKES = trials(
    1.5, {"x": "0.02*sin(4*t)"}, {"x": "0.03*sin(9*t)"}, {"x": "0.02*sin(6*t) + 0.01*sin(17*t)"},
    {"x": "0.025*sin(7*t)"},
)  # fmt: skip
BEDS = {
    "damper": Bed("damper", "coulomb_viscous", 100.0, {"mu_c": 100.0, "sigma_2": 200.0}, STROKES),
    "greased damper": Bed(
        "damper", "stribeck", 100.0,
        {"mu_c": 100.0, "mu_s": 160.0, "v_s": 0.05, "sigma_2": 100.0, "alpha": 2.0}, STROKES,
    ),
    "band damper": Bed(
        "damper", "lugre_tied", 100.0,
        {"sigma_0": 3e4, "sigma_2": 50.0, "mu_c": 100.0, "mu_s": 130.0, "v_s": 0.03}, STROKES,
    ),
    "drive": Bed(
        "drive", "lugre", 120.0,
        {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 5e-3},
        trials(1.5, {"force": "5*sin(6*t)"}, {"force": "8*sin(9*t)"}, {"force": "6*sin(7*t + 0.5*sin(7*t))"},
               {"force": "7*sin(8*t)"}),
    ),
    "pendulum": Bed(
        "pendulum", "coulomb", 80.0, {"mu_c": 0.4},
        trials(2.5, {"tau": "1.5*sin(4.3*t)", "initial": {"theta": 2.0}},
               {"tau": "2*sin(3*t)", "initial": {"theta": 1.5}}, {"tau": "1.2*sin(5*t)", "initial": {"theta": 4.5}},
               {"tau": "1.5*sin(4*t)", "initial": {"theta": 1.8}}),
    ),
    "joint": Bed(
        "joint", "coulomb_viscous", 100.0, {"mu_c": 2.0, "sigma_2": 1.0},
        trials(2.0, {"tau": "5*sin(6*t)"}, {"tau": "8*sin(9*t)"}, {"tau": "6*sin(7*t + 0.5*sin(7*t))"},
               {"tau": "7*sin(8*t)"}),
    ),
    "pob": Bed(
        "pob", "lugre", 100.0,
        {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.5, "v_s": 5e-3},
        trials(1.5, {"theta": "55*deg*sin(2*pi*t)"}, {"theta": "65*deg*sin(6*t)"},
               {"theta": "45*deg*sin(5*t + 0.4*sin(5*t))"}, {"theta": "60*deg*sin(5.5*t)"}),
    ),
    "sdob": Bed(
        "sdob", "dahl", 100.0, {"sigma_0": 5e3, "mu_c": 0.3},
        trials(2.0, {"y": "0.2346 + 0.03*sin(12.2*t)", "force": "6*sin(6*t)"},
               {"y": "0.2346 + 0.03*sin(12.2*t + 1)", "force": "8*sin(7*t)"},
               {"y": "0.2346 + 0.02*sin(10*t + 2)", "force": "7*sin(6*t + 0.4*sin(6*t))"},
               {"y": "0.2346 + 0.03*sin(12.2*t + 3)", "force": "7*sin(6.5*t)"}),
    ),
    "hinge": Bed(
        "pob_hinge", {"box": "coulomb_viscous", "hinge": "none"}, 80.0, {"box.mu_c": 0.1, "box.sigma_2": 0.4},
        trials(2.0, {"tau": "0.9*sin(4*t)", "initial": {"theta": 3.14}},
               {"tau": "2*sin(9*t)", "initial": {"theta": 3.14}}, {"initial": {"theta": 1.7}},
               {"tau": "0.8*sin(5*t) + sin(11*t)", "initial": {"theta": 3.14}}),
    ),
}  # fmt: skip

# Where, the parameter that tells the size, and the parameters with which the effect acts; the seed is the place.
CASES: tuple[tuple[str, str, Mapping[str, float]], ...] = (
    ("damper", "low_speed", {"low_speed": 0.3, "low_speed_scale": 0.03}),
    ("damper", "presliding", {"presliding": 1.0, "presliding_length": 2e-3}),
    ("damper", "inertia", {"inertia": 6.0}),
    ("damper", "stribeck_rise", {"stribeck_rise": 0.3, "stribeck_speed": 0.03}),
    ("greased damper", "stribeck_shape", {"stribeck_shape": -1.0}),
    ("greased damper", "asymmetric_viscous", {"asymmetric_viscous": 60.0}),
    ("greased damper", "position_gradient", {"position_gradient": 4.0}),
    ("band damper", "backlash_gap", {"backlash_gap": 1e-3, "backlash_width": 1e-4}),
    ("band damper", "ripple_friction_sin", {"ripple_friction_sin": 0.1, "ripple_wavelength": 0.01}),
    ("band damper", "drift", {"drift": 0.03}),
    ("band damper", "trial_level_2", {"trial_level_2": 0.1}),
    ("drive", "constant_force", {"constant_force": 0.25}),
    ("damper", "spring_stiffness", {"spring_stiffness": 400.0}),
    ("damper", "vibration_sin", {"vibration_sin": 10.0, "vibration_frequency": 7.3}),
    ("drive", "dwell", {"dwell": 0.3, "dwell_time": 0.05, "dwell_length": 1e-3}),
    ("drive", "delay_force", {"delay_force": 0.01}),
    ("drive", "gain_error_force", {"gain_error_force": 0.08}),
    ("pendulum", "viscous", {"viscous": 0.03}),
    ("pendulum", "com_across", {"com_across": 0.015}),
    ("pendulum", "drag", {"drag": 5e-3}),
    ("pendulum", "payload_m", {"payload_m": 0.06}),
    ("pendulum", "bias_omega", {"bias_omega": 0.15}),
    ("pob", "adhesion", {"adhesion": 1.2}),
    ("pob", "asymmetry", {"asymmetry": 0.08}),
    ("pob", "sensor_delay_theta_omega_alpha", {"sensor_delay_theta_omega_alpha": 6e-3}),
    ("sdob", "load_exponent", {"load_exponent": 0.4}),
    ("sdob", "scale_x", {"scale_x": 0.06}),
    ("joint", "constant_force", {"constant_force": 0.25}),
    ("joint", "asymmetry", {"asymmetry": 0.1}),
    ("hinge", "hinge.mu_c", {"hinge.mu_c": 0.08}),
    ("hinge", "hinge.sigma_2", {"hinge.sigma_2": 0.03}),
    ("pob", "backlash_gap", {"backlash_gap": 1.5e-4, "backlash_width": 1e-6}),  # less than its bristle bends
    ("damper", "bias_force", {"bias_force": 10.0}),
    ("damper", "delay_force", {"delay_force": 8e-3}),
)
CLEAN = ("damper", "drive", "pendulum", "pob", "sdob", "joint", "hinge")


@cache
def owner(bed: str, parameter: str) -> str:
    """Name of the effect that a parameter belongs to."""
    system, law = BEDS[bed].mechanism.system, BEDS[bed].mechanism.law
    effects = effects_for(system, law)
    return next(e.name for e in effects if parameter in {par.name for par in e.parameters_on(system, law)})


def diagnosed(bed: str, values: Mapping[str, float], effects: tuple[str, ...], seed: int) -> Diagnosis:
    made = BEDS[bed].record(values, effects, seed)
    fitted, kept = made.names[:-HELD_OUT], made.names[-HELD_OUT:]
    return diagnose(BEDS[bed].mechanism, made.select(fitted), made.select(kept))


def told(d: Diagnosis) -> str:
    """What was found, for a failing test's message."""
    added = [(a.candidate.name, a.evidence, [c.name for c, _ in a.alike]) for a in d.accepted]
    return f"{d.verdict}: {added}, {d.values}, {d.ci95}"


def test_every_effect_has_a_case_and_every_system_and_law_that_has_one_has_two():
    assert {owner(bed, main).partition("@")[0] for bed, main, _ in CASES} == set(EFFECTS)
    beds = [BEDS[bed] for bed, _, _ in CASES]
    for used in ([b.system for b in beds], [b.law for b in beds]):  # those of your own may have none
        assert all(used.count(name) >= 2 for name in used)
    assert {BEDS[bed].system for bed in CLEAN} == {b.system for b in beds}


@pytest.mark.parametrize(
    ("seed", "bed", "main", "values"),
    [pytest.param(k, *case, id=f"{case[1]}-{case[0]}") for k, case in enumerate(CASES)],
)
def test_the_effect_that_acts_is_named_alone_and_its_size_is_told(seed, bed, main, values):
    d = diagnosed(bed, values, (owner(bed, main),), seed)
    assert d.verdict == "effect found", told(d)
    (found,) = d.accepted
    alike = {n: s for c, strengths in found.alike for n, s in strengths.items()}
    assert main in found.candidate.strengths or main in alike, told(d)
    if main in found.candidate.strengths:
        low, high = d.ci95[main]
        middle, half = (low + high) / 2, WIDER * (high - low) / 2
        assert middle - half <= values[main] <= middle + half, told(d)
    else:
        assert alike[main] == pytest.approx(values[main], rel=0.3), told(d)


@pytest.mark.parametrize("bed", CLEAN)
def test_nothing_is_missing_where_nothing_acts_beside_the_law(bed):
    d = diagnosed(bed, {}, (), CLEAN.index(bed))
    assert d.verdict == "nothing missing" and not d.accepted, told(d)
