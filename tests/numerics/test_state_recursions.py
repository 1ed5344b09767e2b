"""Bristles in parallel: their gradient, their energy, and LuGre friction as a special case."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.evaluate.in_motion import simulate_in_motion
from frictionpinn.models.elements import StateFriction
from frictionpinn.numerics.parallel_bristles import stretch
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.numerics.state_function import Drive, Recursion
from frictionpinn.numerics.torch_functions import contact_signals, motion_feedback
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

GRID = np.array([0.01, -4.0, 0.5, 8.0, 2.0])
LUGRE = {"sigma_0": 1e5, "sigma_1": 316.23, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3}


def drive(n: int, mobility: float, steps: int = 3, anew: float = 1.0, pulled: bool = False) -> Drive:
    rng, t = np.random.default_rng(0), np.arange(n) * 0.01
    v = 0.3 * np.sin(9 * t) + 0.05 * rng.standard_normal(n)
    start = np.zeros(n)
    start[0], start[n // 2] = 1.0, anew
    # the load stays: its share of a step is held in the gradient
    rest = (np.roll(v, 3), 20 * rng.standard_normal((n, 2))) if pulled else ()
    return Drive(v, np.full(n, 10.0), np.full(n, 0.01), start, rng.random(n), mobility, steps, *rest)


@pytest.mark.parametrize("mobility", [0.0, 0.5])
@pytest.mark.parametrize("damping", [5.0, 500.0])
@pytest.mark.parametrize("anew", [1.0, 0.4])
@pytest.mark.parametrize("pulled", [False, True])
@pytest.mark.parametrize("reach", [1e-3, 1e-5])
def test_the_hand_derived_gradient_agrees_with_differences(mobility, damping, anew, pulled, reach):
    rng, n, K = np.random.default_rng(1), 40, 2
    tables = reach * (0.5 + rng.random((K + 1, 17, 3)))
    tables[K] /= reach
    elements = np.array([[500.0, 300.0], [damping, 40.0], [0.0, 0.002], [1.0, 2.3]])
    acceleration = 3 * np.cos(0.09 * np.arange(n))
    known = [
        1e-3 * rng.standard_normal((2, K)),
        tables,
        elements,
        np.array(0.3),
        acceleration,
        np.array([[0.01, 0.003], [-0.02, 0.01]]),
    ]
    leaves = [torch.tensor(value, requires_grad=True) for value in known]
    along = drive(n, mobility, anew=anew, pulled=pulled)

    def scalar(*values: torch.Tensor) -> torch.Tensor:
        force, slip, _, left = Recursion.apply(*values, GRID, along)
        return (force * torch.arange(n) / n).sum() + (slip**2).sum() + (left**2 * torch.arange(n)).sum()

    slopes = torch.autograd.grad(scalar(*leaves), leaves)
    for place, (leaf, slope) in enumerate(zip(leaves, slopes, strict=True)):
        way = torch.from_numpy(rng.standard_normal(leaf.shape)) * leaf.detach().abs()
        ends = []
        for sign in (1, -1):
            moved = [value.detach() for value in leaves]
            moved[place] = moved[place] + sign * 1e-6 * way
            ends.append(float(scalar(*moved).detach()))
        difference = (ends[0] - ends[1]) / 2e-6
        assert float((slope * way).sum()) == pytest.approx(difference, rel=2e-3, abs=1e-3)


def test_a_start_that_carries_all_on_leaves_the_motion_as_it_is():
    rng, n, K = np.random.default_rng(1), 40, 2
    tables, elements = 1e-3 * (0.5 + rng.random((K + 1, 17, 3))), np.array([[500.0, 300.0], [5.0, 4.0], [0, 0], [1, 1]])
    rest = [torch.from_numpy(x) for x in (tables, elements, np.array(0.0), 3 * np.cos(0.09 * np.arange(n)))]
    z0, off = torch.zeros((2, K), dtype=torch.float64), torch.zeros(2, 2, dtype=torch.float64)
    told = [Recursion.apply(z0, *rest, off, GRID, drive(n, 0.5, anew=anew))[1].numpy() for anew in (1e-12, 0.3, 1.0)]
    whole = Recursion.apply(z0[:1], *rest, off[:1], GRID, drive(n, 0.5, anew=0.0))[1].numpy()
    np.testing.assert_allclose(told[0], whole, atol=1e-9)
    half = n // 2
    measured = drive(n, 0.5).v[half]
    assert told[1][half] == pytest.approx(0.3 * measured + 0.7 * whole[half])
    assert told[2][half] == pytest.approx(measured)


def friction(values: dict[str, float]) -> StateFriction:
    """LuGre friction as one bristle."""
    v0, u = 3e-4, np.linspace(-9, 9, 161)
    v, N = v0 * np.sinh(u), np.array([2.0, 30.0])
    share = values["mu_c"] + (values["mu_s"] - values["mu_c"]) * np.exp(-((v / values["v_s"]) ** 2))
    T = np.repeat((share / values["sigma_0"])[:, None], 2, axis=1)
    tables = np.stack([T, np.full_like(T, values["sigma_2"])])
    return StateFriction(tables, np.array([v0, u[0], u[1] - u[0], N[0], 28.0]),
                         np.array([[values["sigma_0"]], [values["sigma_1"]], [0.0], [1.0]]))  # fmt: skip


def test_one_bristle_moves_a_drive_as_lugre_friction_does():
    t = np.arange(400) / 400.0
    system = SYSTEMS["drive"](M=2.0)
    values = LUGRE | {"mu_c": 3.0, "mu_s": 4.0, "sigma_0": 2e4, "sigma_1": 150.0, "v_s": 5e-3}
    force = 8.0 * np.sin(2 * np.pi * 2 * t)
    run = Simulator(Mechanism(system, LAWS["lugre"]())).simulate(t, {"force": force}, values, z0=0.0)
    model = friction(values)
    along = Drive(np.zeros(400), np.full(400, 1.0), np.full(400, 1 / 400), np.eye(400)[0], np.zeros(400), 0.5, 4)
    zeros = torch.zeros(1, dtype=torch.float64)
    told, slip, *_ = Recursion.apply(
        zeros[None], torch.from_numpy(model.tables), torch.from_numpy(model.elements), zeros[0],
        torch.from_numpy(force / 2.0), torch.zeros(1, 2, dtype=torch.float64), model.grid, along,
    )  # fmt: skip
    assert np.abs(slip.numpy() - run.signals["v"]).max() < 1e-3 * np.abs(run.signals["v"]).max()
    assert np.sqrt(np.mean((told.numpy() - run.F) ** 2)) < 0.01 * np.sqrt(np.mean(run.F**2))


def test_a_simulation_from_a_motion_begins_with_bristles_as_steady_sliding_leaves_them():
    system, model = SYSTEMS["drive"](M=2.0), friction(LUGRE | {"sigma_0": 2e4, "v_s": 5e-3})
    path = InputPath.from_signals(Mechanism(system, LAWS["coulomb"]()), np.arange(5) / 400.0, {"force": np.zeros(5)})
    for speed in (0.5, -0.5, 0.0):
        run = simulate_in_motion(system, model, path, {"v": speed})
        assert run.z[0] == model.settled(speed, run.N[0])[0]
        assert np.sign(run.z[0]) == np.sign(speed)


@settings(deadline=None, max_examples=200)
@given(
    before=st.floats(-3.0, 3.0),
    speed=st.floats(-1e4, 1e4),
    sharpness=st.floats(1.0, 40.0),
    gap=st.sampled_from([0.0, 0.3]),
)
def test_a_bristle_moves_towards_where_it_settles_however_far_it_slips_in_a_step(before, speed, sharpness, gap):
    """In reaches: from ``before`` towards that of its direction, and no further."""
    reach, load, seconds = 1e-3, 10.0, 0.01
    tables = np.full((2, 17, 3), (1 - gap) * reach / load)
    elements = np.array([[500.0], [5.0], [gap * reach], [sharpness]])
    z = np.array([before * reach])
    stretch(speed * reach / seconds, load, 0.0, z, tables, GRID, elements, seconds)
    low, high = sorted([before, float(np.sign(speed)) if speed else before])
    assert low - 1e-9 <= z[0] / reach <= high + 1e-9


@settings(deadline=None, max_examples=10)
@given(
    mu_c=st.floats(0.001, 0.04),
    sigma_2=st.floats(0.0, 0.02),
    off=st.tuples(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)),
)
def test_gravity_acts_back_on_a_pendulum_that_leaves_the_measured_motion(mu_c, sigma_2, off):
    """Along the motion of a pendulum with other friction, begun elsewhere: it swings as it does with its own."""
    t, system, bristle = np.arange(800) / 400.0, SYSTEMS["pendulum"](), {"sigma_0": 5.0, "sigma_1": 0.01, "v_s": 0.1}
    values = bristle | {"mu_c": mu_c, "mu_s": 1.2 * mu_c, "sigma_2": sigma_2}
    pendulum, start = Simulator(Mechanism(system, LAWS["lugre"]())), {"theta": np.pi - 0.5, "omega": 0.0}
    measured = pendulum.simulate(t, {}, values | {"mu_c": 0.02, "mu_s": 0.02, "sigma_2": 0.0}, start).signals
    there = {"theta": start["theta"] + off[1], "omega": start["omega"] + off[0]}
    true = pendulum.simulate(t, {}, values, there).signals
    seen, model, mobility = contact_signals(system, measured), friction(values), 1 / (0.02 + 1.0 * 0.5**2)
    along = Drive(seen["v_slip"], np.full(800, 2.0), np.full(800, 1 / 400), np.eye(800)[0], np.zeros(800), mobility, 4,
                  seen["v_slip"], motion_feedback(system, measured))  # fmt: skip
    tables = model.tables * np.array([0.5, 1.0])[:, None, None]  # under a load of 2, where the preload is 1
    zeros = torch.zeros(1, dtype=torch.float64)
    _, slip, _, away = Recursion.apply(
        zeros[None], torch.from_numpy(tables), torch.from_numpy(model.elements), zeros[0],
        torch.from_numpy(seen["a_frictionless"].copy()), torch.tensor([off]).double(), model.grid, along,
    )  # fmt: skip
    left = np.abs(true["omega"] - measured["omega"]).max()
    assert np.abs(slip.numpy() - true["omega"]).max() < 0.05 * left + 1e-3
    aside = true["theta"] - measured["theta"]
    assert np.abs(away.numpy() - aside).max() < 0.05 * np.abs(aside).max() + 1e-3


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 10_000),
    elements=st.integers(1, 3),
    speed=st.floats(1e-3, 1.0),
    damping=st.floats(0.0, 300.0),
    sharpness=st.floats(1.0, 6.0),
)
def test_no_closed_cycle_of_motion_gives_energy(seed, elements, speed, damping, sharpness):
    """Random positive tables: over every cycle the work is the change of what the bristles store, or more."""
    rng = np.random.default_rng(seed)
    tables = 1e-3 * np.exp(rng.standard_normal((elements + 1, 17, 3)))
    rows = np.array([np.exp(rng.normal(6, 1, elements)), np.full(elements, damping),
                     1e-3 * rng.random(elements), np.full(elements, sharpness)])  # fmt: skip
    model, n = StateFriction(tables, GRID, rows), 4000
    phase = np.arange(n + 1) / n * 2 * np.pi
    v = speed * (np.sin(phase) + 0.5 * rng.standard_normal() * np.sin(3 * phase))
    N, h = 10 + 2 * np.cos(phase), 0.5 / n
    z, work = np.zeros(elements), []
    for _ in range(2):  # the second cycle begins where the first ended
        stored = [0.5 * np.sum(rows[0] * np.maximum(np.abs(z) - rows[2], 0.0) ** 2)]
        done = 0.0
        for k in range(n):
            F, *rate = model.rates(0.5 * (v[k] + v[k + 1]), N[k], z)
            done += F * 0.5 * (v[k] + v[k + 1]) * h
            reach = model.reach(0.5 * (v[k] + v[k + 1]), N[k])
            z = np.clip(z + h * np.array(rate), -np.maximum(reach, np.abs(z)), np.maximum(reach, np.abs(z)))
        stored.append(0.5 * np.sum(rows[0] * np.maximum(np.abs(z) - rows[2], 0.0) ** 2))
        work.append(done - (stored[1] - stored[0]))
    scale = np.sum(rows[0] * 1e-3 * 10) * speed * 0.5
    assert min(work) > -2e-3 * scale


def test_a_bristle_that_carries_nothing_gives_no_number_and_no_error():
    n, K = 40, 1
    tables, elements = np.zeros((K + 1, 17, 3)), np.array([[500.0], [5.0], [0.0], [1.0]])
    rest = [
        torch.from_numpy(x) for x in (tables, elements, np.array(0.0), np.cos(0.09 * np.arange(n)), np.zeros((2, 2)))
    ]
    force, *_ = Recursion.apply(torch.zeros((2, K), dtype=torch.float64), *rest, GRID, drive(n, 0.5))
    assert torch.isnan(force).any()
