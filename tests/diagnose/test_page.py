"""The equation of a report, as a person reads it."""

import pytest

from frictionpinn.diagnose.report import equations, in_latex, in_mathml
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism


@pytest.fixture(scope="module")
def mechanism():
    return Mechanism(SYSTEMS["drive"](M=1.0), LAWS["coulomb_viscous"](), ("asymmetry", "low_speed", "presliding"))


def test_names_that_are_words_stay_whole_in_latex_and_letters_keep_their_index(mechanism):
    force, rate = equations(mechanism)
    text = in_latex(force)
    assert r"\mathrm{low\_speed}" in text and r"\mathrm{asymmetry} \cdot" in text
    assert r"\mu_{c}" in text and r"\sigma_{2}" in text and "v_{t}" in text
    assert r"\dot{z}" in in_latex(rate)


def test_factors_are_told_apart_on_the_page(mechanism):
    text = in_mathml(equations(mechanism)[0])
    assert text.startswith('<math display="block">') and "<mo>&#xB7;</mo>" in text and "InvisibleTimes" not in text
