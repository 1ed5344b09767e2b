"""The generator of benchmarks/wide.py: reproducible, in contact, sliding, and noisy as it says; and its scores."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from wide_draw import MOST_SAMPLES, SLIDES, draw
from wide_report import named

from frictionpinn.data.inspect import inspect
from frictionpinn.physics import SYSTEMS


@pytest.fixture(scope="module", params=[12, 22])
def seed(request):
    return request.param


def test_a_seed_draws_the_same_recording_again(seed):
    first, second = draw(seed), draw(seed)
    for a, b in zip(first.recording.trials, second.recording.trials, strict=True):
        assert all(np.array_equal(a.signals[name], b.signals[name]) for name in a.signals)


def test_motion_keeps_contact_and_slides(seed):
    case = draw(seed, effects=False)
    assert 3 <= len(case.clean.trials) <= 10 and len(case.clean) <= MOST_SAMPLES
    for trial in case.clean.trials:
        v = np.abs(trial.truth["v_slip"])
        assert trial.truth["normal_force"].min() > 0 and np.mean(v > 0.02 * v.max()) >= SLIDES


def test_noise_has_the_size_that_is_said(seed):
    case = draw(seed)
    for name, sigma in case.sigmas.items():
        clean, noisy = (np.concatenate([t.signals[name] for t in r.trials]) for r in (case.clean, case.recording))
        assert np.std(noisy - clean) == pytest.approx(sigma, rel=0.1)
        assert sigma >= case.level * np.std(clean)


@pytest.mark.parametrize("seed", [598, 710], ids=["outweighed by an undeclared spring", "mostly at rest"])
def test_a_trial_is_no_fault_that_tells_nothing_by_itself_and_goes_with_the_inertia_and_friction_of_the_others(seed):
    case = draw(seed)
    assert [f for f in inspect(case.recording, SYSTEMS[case.system](**case.parameters)) if f.grave] == []


def test_effects_leave_mechanism_and_excitation_as_they_are(seed):
    clean, other = draw(seed, effects=False), draw(seed, effects=("drag", "drift"))
    assert clean.truth == other.truth and clean.parameters == other.parameters and clean.effects == ()
    assert set(other.values) == {"drag", "drift"}
    pairs = [(a.truth["friction_force"], b.truth["friction_force"])
             for a, b in zip(clean.clean.trials, other.clean.trials, strict=True)]  # fmt: skip
    assert all(len(a) == len(b) and not np.array_equal(a, b) for a, b in pairs)


def test_an_effect_that_would_hold_the_contact_is_halved_until_it_slides():
    case = draw(321)
    assert case.effects == ("load_exponent",)
    assert max(np.abs(trial.truth["v_slip"]).max() for trial in case.clean.trials) > 0.01


@pytest.mark.parametrize("seed", [356, 261])  # where a push falls more slowly than the load: a pob and a sdob
def test_friction_without_memory_keeps_to_its_cone_while_the_load_changes(seed):
    """A stiff bristle does not: it holds the body (27 and 7 % beyond the cone)."""
    case = draw(seed, effects=False)
    for trial in case.clean.trials:
        force, load, v = (trial.truth[name] for name in ("friction_force", "normal_force", "v_slip"))
        assert np.all(np.abs(force - case.truth["sigma_2"] * v) <= case.truth["mu_s"] * load * (1 + 1e-9))
        slides = np.abs(v) > 1e-5
        assert np.all(np.sign(force[slides]) == np.sign(v[slides]))


@pytest.mark.parametrize(
    ("truth", "inseparable", "score"),
    [
        (["spring_force", "constant_force"], ["constant_force"], "alike"),  # one spring is both
        (["spring_force", "constant_force"], [], "one of two"),
        (["constant_force"], ["constant_force"], "wrong"),  # there is no spring
        (["constant_force", "drag"], ["constant_force", "drag"], "wrong"),
    ],
)
def test_what_is_said_to_be_part_of_an_answer_counts_beside_a_right_name_alone(truth, inseparable, score):
    answer = {"verdict": "effect found", "effects": ["spring_force"], "alike": [[]]}
    assert named(answer | {"true_effects": truth, "inseparable": inseparable}) == score
