"""What stands out in a fleet, and how many lack what."""

import numpy as np
import pytest

from frictionpinn.workflow.fleet import FEWEST, Member, counts, line, page, stand_out


def result(mu_c=1.0, effects=(), after=0.02, reach=0.01):
    return {
        "robot": {},
        "effects": [{"name": name} for name in effects],
        "unexplained": {},
        "torque_error": {"run": {"before": [0.05], "after": [after], "held_out": True}},
        "parameters": {"joint_1.mu_c": {"value": mu_c, "ci95": [mu_c - reach, mu_c + reach], "told": True}},
    }


def fleet(*extra, count=30):
    rng = np.random.default_rng(0)
    usual = [result(1 + 0.05 * x, after=0.02 + 0.001 * y) for x, y in rng.standard_normal((count, 2))]
    return stand_out([Member(f"log_{k}", str(k), "", r) for k, r in enumerate([*usual, *extra])])


def test_a_fleet_that_is_all_alike_has_nothing_that_stands_out():
    assert not any(m.stands_out for m in fleet())


@pytest.mark.parametrize(
    ("odd", "said"),
    [
        (result(mu_c=1.6), "joint_1.mu_c 1.6, the fleet's median"),
        (result(after=0.2), "error on held-out trials 0.2"),
        (result(effects=["delay@joint_1"]), "delay@joint_1, in 1 of 31"),
    ],
)
def test_what_differs_stands_out_alone(odd, said):
    *others, last = fleet(odd)
    assert not any(m.stands_out for m in others)
    assert any(why.startswith(said) for why in last.stands_out)


def test_what_its_own_interval_covers_does_not_stand_out():
    assert not fleet(result(mu_c=1.6, reach=0.8))[-1].stands_out


def test_few_recordings_tell_no_spread():
    assert not any(m.stands_out for m in fleet(result(mu_c=9.0), count=FEWEST - 2))


def test_effects_are_counted_by_joint():
    made = fleet(result(effects=["load_friction@joint_2", "payload"]), result(effects=["load_friction@joint_3"]))
    assert counts(made) == {"load_friction": {"joint_2": 1, "joint_3": 1}, "payload": {"": 1}}
    assert "load friction" in page(made, counts(made))


def test_a_result_is_told_in_a_line():
    assert line(result(effects=["drift@joint_1"])) == "drift@joint_1; error 5 % -> 2 %"
    plain = {"effects": [], "unexplained": None, "error": {"before": 1.5, "after": 1.2, "unit": "N*m"}}
    assert line(plain) == "nothing missing; error 1.5 N m -> 1.2 N m"
