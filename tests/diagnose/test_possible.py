"""Values that no mechanism can have, and strengths that the data do not tell from zero."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnosis import recorded

from frictionpinn.data.recording import Recording, Trial
from frictionpinn.diagnose.bench import Bench
from frictionpinn.diagnose.candidates import candidates, impossible, scales
from frictionpinn.diagnose.diagnosis import diagnose
from frictionpinn.numerics.along import fastest_period, moving_mass
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.effects import effects_for
from frictionpinn.physics.mechanism import Mechanism


@pytest.fixture(scope="module")
def drive():
    """A drive of 1 kg, forces of 1 and 1.5 Hz, strokes of some centimetres; its bench and its candidates by name."""
    system, made = recorded()
    law = LAWS["lugre"]()
    kinds = effects_for(system, law, ["payload", "inertia", "delay", "ripple", "asymmetry", "drag"])
    bench = Bench(Mechanism(system, law), kinds, (), made, made.select(()))
    made = candidates(kinds, system, law, scales(system, bench.simulate(bench.base)))
    return bench, {c.name: c for c in made}


def told(drive, name, ci95=None, **values):
    bench, table = drive
    strengths = dict.fromkeys((*table[name].strengths, *table[name].hidden), 0.01)
    return impossible(bench, table[name], strengths | values, ci95)


@pytest.mark.parametrize(
    ("name", "values", "why"),
    [
        ("payload (M)", {"payload_M": -0.9}, "nothing is left of what it changes"),
        ("payload (M)", {"payload_M": -0.5}, ""),
        ("inertia", {"inertia": -1.01}, "makes the moving mass negative"),
        ("inertia", {"inertia": -0.9}, ""),
        ("asymmetry", {"asymmetry": -0.99}, "nothing is left"),
        ("delay (force)", {"delay_force": 1.2}, "longer than a period of the fastest motion"),
        ("delay (force)", {"delay_force": -0.05}, ""),
        ("ripple (force)", {"ripple_wavelength": 5.0}, "above the stroke"),
        ("ripple (force)", {"ripple_wavelength": 0.01}, ""),
        ("drag", {"drag": np.nan}, "is no number"),
    ],
)
def test_what_no_mechanism_can_have_is_refused_with_its_reason(drive, name, values, why):
    said = told(drive, name, **values)
    assert (why in said) if why else not said


@pytest.mark.parametrize(
    ("name", "ci95", "why"),
    [
        ("drag", {"drag": (-0.1, 0.2)}, "holds zero (-0.1 to 0.2)"),
        ("drag", {"drag": (0.1, 0.2)}, ""),
        ("drag", {"drag": (0.1, 0.1)}, "no width"),
        ("drag", {"drag": (np.nan, np.nan)}, "do not tell"),
        ("ripple (force)", {"ripple_sin": (-0.1, 0.2), "ripple_cos": (0.1, 0.3)}, ""),
        ("ripple (force)", {"ripple_sin": (-0.1, 0.2), "ripple_cos": (-0.1, 0.3)}, "holds zero"),
    ],
)
def test_a_strength_that_the_data_do_not_tell_from_zero_is_refused(drive, name, ci95, why):
    said = told(drive, name, ci95)
    assert (why in said) if why else not said


def test_scales_of_the_motion_are_those_of_the_recording(drive):
    bench, _ = drive
    assert 0.1 < fastest_period(bench.runs) < 0.7  # forces of 1 and 1.5 Hz, and what friction adds to them
    assert moving_mass(bench.mechanism.system, bench.runs) == pytest.approx(1.0)


def test_an_effect_that_stood_in_for_a_later_one_makes_way_for_it():
    """A torque that reads a ninth too little and has an offset: a ripple stands in for the two until the offset comes,
    beside which it has the wavelength of gravity, of which the stroke shows no period."""
    rng, trials = np.random.default_rng(11), []
    for name, amplitude, slow, fast, seconds in (
        ("1", 1.0, 1.9, 4.1, 6),
        ("2", 1.6, 1.2, 3.3, 7),
        ("3", 0.8, 2.7, 6.1, 8),
    ):
        t = np.arange(0, seconds, 1 / 60)
        theta = amplitude * (np.sin(slow * t) + 0.3 * np.sin(fast * t))
        omega = amplitude * (slow * np.cos(slow * t) + 0.3 * fast * np.cos(fast * t))
        alpha = -amplitude * (slow**2 * np.sin(slow * t) + 0.3 * fast**2 * np.sin(fast * t))
        tau = 0.9 * alpha + 6.0 * np.cos(theta) + 2.5 * np.sign(omega) + 1.3 * omega
        signals = {"theta": theta, "omega": omega, "alpha": alpha, "tau": tau / 1.12 + 0.4}
        noisy = {key: y + 0.003 * y.std() * rng.standard_normal(len(t)) for key, y in signals.items()}
        trials.append(Trial(name, t, noisy))
    joint = Mechanism(SYSTEMS["joint"](J=0.9, W_cos=6.0, imposed=True), LAWS["coulomb_viscous"]())
    made = Recording(tuple(trials), {"theta": "rad", "omega": "rad/s", "alpha": "rad/s^2", "tau": "N*m"})
    tried = ["inertia", "ripple", "constant_force", "sensor_scale"]
    found = diagnose(joint, made.select(["1", "2"]), made.select(["3"]), effects=tried)
    assert [a.candidate.name for a in found.accepted] == ["sensor_scale (tau)", "constant_force"]
    assert found.values["scale_tau"] == pytest.approx(1 / 1.12 - 1, rel=0.01)
    assert found.values["constant_force"] == pytest.approx(0.4 * 1.12, rel=0.02)
    assert found.values["mu_c"] == pytest.approx(2.5, rel=0.01)
