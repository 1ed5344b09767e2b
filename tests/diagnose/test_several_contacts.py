"""Diagnosis of mechanisms with two contacts: what is tried at each, and a friction that was not declared."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.diagnose.candidates import candidates, impossible, scales
from frictionpinn.diagnose.diagnosis import diagnose
from frictionpinn.export.augmented import load_augmented
from frictionpinn.physics import SYSTEMS
from frictionpinn.physics.contacts import law_named
from frictionpinn.physics.effects import effects_for
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.notation import equations, in_latex
from frictionpinn.physics.remainder import remainders
from frictionpinn.report.diagnosis import headline
from frictionpinn.workflow.diagnose import as_dict

LAWS = {"box": "coulomb_viscous", "hinge": "none"}
TRUTH = {"box.mu_c": 0.1, "box.sigma_2": 0.4}
HANGING = {"theta": np.pi}
TRIALS = [
    {"duration": 1.5, "tau": "0.9*sin(4*t)", "initial": HANGING},
    {"duration": 1.5, "tau": "2*sin(9*t)", "initial": HANGING},
    {"duration": 1.5, "tau": "0.8*sin(5*t) + sin(11*t)", "initial": HANGING},
]


@pytest.fixture(scope="module")
def mechanism():
    return Mechanism(SYSTEMS["pob_hinge"](), law_named(LAWS, "friction"))


def diagnosed(mechanism, acting=(), values=None, seed=0):
    clean = simulate_recording(mechanism.system, LAWS, TRUTH | (values or {}), TRIALS, 60.0, acting)
    made = GaussianNoise(0.02)(clean, seed)
    return diagnose(mechanism, made.select(made.names[:2]), made.select(made.names[2:]),
                    effects=["friction", "constant_force"])  # fmt: skip


@pytest.fixture(scope="module")
def dry(mechanism):
    return diagnosed(mechanism, ["friction@hinge"], {"hinge.mu_c": 0.08})


def test_what_needs_a_load_is_not_tried_where_there_is_no_friction(mechanism):
    tried = {e.name: e.groups(mechanism.system, mechanism.law) for e in effects_for(mechanism.system, mechanism.law)}
    assert {"asymmetry@box", "drift@box", "presliding@box", "drag@hinge", "constant_force@hinge"} <= tried.keys()
    assert not {f"{kind}@hinge" for kind in ("asymmetry", "drift", "presliding", "dwell", "stribeck")} & tried.keys()
    assert tried["ripple@hinge"].keys() == {"force"} and tried["ripple@box"].keys() == {"force", "friction"}


def test_friction_is_a_candidate_where_none_was_declared_and_there_alone(mechanism):
    tried = {e.name: e.groups(mechanism.system, mechanism.law) for e in effects_for(mechanism.system, mechanism.law)}
    assert tried["friction@hinge"] == {"Coulomb": ("hinge.mu_c",), "viscous": ("hinge.sigma_2",)}
    assert "friction@box" not in tried and "viscous@hinge" not in tried


def test_a_name_without_a_contact_asks_for_the_effect_at_each(mechanism):
    names = [e.name for e in effects_for(mechanism.system, mechanism.law, ["drag", "inertia@hinge"])]
    assert names == ["drag@box", "drag@hinge", "inertia@hinge"]


def test_values_that_no_mechanism_can_have_are_asked_of_effects_at_no_contact_as_well(mechanism, dry):
    system, law, runs = mechanism.system, mechanism.law, dry.bench.runs
    kinds = [e for e in effects_for(system, law) if "@" not in e.name]
    tested = Mechanism(system, law, tuple(kinds))
    bench = SimpleNamespace(mechanism=mechanism, tested=tested, runs=runs, sizes=dry.bench.sizes)
    options = candidates(kinds, system, law, scales(system, runs))
    assert len({c.effect for c in options}) > 3
    for c in options:
        tiny = dict.fromkeys((*c.strengths, *c.hidden), 1e-06)
        assert impossible(bench, c, tiny) == ""
        assert "is no number" in impossible(bench, c, tiny | {c.strengths[0]: np.nan})


def test_what_has_no_name_is_looked_for_at_each_contact(mechanism):
    kinds = {r.variable: set(r.groups(mechanism.system, mechanism.law)) for r in remainders(mechanism.system)}
    assert kinds["velocity@box"] == {"force", "friction"} and kinds["velocity@hinge"] == {"force"}
    assert {"theta@box", "x@hinge", "tau@hinge"} <= kinds.keys()


def test_undeclared_friction_of_the_hinge_is_named_with_its_law_and_size(dry):
    assert dry.verdict == "effect found", headline(dry)
    (found,) = dry.accepted
    assert found.candidate.name == "friction@hinge (Coulomb)" and found.candidate.strengths == ("hinge.mu_c",)
    low, high = dry.ci95["hinge.mu_c"]
    assert low <= 0.08 <= high and high - low < 0.02
    assert {"box.friction_force", "hinge.friction_force"} <= dry.errors.keys()
    assert dry.errors["hinge.friction_force"]["unit"] == "N*m" and dry.errors["box.friction_force"]["unit"] == "N"
    (told,) = as_dict(dry)["effects"]
    assert told["name"] == "friction@hinge" and told["group"] == "Coulomb"
    assert told["parameters"]["hinge.mu_c"]["unit"] == "N m at a preload of 1"


def test_page_and_augmented_model_hold_the_friction_that_was_found(dry, tmp_path):
    dry.save(tmp_path)
    assert "friction@hinge" in (tmp_path / "report.html").read_text(encoding="utf-8")
    mechanism, values = load_augmented(tmp_path / "augmented.yaml")
    assert mechanism.name == "pob_hinge+coulomb_viscous@box+none@hinge+friction@hinge"
    assert values["hinge.mu_c"] == pytest.approx(dry.values["hinge.mu_c"]) and values["hinge.sigma_2"] == 0
    box, hinge = equations(mechanism)
    assert r"\mu_{c box}" in in_latex(box) and r"\mu_{c hinge} \cdot" in in_latex(hinge)
    assert in_latex(hinge).startswith("F_{hinge} = N_{hinge}")


def test_nothing_is_missing_where_the_hinge_has_no_friction(mechanism):
    d = diagnosed(mechanism, seed=1)
    assert d.verdict == "nothing missing" and not d.accepted, headline(d)
