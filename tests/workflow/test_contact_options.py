"""Friction laws of several contacts from the command line and the configuration."""

from __future__ import annotations

import json

import pytest

from frictionpinn.errors import UserError
from frictionpinn.physics import LAWS, SYSTEMS, FrictionLaw, extensions
from frictionpinn.physics.contacts import by_parameter, law_named, laws_of
from frictionpinn.workflow.build import build_friction, law_table
from frictionpinn.workflow.contact_options import contact_options, options_of
from frictionpinn.workflow.identify import identify
from frictionpinn.workflow.options import composed

CARTPOLE = ["system=cartpole", "bounds=data", "methods=[maximum_likelihood]"]


def friction(*options: str):
    cfg = composed("identify", [*CARTPOLE, *options])
    return cfg["friction"], build_friction(cfg["friction"], SYSTEMS["cartpole"]())


def test_a_law_is_for_all_contacts_and_one_of_them_may_have_another():
    assert friction("friction=dahl")[1].name == "dahl"
    assert friction("friction=dahl", "friction.bearing=none")[1].name == "dahl@rail+none@bearing"
    assert friction("friction.rail=coulomb", "friction.bearing=stribeck")[1].name == "coulomb@rail+stribeck@bearing"


def test_a_law_from_an_extension_is_one_that_a_contact_may_have(monkeypatch):
    class Own(FrictionLaw):
        name = "own"

    monkeypatch.setitem(LAWS, "own", Own)  # removed again, whatever registers it
    extensions.register([Own], "own.py")
    assert friction("friction.rail=own", "friction.bearing=coulomb")[1].name == "own@rail+coulomb@bearing"


def test_values_are_those_of_all_contacts_or_of_one():
    cfg, law = friction("friction.fixed.mu_c=0.1", "friction.fixed.bearing.mu_c=0.02")
    assert law_table(cfg, "fixed", law) == {
        "rail.mu_c": 0.1, "bearing.mu_c": 0.02, "rail.alpha": 2.0, "bearing.alpha": 2.0,
    }  # fmt: skip
    assert by_parameter({"bearing.mu_c": 1.0, "rail": {"mu_c": 2.0}}, law) == {"rail.mu_c": 2.0, "bearing.mu_c": 1.0}


@pytest.mark.parametrize("law", ["coulomb", "coulomb_viscous", "stribeck", "lugre"])
def test_values_are_given_one_by_one_or_as_a_table(law):
    for options in (["friction.fixed={mu_c: 0.1, bearing: {mu_c: 0.02}}"],
                    ["friction.fixed.mu_c=0.1", "friction.fixed.bearing.mu_c=0.02"]):  # fmt: skip
        cfg, laws = friction(f"friction={law}", *options)
        table = law_table(cfg, "fixed", laws)
        assert {name: x for name, x in table.items() if "mu_c" in name} == {"rail.mu_c": 0.1, "bearing.mu_c": 0.02}


@pytest.mark.parametrize(
    "laws",
    [
        {"rail": "lugre", "bearing": "lugre"},
        {"rail": "none", "bearing": "dahl"},
        {"rail": "coulomb", "bearing": "lugre"},
    ],
)
def test_laws_as_options_are_the_same_laws_again(laws):
    law = laws_of(SYSTEMS["cartpole"](), law_named(laws, "friction"))
    again = friction(*options_of(law))[1]
    assert [again.at(contact).name for contact in laws] == list(laws.values())


def test_options_of_one_law_are_left_as_they_are():
    same = ["friction=lugre", "friction.tie_sigma1=true", "friction.fixed.v_s=1e-3", "friction.boundz=1", "seed=1"]
    assert contact_options(same) == same


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["friction.bearing=lugr"], ["friction.bearing is 'lugr'", "none", "did you mean 'lugre'?"]),
        (["friction.bearin=lugre"], ["unknown contact of system cartpole", "rail, bearing", "did you mean 'bearing'?"]),
        (["friction.boundz=1"], ["unknown key", "friction.bounds"]),
    ],
)
def test_a_mistake_is_named_in_one_line(options, words):
    with pytest.raises(UserError) as error:
        friction(*options)
    assert "\n" not in str(error.value) and all(word in str(error.value) for word in words)


def test_a_contact_of_a_system_with_one_and_a_contact_without_a_law_are_refused():
    with pytest.raises(UserError, match="it has one contact, without a name"):
        build_friction({"name": "lugre", "contacts": {"box": "dahl"}}, SYSTEMS["pob"]())
    with pytest.raises(UserError, match=r"without a friction law: friction\.bearing"):
        laws_of(SYSTEMS["cartpole"](), law_named({"rail": "lugre"}, "friction"))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["pe2"], ["a network estimates a law with a bristle state", "maximum_likelihood"]),
        ([], ["no estimators"]),
    ],
)
def test_methods_that_do_not_suit_the_laws_are_refused(tmp_path, given, words):
    with pytest.raises(UserError) as error:
        identify(composed("identify", [*CARTPOLE, "friction.bearing=coulomb"]) | {"methods": given}, tmp_path)
    assert all(word in str(error.value) for word in words)


def test_identification_of_two_contacts_from_a_configuration(tmp_path):
    options = ["friction.rail=coulomb_viscous", "friction.bearing=coulomb_viscous", "data.rate_hz=100"]
    truth = {"rail": {"mu_c": 0.1, "sigma_2": 0.4}, "bearing": {"mu_c": 0.03, "sigma_2": 0.002}}
    cfg = composed("identify", [*CARTPOLE, *options])
    cfg["data"] |= {"friction": "coulomb_viscous", "truth": truth, "training_trials": 2}
    identify(cfg, tmp_path)
    result = json.loads((tmp_path / "result.json").read_text())
    (run,) = result["methods"]["maximum_likelihood"]
    assert run["outcome"] == "converged"
    for name, value in result["truth"].items():
        low, high = run["ci95"][name]
        assert low - (high - low) <= value <= high + (high - low), name
    assert result["units"]["bearing.sigma_2"] == "N*m*s/rad"
