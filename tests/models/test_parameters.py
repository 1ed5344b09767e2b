"""Trainable law parameters: physical whatever the training does to them."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.errors import UserError
from frictionpinn.models.parameters import LawParameters
from frictionpinn.physics import LAWS

START = {"sigma_0": 5e4, "sigma_1": 200.0, "sigma_2": 1.0, "mu_c": 0.2, "mu_s": 0.4, "v_s": 5e-3}
BOUNDS = {
    "sigma_0": (1e3, 1e6),
    "sigma_1": (1.0, 1e4),
    "sigma_2": (0.01, 10.0),
    "mu_c": (0.05, 0.5),
    "mu_s": (0.1, 1.0),
    "v_s": (1e-4, 0.1),
}


def parameters(**options) -> LawParameters:
    return LawParameters(LAWS["lugre"](), **({"start": START, "bounds": BOUNDS} | options))


def assert_physical(values: dict[str, torch.Tensor]) -> None:
    for name, (low, high) in BOUNDS.items():
        assert low * (1 - 1e-5) <= values[name].item() <= high * (1 + 1e-5), name
    assert values["mu_s"].item() >= values["mu_c"].item()


def test_training_starts_where_it_is_told_to():
    for name, value in parameters()().items():
        assert value.item() == pytest.approx(START.get(name, 2.0), rel=1e-5)


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(st.lists(st.floats(-1e6, 1e6, width=32), min_size=6, max_size=6), min_size=1, max_size=5),
    lr=st.sampled_from([1e-3, 1.0, 1e3]),
)
def test_wild_gradient_steps_leave_them_physical(steps, lr):
    law = parameters()
    optimizer = torch.optim.SGD(law.parameters(), lr=lr)
    for gradients in steps:
        for raw, gradient in zip(law.parameters(), gradients, strict=True):
            raw.grad = torch.full_like(raw, gradient)
        optimizer.step()
        assert_physical(law())
    total = sum(torch.log(value) for value in law().values())
    total.backward()
    assert all(torch.isfinite(raw.grad) for raw in law.parameters())


def test_tied_damping_follows_the_stiffness_and_is_not_trained():
    law = parameters(tie_sigma1=True)
    assert "sigma_1" not in law.raw
    for shift in (0.0, 2.0):
        with torch.no_grad():
            law.raw["sigma_0"].add_(shift)
        values = law()
        assert values["sigma_1"].item() == pytest.approx(values["sigma_0"].item() ** 0.5, rel=1e-6)
    assert list(values) == [par.name for par in LAWS["lugre"].parameters]


def test_fixed_values_stay_and_have_no_gradient():
    law = parameters(fixed={"alpha": 2.0, "v_s": 1e-3})
    assert float(law()["v_s"]) == pytest.approx(1e-3) and "v_s" not in law.raw
    assert float(law()["alpha"]) == 2.0


def test_a_start_on_its_bound_can_still_move():
    law = parameters(start={**START, "sigma_0": BOUNDS["sigma_0"][0]})
    law()["sigma_0"].backward()
    assert float(law.raw["sigma_0"].grad) > 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": {**START, "mu_s": 0.15}}, "static below Coulomb.*friction.start.mu_s is 0.15; .*mu_c = 0.2"),
        ({"start": {**START, "mu_c": -0.1}}, "friction.start.mu_c is -0.1; allowed: above 0"),
        ({"start": {**START, "mu_c": 0.01}}, "friction.start.mu_c is 0.01; allowed: 0.05 to 0.5"),
        ({"start": {**START, "sigma_3": 1.0}}, "friction.start.sigma_3 is 1.0; allowed: sigma_0"),
        ({"start": {**START, "sigma_0": 1e9}}, "friction.start.sigma_0 is 1000000000.0; allowed: 1000 to 1e"),
        ({"bounds": {**BOUNDS, "mu_c": (0.5, 0.1)}}, r"impossible bounds: friction.bounds.mu_c is \[0.5, 0.1\]"),
        ({"bounds": {**BOUNDS, "v_s": (0.0, 0.1)}}, "impossible bounds: friction.bounds.v_s"),
        ({"fixed": {"alpha": -2.0}}, "friction.fixed.alpha is -2.0"),
    ],
)
def test_unphysical_settings_are_named(options, message):
    with pytest.raises(UserError, match=message):
        parameters(**options)


def test_parameters_can_be_moved_to_other_values_inside_their_bounds():
    law = parameters(fixed={"sigma_1": 300.0})
    law.place({**START, "sigma_0": 2e5, "mu_c": 0.3, "v_s": 1e3})
    values = law()
    assert values["sigma_0"].item() == pytest.approx(2e5, rel=1e-4) and values["sigma_1"].item() == 300.0
    assert values["mu_c"].item() == pytest.approx(0.3, rel=1e-4) and values["mu_s"].item() == pytest.approx(
        0.4, rel=1e-3
    )
    assert 0.09 < values["v_s"].item() <= BOUNDS["v_s"][1]
