"""The axes of benchmarks/compensation.py: drawn alike every time, never what is believed, the same in MuJoCo."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

pytest.importorskip("mujoco", reason="needs the extra: pip install -e '.[mujoco]'")

from compensation import closed, compensator, figures
from compensation_plants import ERROR, KINDS, LOAD, draw

from frictionpinn.control import close, reference, tuned
from frictionpinn.control.pid import loop_dead_time


@pytest.mark.parametrize("name", KINDS)
def test_a_seed_draws_the_same_axis_and_what_is_believed_of_it_is_wrong(name):
    it, again, loaded = draw(name, 3, load=1.0), draw(name, 3, load=1.0), draw(name, 3)
    truth = it.plant.parameters
    assert truth == again.plant.parameters and it.believed == again.believed
    assert [effect.name for effect in it.plant.mechanism.effects] == [KINDS[name].effect] and not it.model.effects
    for key in set(it.believed) - {"preload", "mu_s", "W_sin"}:
        assert abs(it.believed[key] / truth[key] - 1) == pytest.approx(ERROR)
    assert all(loaded.plant.parameters[key] == pytest.approx(LOAD * truth[key]) for key in KINDS[name].loaded)


def test_every_kind_has_random_numbers_of_its_own():
    assert len({kind.stream for kind in KINDS.values()}) == len(KINDS)


def test_a_trolley_in_mujoco_whose_pole_hangs_still_moves_as_the_drive_of_our_simulator():
    it = draw("trolley", 0, load=1.0)
    own = replace(it.plant, foreign=None)
    gains = tuned(own.parameters["M"], loop_dead_time(1.5e-3, 1e-3), limit=own.limit)
    slow = reference("sine", 2e-3, 2.0)  # too small and slow a motion to swing the pole
    loops = [close(plant, gains, slow, 1.0, None, (it.model, it.believed), delay=1.5e-3) for plant in (own, it.plant)]
    ours, foreign = (loop.error[50:] for loop in loops)
    assert np.std(foreign - ours) < 0.05 * np.std(ours)
    assert np.std(loops[1].friction - loops[0].friction) < 0.05 * np.std(loops[0].friction)


def test_an_arm_behind_an_elastic_gear_takes_the_torque_of_the_joint_of_our_simulator_gravity_included():
    it = draw("arm", 0, load=1.0)
    own = replace(it.plant, foreign=None)
    gains = tuned(own.parameters["J"], loop_dead_time(1.5e-3, 1e-3), limit=own.limit)
    slow = reference("sine", 0.2, 4.0)  # slow enough that the gear's spring does not ring
    loops = [close(plant, gains, slow, 4.0, None, (it.model, it.believed), delay=1.5e-3) for plant in (own, it.plant)]
    ours, foreign = (loop.torque[500:] for loop in loops)
    # where friction turns over, the gear's spring winds up first: the median leaves that out
    assert np.median(np.abs(foreign - ours)) < 0.05 * own.parameters["W_cos"]


def test_the_oracle_that_knows_the_delay_of_its_axis_is_better_than_one_that_is_told_another():
    seed = next(seed for seed in range(20) if draw("stage", seed).plant.delay == 2e-3)

    def told(delay: float):
        def make(it):
            return compensator("oracle", replace(it, plant=replace(it.plant, delay=delay)))

        return figures(closed("stage", "slow triangle", seed, make, holds=0.0, moves=4.0), ends=4.0)["rms"]

    assert told(2e-3) < 0.8 * told(1.5e-3)


def test_an_oracle_that_measures_frees_an_axis_that_sticks_where_one_that_watches_nothing_leaves_it():
    stuck, freed = (
        figures(closed("stage", "reversing sine", 2, lambda it, arm=arm: compensator(arm, it), holds=0.0))["rms"]
        for arm in ("oracle", "measuring")
    )
    assert freed < 0.1 * stuck
