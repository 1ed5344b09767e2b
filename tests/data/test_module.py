"""The DataModule: splits by trial, one batch that stays where it is, held-out trials that influence nothing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frictionpinn.data.contact import BASE, backward_difference, contact_trials
from frictionpinn.data.module import TrajectoryData
from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.data.split import split_trials
from frictionpinn.errors import UserError
from frictionpinn.models.base import tensors
from frictionpinn.models.features import Features
from frictionpinn.models.start import data_scales
from frictionpinn.physics import SYSTEMS
from frictionpinn.workflow.build import SMOOTHING

TRUTH = {"sigma_0": 1e5, "sigma_1": 316.23, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3}
SIGNALS = ("x", "v", "a", "theta", "omega", "alpha")


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Three noisy swings of 0.5 s at 200 Hz."""
    swings = [{"duration": 0.5, "theta": f"{angle}*deg*sin(2*pi*t)"} for angle in (50, 55, 60)]
    return GaussianNoise(level=0.05)(simulate_recording(SYSTEMS["pob"](), "lugre", TRUTH, swings, 200.0), 0)


class Model:
    """What the DataModule asks of a model."""

    features = Features.from_config(["v_slip", "normal_force", "a_frictionless"], {"v_slip": [[1, 0], [8, 1]]})

    def arrays(self, trial, source):
        return tensors(trial, self.features, source)

    def fit_scales(self, batch):
        self.scaled_by = batch


def prepared(recording, smoothing="none", validation=(), steps=1) -> tuple[TrajectoryData, Model]:
    splits = split_trials(recording.names, None, validation)
    offline, online = (make() for make in SMOOTHING[smoothing])
    trials = contact_trials(recording, SYSTEMS["pob"](), offline, online, splits["train"])
    data, model = TrajectoryData(recording, trials, splits, steps), Model()
    data.prepare_for(model)
    return data, model


@given(names=st.lists(st.text("abc123", min_size=1, max_size=3), min_size=1, max_size=8, unique=True), data=st.data())
def test_every_trial_is_in_exactly_one_split(names, data):
    held = data.draw(st.none() | st.lists(st.sampled_from(names), unique=True, max_size=len(names) - 1))
    left = [name for name in names if name not in (names[-1:] if held is None else held)]
    valid = data.draw(st.lists(st.sampled_from(left), unique=True, max_size=len(left) - 1)) if left else []
    splits = split_trials(names, held, valid)
    assert sorted([*splits["train"], *splits["validation"], *splits["held_out"]]) == sorted(names) and splits["train"]
    if held is not None:
        assert sorted(splits["held_out"]) == sorted(held)


def test_the_last_of_several_trials_is_held_out_by_default():
    assert split_trials(["a", "b", "c"], None)["held_out"] == ["c"]
    assert split_trials(["a"], None) == {"train": ["a"], "validation": [], "held_out": []}
    assert split_trials(["1", "2"], [1])["train"] == ["2"]  # numbers of a configuration are names


@pytest.mark.parametrize(
    ("held", "valid", "message"),
    [
        (["4"], [], r"no such trial: data.held_out is 4; allowed: 1, 2, 3"),
        (["3"], ["33"], r"no such trial: data.validation is 33; .*did you mean '3'"),
        (["3"], ["3"], "splits overlap"),
        (["1", "2", "3"], [], "leave nothing to train on"),
        (["1"], ["2", "3"], "leave nothing to train on"),
    ],
)
def test_impossible_splits_are_named(held, valid, message):
    with pytest.raises(UserError, match=message):
        split_trials(["1", "2", "3"], held, valid)


def test_the_batch_is_the_training_trials_and_nothing_else(recording):
    data, model = prepared(recording, validation=["2"])
    batch = data.train_dataloader().batch
    assert {key: tuple(value.shape) for key, value in batch.items()} == {
        "x": (100, 5),
        "x_rate": (100, 5),
        **dict.fromkeys(("v", "N", "v_rate", "N_rate", "target"), (100, 1)),
    }
    assert all(value.dtype == torch.float32 for value in batch.values())
    np.testing.assert_allclose(batch["v"][:, 0], data.by_name["1"].offline["v_slip"], rtol=1e-6)
    np.testing.assert_allclose(batch["target"][:, 0], data.by_name["1"].offline["friction_force"], rtol=1e-5)
    np.testing.assert_allclose(data.val_dataloader().batch["v"][:, 0], data.by_name["2"].offline["v_slip"], rtol=1e-6)
    assert model.scaled_by is not None and len(model.scaled_by["x"]) == 100


