"""What acts the same way is named together, off the beaten path: recordings as benchmarks/wide.py draws them."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from wide import declared, draw

from frictionpinn.diagnose.diagnosis import diagnose


@pytest.mark.parametrize(
    ("seed", "effect", "strength"),
    [
        (150, "sensor_delay", "sensor_delay_x_v_a"),  # the delay of the only input, by definition
        (142, "inertia", "inertia"),  # a payload: what the law leaves open decides nothing in the held-out trial
    ],
)
def test_the_effect_that_acts_is_named_or_listed_as_alike(seed, effect, strength):
    case = draw(seed)
    assert case.effects == (effect,)
    fitted = case.recording.select(set(case.recording.names) - set(case.held_out))
    (found,) = diagnose(declared(case), fitted, case.recording.select(set(case.held_out))).accepted
    values = {n: v for candidate, own in found.alike if candidate.effect == effect for n, v in own.items()}
    assert values[strength] == pytest.approx(case.values[strength], rel=0.15)


def test_what_acts_as_the_first_of_two_effects_does_is_listed_beside_the_second_too():
    case = draw(12, effects=("payload", "constant_force"))
    fitted = case.recording.select(set(case.recording.names) - set(case.held_out))
    accepted = diagnose(declared(case), fitted, case.recording.select(set(case.held_out))).accepted
    named = [{a.candidate.effect, *(c.effect for c, _ in a.alike)} for a in accepted]
    assert {"payload", "inertia", "gain_error"} <= named[0]
    assert "constant_force" in named[1]
