"""The closed loop: references, controller, plant, and arms from conf/control in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from axes import DELAY, DRIVE, RESOLUTION, TRUTH, WRONG, estimator, gains, plant
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.control import REFERENCES, Compensator, Controller, close, reference, tuned
from frictionpinn.control.build import build_compensator
from frictionpinn.control.compensator import dry_friction
from frictionpinn.control.pid import delay_margin
from frictionpinn.control.references import halted
from frictionpinn.errors import UserError
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

CONF = Path(__file__).resolve().parents[2] / "conf" / "control"
ARMS = sorted(path.stem for path in CONF.glob("*.yaml"))


def arm(name: str, mechanism: Mechanism = DRIVE, parameters: dict[str, float] | None = None) -> Compensator | None:
    config = yaml.safe_load((CONF / f"{name}.yaml").read_text(encoding="utf-8"))
    loop = {"interval": 1e-3, "delay": DELAY, "resolution": RESOLUTION}
    return build_compensator(config, mechanism, parameters or WRONG, **loop)


@pytest.mark.parametrize("name", [*REFERENCES, "halted sine"])
def test_velocity_and_acceleration_are_the_derivatives_of_a_reference_that_begins_at_rest(name):
    path = halted(reference("sine", 5e-3, 2.0), 1.0) if name == "halted sine" else reference(name, 5e-3, 2.0)
    t = np.arange(0, 4, 1e-4)
    q, v, a = path(t).T
    np.testing.assert_allclose(path(np.array([0.0]))[0, :2], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.diff(q) / 1e-4, (v[1:] + v[:-1]) / 2, atol=1e-4 * np.abs(v).max())
    np.testing.assert_allclose(np.diff(v) / 1e-4, (a[1:] + a[:-1]) / 2, atol=0.6 * np.abs(a).max())
    assert np.abs(np.cumsum(a)[-1] * 1e-4 - v[-1]) < 1e-2 * np.abs(v).max()
    if name == "halted sine":
        assert (v[t > 1.11] == 0).all()


@settings(max_examples=20, deadline=None)
@given(inertia=st.floats(1e-3, 1e3), dead_time=st.floats(5e-4, 2e-2))
def test_the_rule_keeps_the_sensitivity_that_it_promises(inertia, dead_time):
    found, w = tuned(inertia, dead_time), np.geomspace(1e-1, 3e4, 4000)
    s = 1j * w
    control = found.kp + found.ki / s + found.kd * s / (found.filter * s + 1)
    loop = control * np.exp(-s * dead_time) / (inertia * s**2)
    assert 1.2 < np.abs(1 / (1 + loop)).max() < 1.42


def test_a_limit_does_not_wind_up_the_integral():
    found = tuned(1.0, 3e-3, limit=1.0)
    controller = Controller(found, 1e-3)
    for _ in range(5000):
        assert controller.update(np.array([1.0, 1e-9, 0.0]), 0.0) == 1.0
    torques = [controller.update(np.array([0.0, 1e-9, 0.0]), 1e-3) for _ in range(50)]
    assert min(torques) < -0.5


def test_an_integral_rests_with_the_reference_where_the_error_is_within_the_dead_zone():
    controller = Controller(tuned(1.0, 3e-3, dead=2e-6), 1e-3)
    torques = [controller.update(np.zeros(3), 1e-6) for _ in range(100)]
    assert torques[0] == torques[-1]


def test_a_compensator_asked_from_python_closes_the_same_loop_as_the_compiled_one():
    class Plain:
        def __init__(self, inner: Compensator):
            self.update, self.reset = inner.update, inner.reset

    path = reference("sine", 5e-3, 1.0)
    compiled = close(plant(), gains(), path, 0.5, estimator(), (DRIVE, WRONG), delay=DELAY)
    plain = close(plant(), gains(), path, 0.5, Plain(estimator()), (DRIVE, WRONG), delay=DELAY)
    np.testing.assert_array_equal(compiled.position, plain.position)
    np.testing.assert_array_equal(compiled.added, plain.added)


@pytest.mark.parametrize("name", ARMS)
def test_every_arm_of_the_configuration_tracks_better_than_the_controller_alone(name):
    path, axis = reference("sine", 5e-3, 1.0), plant("asymmetry", asymmetry=0.1)
    alone = close(axis, gains(), path, 3.0, None, (DRIVE, WRONG), delay=DELAY)
    with_arm = close(axis, gains(), path, 3.0, arm(name), (DRIVE, WRONG), delay=DELAY)
    ratio = np.std(with_arm.error[1000:]) / np.std(alone.error[1000:])
    assert ratio == 1.0 if name == "none" else ratio < {"estimator": 0.1}.get(name, 0.6)


@pytest.mark.parametrize("seed", range(6))
def test_with_wrong_parameters_and_half_as_much_load_again_an_axis_comes_to_rest(seed):
    rng = np.random.default_rng(seed)
    wrong = {name: value * rng.choice([0.8, 1.2]) for name, value in TRUTH.items()}
    wrong["mu_s"] = max(wrong["mu_s"], wrong["mu_c"])
    path = halted(reference("sine", 5e-3, 1.0), 2.0)
    loop = close(
        plant(M=1.5, preload=1.5), gains(), path, 4.0, arm("estimator", DRIVE, wrong), (DRIVE, wrong), delay=DELAY
    )
    assert np.ptp(loop.position[loop.t > 3.0]) < 20 * RESOLUTION


def test_a_law_whose_parameters_were_not_identified_is_refused():
    viscous = Mechanism(SYSTEMS["drive"](), LAWS["coulomb_viscous"]())
    with pytest.raises(UserError, match="mu_s, v_s were not"):
        arm("stribeck", viscous, {"mu_c": 3.0, "sigma_2": 2.0})


def test_the_scale_of_an_arm_is_the_dry_friction_at_the_edge_of_sliding():
    assert dry_friction(DRIVE, TRUTH | {"preload": 2.0}) == pytest.approx(2 * TRUTH["mu_s"])


def test_a_delay_that_is_no_whole_number_of_half_cycles_is_refused():
    from dataclasses import replace

    with pytest.raises(UserError, match=r"multiples of 0\.0005 s"):
        close(replace(plant(), delay=1.2e-3), gains(), reference("sine", 5e-3, 1.0), 0.1)


@pytest.mark.parametrize(
    ("time", "said"),
    [
        ({"duration": 0.0}, "duration is 0.0; allowed: a number above 0"),
        ({"duration": "1 s"}, "duration is 1 s"),
        ({"duration": 1e-4}, "no cycle: duration is 0.0001; allowed: 0.001 s, a cycle, or more"),
        ({"interval": 0.0}, "interval is 0.0"),
    ],
)
def test_a_loop_without_a_cycle_is_refused(time, said):
    with pytest.raises(UserError, match=said):
        close(plant(), gains(), reference("sine", 5e-3, 1.0), **{"duration": 1.0, **time})


def test_an_unknown_reference_is_refused_with_the_nearest():
    with pytest.raises(UserError, match="did you mean 'triangle'"):
        reference("triangel", 1.0, 1.0)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("sine", "5", 1.0, {}), "reference.amplitude is 5; allowed: a finite number above 0"),
        (("sine", 5.0, float("inf"), {}), "reference.period is inf; allowed: a finite number above 0"),
        (("sine", 5.0, 1.0, {"phase": "a"}), "reference.phase is a; allowed: a finite number"),
        (("triangle", 5.0, 1.0, {"phase": 0.1}), "unknown option: reference.phase; allowed: none of a triangle"),
    ],
)
def test_a_reference_that_cannot_be_is_refused_in_one_line(given, said):
    with pytest.raises(UserError, match=said):
        reference(*given[:3], **given[3])


def test_a_triangle_that_would_turn_before_it_has_speed_is_refused():
    assert not reference("triangle", 5e-3, 0.08)(np.zeros(1))[0, :2].any()
    with pytest.raises(UserError, match=r"period is 0.07; allowed: 0.08 s or more: a turn takes 0.02 s"):
        reference("triangle", 5e-3, 0.07)


@pytest.mark.parametrize("seed", range(3))
def test_the_interval_holds_the_friction_and_is_narrow_beside_it(seed):
    axis, path = plant("asymmetry", asymmetry=0.1), reference("multisine" if seed else "sine", 5e-3, 1.0 + 0.3 * seed)
    loop = close(axis, gains(), path, 5.0, estimator(), (DRIVE, WRONG), delay=DELAY)
    late = loop.t > 2.0
    friction = np.interp(loop.t + DELAY + 5e-4, loop.t, loop.friction)  # when the torque acts
    held = np.mean((loop.low <= friction)[late] & (friction <= loop.high)[late])
    assert held > 0.85
    assert np.median(loop.high[late] - loop.low[late]) < 0.4 * np.median(np.abs(friction[late]))


@pytest.mark.parametrize(("share", "settles"), [(0.9, True), (1.1, False)])
def test_a_controller_bears_as_much_more_delay_as_its_margin_says_and_no_more(share, settles):
    h, dead_time = 1e-4, 3e-3  # s; of which 1 ms is the low-pass, 0.05 ms half of the hold
    gains = tuned(1.0, dead_time)
    controller = Controller(gains, h)
    late = round((dead_time - 1e-3 - h / 2 + share * delay_margin(gains, dead_time)) / h)
    pending, q, v, found = [0.0] * (late + 1), 1e-3, 0.0, []
    for _ in range(40_000):
        pending = [controller.update(np.zeros(3), q), *pending[:-1]]
        q, v = q + h * v + h * h / 2 * pending[-1], v + h * pending[-1]
        found.append(abs(q))
    assert (max(found[-5000:]) < 0.1 * max(found[5000:10_000])) == settles