def test_every_epoch_uses_the_same_batch_object(recording):
    data, _ = prepared(recording, steps=3)
    data.trainer = SimpleNamespace(strategy=SimpleNamespace(root_device=torch.device("cpu")))  # type: ignore
    loader = data.train_dataloader()
    items = [*loader, *loader]
    assert len(loader) == 3 and len(items) == 6
    assert all(item is items[0] for item in items)
    assert data.transfer_batch_to_device(items[0], torch.device("cpu"), 0) is items[0]
    assert data.train_dataloader().batch["x"].data_ptr() == items[0]["x"].data_ptr()


def test_no_validation_trials_no_validation_loader(recording):
    assert prepared(recording)[0].val_dataloader() == []


def test_less_than_one_step_an_epoch_is_refused(recording):
    with pytest.raises(UserError, match=r"data.steps_per_epoch is 0; allowed: at least 1"):
        prepared(recording, steps=0)


@pytest.mark.parametrize("smoothing", SMOOTHING)
def test_held_out_trials_influence_neither_smoothing_nor_scales(recording, smoothing):
    last = recording.trials[-1]
    noise = np.random.default_rng(0).normal(size=(len(SIGNALS), len(last)))
    wild = {name: 3 * last.signals[name][::-1] + row for name, row in zip(SIGNALS, noise, strict=True)}
    changed = replace(recording, trials=(*recording.trials[:-1], replace(last, signals=wild)))
    (one, _), (other, _) = prepared(recording, smoothing), prepared(changed, smoothing)
    before, after = one.train_dataloader().batch, other.train_dataloader().batch
    assert all(torch.equal(before[key], after[key]) for key in before)
    assert data_scales(one.select("train")) == data_scales(other.select("train"))
    assert not np.array_equal(one.by_name["3"].offline["v_slip"], other.by_name["3"].offline["v_slip"])


@pytest.mark.parametrize("smoothing", SMOOTHING)
def test_online_signals_never_look_ahead(recording, smoothing):
    first = recording.trials[0]
    later = {name: np.concatenate([values[:60], values[60:] + 1.0]) for name, values in first.signals.items()}
    trials = [first, replace(first, name="changed", signals=later)]
    system = SYSTEMS["pob"]()
    offline, online = (make() for make in SMOOTHING[smoothing])
    one, other = contact_trials(replace(recording, trials=tuple(trials)), system, offline, online, ["1"])
    for name in one.online:
        np.testing.assert_allclose(one.online[name][:60], other.online[name][:60], rtol=1e-9, atol=1e-9)
    for name in BASE:
        np.testing.assert_allclose(one.rates[name][:60], other.rates[name][:60], rtol=1e-9, atol=1e-7)


def test_clean_signals_give_back_the_true_force_and_contact():
    swing = [{"duration": 1.0, "theta": "57*deg*sin(2*pi*t)"}]
    clean = simulate_recording(SYSTEMS["pob"](), "lugre", TRUTH, swing, 400.0)
    (trial,) = contact_trials(clean, SYSTEMS["pob"](), *(make() for make in SMOOTHING["none"]), ["1"])
    for name in ("friction_force", "normal_force", "v_slip"):
        scale = np.abs(trial.truth[name]).max()
        np.testing.assert_allclose(trial.offline[name], trial.truth[name], atol=2e-3 * scale, err_msg=name)
    assert len(trial) == 400


def test_backward_difference_is_causal_and_exact_on_lines():
    t = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 20))
    np.testing.assert_allclose(backward_difference(t, 2 + 3 * t), np.full(20, 3.0))


def test_fewer_training_trials_are_spread_over_those_there_are():
    names = list("abcdef")
    assert split_trials(names, None, training=2)["train"] == ["b", "d"]
    assert split_trials(names, ["a"], training=1) == {"train": ["d"], "validation": [], "held_out": ["a"]}
    for count in (0, 6, True, 2.5):
        with pytest.raises(UserError, match="1 to 5"):
            split_trials(names, None, training=count)
