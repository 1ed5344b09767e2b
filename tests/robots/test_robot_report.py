"""What the report of a robot's diagnosis says first."""

from types import SimpleNamespace

import numpy as np
import pytest

from frictionpinn.report.robot import headline
from frictionpinn.robots.candidates import Term


@pytest.mark.parametrize(
    ("found", "said"),
    [
        ([("gain_error@joint_3", None, ())], "Missing: gain error in joint 3."),
        ([("payload", None, ("gain_error@joint_2",))], "Missing: payload or gain error."),
        ([("ripple@joint_1 (force)", 0, ()), ("ripple@joint_4 (friction)", 3, ())], "Missing: ripple in joints 1, 4."),
        ([("asymmetry@joint_2", 1, ("constant_force@joint_2",))], "Missing: asymmetry or constant force in joint 2."),
    ],
)
def test_the_headline_names_every_effect_with_its_joint_and_what_the_data_do_not_tell_from_it(found, said):
    accepted = [SimpleNamespace(term=Term(name, joint), alike=alike) for name, joint, alike in found]
    d = SimpleNamespace(accepted=accepted, rest={}, errors={"1": np.array([[0.2], [0.1]])}, held_out=())
    assert headline(d) == f"{said} Mean relative torque error on 1 (fitted): 20.0 % before, 10.0 % after."
