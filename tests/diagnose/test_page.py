"""The equation of a report, as a person reads it."""

import pytest

from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.notation import equations, in_latex, in_mathml
from frictionpinn.report.words import chance


@pytest.fixture(scope="module")
def mechanism():
    return Mechanism(SYSTEMS["drive"](M=1.0), LAWS["coulomb_viscous"](), ("asymmetry", "low_speed", "presliding"))


def test_names_that_are_words_stay_whole_in_latex_and_letters_keep_their_index(mechanism):
    force, rate, load = (in_latex(e) for e in equations(mechanism))
    assert r"\mathrm{low\_speed}" in load and r"\mathrm{asymmetry} \cdot" in load and load.startswith("N_{law} =")
    assert r"\mu_{c}" in force and r"\sigma_{2}" in force and "v_{t}" in force and "N_{law}" in force
    assert r"\dot{z}" in rate and r"\operatorname{exp}" in load and "e^{" not in load


def test_on_the_page_factors_are_told_apart_words_are_whole_and_the_rate_has_its_dot(mechanism):
    written = equations(mechanism)
    text = in_mathml(written)
    assert text.startswith('<math display="block"><mtable>') and "<mo>&#xB7;</mo>" in text.replace("&#183;", "&#xB7;")
    assert "InvisibleTimes" not in text and "zdot" not in text and "<mover>" in text
    assert '<mi mathvariant="normal">low_speed</mi>' in text and text.count("<mtr>") > len(written)


def test_strengths_that_were_not_estimated_are_left_out_and_so_are_constants_that_keep_derivatives_finite():
    drive = SYSTEMS["drive"](M=1.0)
    bump = equations(Mechanism(drive, LAWS["coulomb"](), ("position_friction",)), ["position_bump"])
    assert "bump" in in_latex(bump[-1]) and "gradient" not in in_latex(bump[-1])
    (force, rate) = equations(Mechanism(drive, LAWS["lugre"](), ("stribeck_shape",)))
    assert r"\left|{\frac{v}{v_{s}}}\right|^{\alpha}" in in_latex(rate) and "10^{-" not in in_latex(rate)
    assert in_latex(force).startswith("F = ")


def test_each_of_several_contacts_has_its_own_load():
    made = Mechanism(SYSTEMS["pob_hinge"](), LAWS["coulomb"](), ("asymmetry@hinge",))
    box, *hinge = (in_latex(e) for e in equations(made))
    assert "law" not in box and "N_{law hinge}" in hinge[0] and hinge[-1].startswith("N_{law hinge} = N_{hinge}")


def test_a_chance_that_no_noise_could_tell_has_no_figure():
    assert chance(-38.1) == "8e-39" and chance(-10671.0) == "below 1e-100"
