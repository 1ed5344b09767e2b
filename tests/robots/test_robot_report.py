"""What the report of a robot's diagnosis says first."""

from types import SimpleNamespace

import numpy as np
import pytest
from arms import urdf

from frictionpinn.physics import LAWS
from frictionpinn.physics.robot import Base, Robot
from frictionpinn.report.robot import headline, torques_over_time
from frictionpinn.robots.candidates import Term, on_robot
from frictionpinn.robots.identify import declare
from frictionpinn.robots.rounds import reasons


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
    fit, error = (
        SimpleNamespace(converged=True),
        "Mean relative torque error on 1 (fitted): 20.0 % before, 10.0 % after.",
    )
    d = SimpleNamespace(accepted=accepted, rest={}, errors={"1": np.array([[0.2], [0.1]])}, held_out=(), fit=fit)
    assert headline(d) == f"{said} {error}"
    model = SimpleNamespace(names=("joint_1",), free=("inertia.j1.m", "joint_1.mu_c", "joint_1.v_s", "lag"))
    d.fit = SimpleNamespace(converged=False, model=model, told=lambda name: name == "joint_1.mu_c")
    assert headline(d).startswith(f"{said} The search did not converge") and headline(d).endswith(error)
    assert "(joint_1.v_s) with friction.fixed.joint_1.v_s=..." in headline(d)


def test_what_is_alike_to_an_effect_is_refused_as_that():
    """Beside the effect nothing is left to it: a later round would say that the motion does not tell it."""
    added = SimpleNamespace(term=Term("load_friction@joint_2", 1), alike=("gain_error@joint_2",))
    earlier = {"gain_error@joint_2": "this motion does not tell it", "drag@joint_1": "not significant",
               "load_friction@joint_2": "not significant"}  # fmt: skip
    why = "explains about as much as load_friction@joint_2: the recording hardly tells them apart"
    assert reasons(earlier, [added]) == {"gain_error@joint_2": why, "drag@joint_1": "not significant"}


def test_every_time_axis_with_a_label_has_its_figures():
    model = SimpleNamespace(names=("joint_1", "joint_2", "joint_3"), robot=SimpleNamespace(turns=[True] * 3))
    trial = SimpleNamespace(name="1", compared=np.arange(50) / 10)
    off = np.random.default_rng(0).standard_normal((50, 3))
    figure = torques_over_time(model, trial, {"before": off, "after": 0.5 * off})
    labelled = [ax for ax in figure.axes if ax.get_xlabel()]
    assert len(labelled) == 2 and all(ax.xaxis.get_tick_params()["labelbottom"] for ax in labelled)


def test_units_of_effects_on_the_robot_are_those_of_joints_that_turn_and_slide(tmp_path):
    pytest.importorskip("pinocchio")
    robot = Robot.read(urdf(tmp_path), locked={"j1": 0.0})  # two that turn, a finger that slides
    terms = on_robot(declare(robot, Base.of(robot), LAWS["coulomb_viscous"]()), ("compliance", "coupling"), None)
    assert {term.name: list(term.whole.parameters.values()) for term in terms} == {
        "compliance@joint_1": ["rad/(N*m)"], "compliance@joint_2": ["rad/(N*m)"], "compliance@joint_3": ["m/N"],
        "coupling@joint_1 (joint_2)": ["1"], "coupling@joint_2 (joint_1)": ["1"],
        "coupling@joint_2 (joint_3)": ["m"], "coupling@joint_3 (joint_2)": ["1/m"],
    }  # fmt: skip
