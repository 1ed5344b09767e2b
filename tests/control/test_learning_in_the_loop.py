"""What is learned is fed back: the loop bears it at the default settings, and no reading alone moves it far."""

from __future__ import annotations

import numpy as np
import pytest
from axes import DELAY, DRIVE, RESOLUTION, TRUTH, WRONG, estimator, gains, plant

import frictionpinn as fp
from frictionpinn.control import Plant, close, reference, tuned
from frictionpinn.control.pid import loop_dead_time
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

NAMES = ("M", "sigma_0", "sigma_1", "sigma_2", "mu_c", "mu_s", "v_s")
PLACE = {"position_bump": 0.372, "position_place": 1.93e-3, "position_width": 1.42e-3}
AXES = {  # undeclared effect, truth under load, what is believed, reference, stroke, encoder's step, inertia unloaded
    "inertia and place learned from one motion": (
        "position_friction", PLACE, (5.52, 1.235e6, 2065.0, 11.6, 11.29, 17.38, 1.154e-3),
        (4.416, 9.877e5, 2478.0, 9.27, 6.019, 9.27, 1.385e-3), ("point_to_point", 4e-3, 2.0), (0.0, 8e-3), 5e-7, 4.0,
    ),
    "half of the true inertia believed": (
        "asymmetry", {"asymmetry": 0.141}, (1.149, 1.107e5, 233.1, 2.48, 4.489, 5.882, 2.343e-3),
        (0.613, 1.328e5, 279.8, 2.98, 2.394, 3.137, 2.811e-3), ("point_to_point", 5e-3, 2.0), (0.0, 1e-2), 1e-6, 1.0,
    ),
    "a slow triangle under load": (
        "asymmetry", {"asymmetry": 0.131}, (1.241, 1.215e5, 279.7, 1.59, 3.630, 6.861, 2.451e-3),
        (0.993, 9.721e4, 335.6, 1.27, 1.936, 3.659, 2.941e-3), ("triangle", 5e-3, 4.0), (-5e-3, 5e-3), 1e-6, 1.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", AXES)
def test_a_loaded_axis_that_is_not_the_model_is_followed_without_running_away(name):
    effect, extra, truth, believed, motion, stroke, step, nominal = AXES[name]
    mechanism = Mechanism(SYSTEMS["drive"](), LAWS["lugre"](), (effect,))
    plant = Plant(mechanism, {**dict(zip(NAMES, truth, strict=True)), **extra}, step, 2e-3, 40.0 * nominal)
    known = dict(zip(NAMES, believed, strict=True))
    gains = tuned(nominal, loop_dead_time(1.5e-3, 1e-3), limit=plant.limit, dead=2 * step)
    path, errors = reference(*motion), {}
    for arm in ("none", "estimator"):
        made = None
        if arm == "estimator":
            made = fp.compensate(DRIVE, known, delay=1.5e-3, resolution=step, stroke=stroke)
        loop = close(plant, gains, path, 6.0, made, (DRIVE, known), delay=1.5e-3)
        errors[arm] = loop.error[2000:]
    assert np.std(errors["estimator"]) < 0.1 * np.std(errors["none"])
    assert np.abs(errors["estimator"]).max() < 0.3 * np.abs(errors["none"]).max()


def moved_by(glitch: dict[int, float]) -> float:
    """Largest change of the torque by readings that are wrong, in dry friction."""
    torques = []
    for wrong in ({}, glitch):
        made, rng = estimator(TRUTH, adapt={}), np.random.default_rng(0)
        rows = reference("sine", 5e-3, 1.0)(np.arange(600) * 1e-3)
        readings = rows[:, 0] + 1e-6 * rng.normal(size=len(rows))
        torques.append([made.update(row, readings[k] + wrong.get(k, 0.0), 0.0).torque for k, row in enumerate(rows)])
    return float(np.abs(np.diff(torques, axis=0)).max()) / TRUTH["mu_s"]


def test_a_reading_alone_is_taken_for_a_glitch_and_two_that_agree_for_the_axis():
    assert moved_by({400: 1e-3}) < 0.6  # by six standard deviations, not by a millimetre
    assert moved_by(dict.fromkeys(range(400, 410), 1e-3)) > 1.0


@pytest.mark.parametrize("asymmetry", [0.15, -0.15])
def test_friction_that_is_higher_one_way_is_learned_and_later_reversals_are_followed_better(asymmetry):
    made = fp.compensate(DRIVE, WRONG, delay=DELAY, resolution=RESOLUTION, stroke=(-5e-3, 5e-3))
    axis, path = plant("asymmetry", asymmetry=asymmetry), reference("triangle", 5e-3, 2.0)
    loop = close(axis, gains(), path, 9.0, made, (DRIVE, WRONG), delay=DELAY)
    assert made.asymmetry == pytest.approx(asymmetry, abs=0.4 * abs(asymmetry))
    early, late = (np.std(loop.error[first : first + 2000]) for first in (1000, 7000))
    assert late < 0.75 * early


def test_an_axis_that_waits_for_its_first_command_is_not_taken_for_one_with_other_parameters():
    made = fp.compensate(DRIVE, TRUTH, delay=2e-3, resolution=RESOLUTION, stroke=(-5e-3, 5e-3))
    late = Plant(DRIVE, TRUTH, RESOLUTION, 2e-3, 30.0)
    close(late, gains(), reference("triangle", 5e-3, 4.0), 0.1, made, (DRIVE, TRUTH), delay=2e-3)
    for name in made.adapt:
        if name in TRUTH:
            assert made.parameters[name] == pytest.approx(TRUTH[name], rel=0.05)
