"""What a compensator adds: the friction of the law, within limits, and nothing that moves an axis that is to rest."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from axes import ADAPTS, DRIVE, TRUTH, WRONG, estimator, gains, plant
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from frictionpinn.control import Compensator, close, reference
from frictionpinn.errors import UserError
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

QUICK = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
STROKE = {"stroke": (-6e-3, 6e-3), "uneven": 0.2}
shapes = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=12)


def drive_about(compensator: Compensator, cycles: int, seed: int) -> None:
    """Run it along a motion whose readings and torques are noisy, so that every state of it is somewhere."""
    rng, path = np.random.default_rng(seed), reference("sine", 5e-3, 0.4)
    for row in path(np.arange(cycles) * 1e-3):
        compensator.update(row, row[0] + 1e-4 * rng.normal(), 5 * rng.normal())


@QUICK
@given(
    shape=shapes,
    cycles=st.integers(1, 400),
    seed=st.integers(0, 99),
    options=st.sampled_from([{}, {"adapt": {}}, STROKE]),
)
def test_where_the_reference_rests_no_closed_path_lets_it_do_work(shape, cycles, seed, options):
    compensator = estimator(**options)
    drive_about(compensator, cycles, seed)
    path = 1e-3 * np.interp(np.linspace(0, 1, 60), np.linspace(0, 1, len(shape) + 1), [*shape, shape[0]])
    rng, torques = np.random.default_rng(seed), []
    for x in path:
        torques.append(compensator.update((2e-3, 0.0, 0.0), x, 5 * rng.normal()).torque)
    work = float(np.sum(np.array(torques[:-1]) * np.diff(path)))
    assert np.ptp(torques[1:]) == 0.0  # the first cycle may still take in what came before the rest
    assert work <= 1e-12 + abs(torques[1] - torques[0]) * np.abs(np.diff(path)).max()


@QUICK
@given(seed=st.integers(0, 999), limit=st.floats(0.1, 20.0), wild=st.floats(0.0, 1e6))
def test_no_reading_and_no_torque_brings_it_over_its_limit_or_out_of_the_numbers(seed, limit, wild):
    compensator, rng = estimator(limit=limit), np.random.default_rng(seed)
    for row in reference("triangle", 5e-3, 0.4)(np.arange(300) * 1e-3):
        reading = row[0] + wild * rng.normal() if rng.random() < 0.5 else np.nan
        command = compensator.update(row, reading, wild * rng.normal())
        assert abs(command.torque) <= limit
        assert np.isfinite(command).all() and command.low <= command.torque <= command.high


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda made: pickle.loads(pickle.dumps(made))])
def test_a_copy_goes_on_as_the_compensator_does_and_leaves_it_alone(copied):
    compensator = estimator(**STROKE)
    drive_about(compensator, 200, 0)
    twin = copied(compensator)
    assert twin.parameters == compensator.parameters != TRUTH
    before = compensator.memory.X.copy()
    drive_about(twin, 50, 1)
    assert np.array_equal(compensator.memory.X, before)
    drive_about(compensator, 50, 1)
    assert np.array_equal(compensator.memory.X, twin.memory.X) and repr(twin) == repr(compensator)


def test_static_friction_below_coulomb_friction_is_refused():
    with pytest.raises(UserError, match=r"static below Coulomb friction: parameters\.mu_s is 1\.0; allowed: at least"):
        Compensator(DRIVE, TRUTH | {"mu_s": 1.0})


@pytest.mark.parametrize("speed", [-0.05, -2e-3, 1e-3, 0.02])
def test_along_a_constant_speed_the_feed_forward_is_the_laws_steady_friction(speed):
    compensator = Compensator(DRIVE, TRUTH)
    for k in range(2000):
        command = compensator.update((speed * k * 1e-3, speed, 0.0), np.nan, 0.0)
    p = TRUTH
    g = p["mu_c"] + (p["mu_s"] - p["mu_c"]) * np.exp(-((speed / p["v_s"]) ** 2))
    assert command.torque == pytest.approx(np.sign(speed) * g + p["sigma_2"] * speed, rel=1e-6)
    assert command.low == command.torque == command.high


def test_the_interval_of_an_uncertain_parameter_is_that_of_its_friction():
    compensator = Compensator(DRIVE, TRUTH | {"sigma_2": 0.0}, adapt={"mu_c": 0.0, "mu_s": 0.0}, spread={"mu_c": 0.1})
    for k in range(500):
        command = compensator.update((0.05 * k * 1e-3, 0.05, 0.0), np.nan, 0.0)
    assert command.high - command.torque == pytest.approx(1.96 * 0.1 * TRUTH["mu_c"], rel=1e-3)


def test_parameters_follow_the_machine_and_tracking_gets_better_than_with_the_law_alone():
    path = reference("sine", 5e-3, 1.0)
    law = close(plant(), gains(), path, 5.0, Compensator(DRIVE, WRONG), (DRIVE, WRONG), delay=1.5e-3)
    adapts = estimator()
    ours = close(plant(), gains(), path, 5.0, adapts, (DRIVE, WRONG), delay=1.5e-3)
    late = ours.t > 3.0
    assert np.std(ours.error[late]) < 0.2 * np.std(law.error[late])
    level = adapts.parameters["mu_c"] + abs(adapts.disturbance) * 0
    assert level == pytest.approx(TRUTH["mu_c"], rel=0.15)


def test_a_force_that_nobody_declared_is_found_as_a_disturbance():
    loop = estimator(TRUTH)
    close(plant("constant_force", constant_force=1.0), gains(), reference("sine", 5e-3, 1.0), 4.0, loop,
          (DRIVE, TRUTH), delay=1.5e-3)  # fmt: skip
    assert loop.disturbance == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    ("effects", "values"),
    [
        (("position_friction",), {"position_bump": 0.4, "position_place": 2e-3, "position_width": 1.5e-3}),
        (("ripple",), {"ripple_sin": 0.5, "ripple_wavelength": 3e-3}),
    ],
    ids=["a tight place", "a force that ripples"],
)
def test_friction_that_depends_on_the_place_is_known_when_the_axis_comes_back_to_it(effects, values):
    path, errors = reference("sine", 5e-3, 1.0), {}
    for name, options in {"disturbance alone": {}, "by place": STROKE}.items():
        made = estimator(TRUTH, disturbance=2.0, **options)
        loop = close(plant(*effects, **values), gains(), path, 5.0, made, (DRIVE, TRUTH), delay=1.5e-3)
        errors[name] = np.std(loop.error[loop.t > 3.0])
    assert errors["by place"] < 0.6 * errors["disturbance alone"]


def test_beyond_its_stroke_a_compensator_takes_what_it_knows_of_the_end():
    made = estimator(TRUTH, stroke=(-1e-3, 1e-3), uneven=0.2)
    loop = close(plant(), gains(), reference("sine", 5e-3, 1.0), 2.0, made, (DRIVE, TRUTH), delay=1.5e-3)
    assert np.abs(loop.error[1000:]).max() < 1e-4


def test_a_load_that_the_controller_does_not_know_is_added_where_inertia_adapts():
    path, heavy = reference("multisine", 2e-2, 1.0), {"M": 1.5}
    plain = close(plant(**heavy), gains(), path, 5.0, Compensator(DRIVE, TRUTH), (DRIVE, TRUTH), delay=1.5e-3)
    adapts = estimator(TRUTH, adapt={"M": 0.03}, spread={"M": 0.3})
    ours = close(plant(**heavy), gains(), path, 5.0, adapts, (DRIVE, TRUTH), delay=1.5e-3)
    assert adapts.parameters["M"] == pytest.approx(1.5, rel=0.1)
    assert np.std(ours.error[2000:]) < 0.3 * np.std(plain.error[2000:])


def test_begun_anew_it_says_the_same_again():
    compensator = estimator()
    rows = reference("triangle", 5e-3, 0.5)(np.arange(300) * 1e-3)
    first = [compensator.update(row, row[0] + 1e-5, 1.0) for row in rows]
    compensator.reset()
    assert [compensator.update(row, row[0] + 1e-5, 1.0) for row in rows] == first


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ({"interval": 0.0}, "interval is 0.0"),
        ({"delay": -1e-3}, "delay is -0.001"),
        ({"resolution": float("nan")}, "resolution is nan"),
        ({"limit": -1.0}, "limit is -1.0"),
        ({"bandwidth": 0.0}, "bandwidth is 0.0"),
        ({"still": 0.0}, "still is 0.0"),
        ({"adapt": {"mu_x": 0.1}}, "adapt.mu_x"),
        ({"spread": {"mu_c": -0.1}}, "spread.mu_c is -0.1"),
        ({"gain": -1.0}, "gain is -1.0"),
        ({"uneven": -0.1}, "uneven is -0.1"),
        ({"cells": 1}, "cells is 1"),
        ({"stroke": (1.0, 1.0)}, "stroke is"),
    ],
)
def test_an_impossible_option_is_refused_in_one_line_that_names_it(options, part):
    with pytest.raises(UserError, match=part) as caught:
        Compensator(DRIVE, TRUTH, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("system", ["pob", "sdob", "damper"])
def test_a_system_that_no_controller_moves_is_refused(system):
    with pytest.raises(UserError, match="drive, joint, pendulum"):
        Compensator(Mechanism(SYSTEMS[system](), LAWS["lugre"]()), TRUTH)


def test_a_reference_or_a_torque_that_is_no_number_is_refused():
    for wrong in [(0.0, np.nan, 0.0), (0.0, 1.0), "abc", {"q": 0.0}, [[0.0], [0.0, 1.0], 0.0]]:
        with pytest.raises(UserError, match="no reference"):
            estimator().update(wrong, 0.0, 0.0)
    with pytest.raises(UserError, match="torque"):
        estimator().update((0.0, 0.0, 0.0), 0.0, np.inf)


def test_options_of_the_shared_axis_are_those_of_the_class():
    assert set(ADAPTS) <= set(Compensator.__init__.__annotations__)
