"""Networks with memory: what they learn, keep and tell; every variant of conf/model."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from frictionpinn.errors import UserError
from frictionpinn.evaluate.in_motion import simulate_in_motion
from frictionpinn.models import StateModel, rebuilt
from frictionpinn.models.segments import compares_position
from frictionpinn.models.state_start import discount
from frictionpinn.numerics.paths import InputPath
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.build import build_system
from frictionpinn.workflow.experiment import build_data, build_model
from frictionpinn.workflow.options import composed

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from networks_derived import SPEEDS, fitted, sliding, swing

VARIANTS = ("bb1", "bb2", "pe1", "pe2")


@pytest.fixture
def started(make):
    """A variant with a state."""
    return lambda name, **changes: make(name, memory="state", **changes)


@pytest.fixture
def stateful(started, monkeypatch):
    """The same without the search for a start, which takes seconds."""
    monkeypatch.setattr("frictionpinn.models.state.find_start", lambda model, batch: None)
    monkeypatch.setattr("frictionpinn.models.black_box_start.start_as_law", lambda model, batch: None)
    return started


@pytest.mark.parametrize("name", VARIANTS)
def test_gradients_are_finite_and_a_step_lowers_the_loss(stateful, batch, name):
    model = stateful(name)
    assert isinstance(model, StateModel)
    data = batch(model)
    before = model.losses(data)["loss"]
    before.backward()
    slopes = {key: p.grad for key, p in model.named_parameters() if p.grad is not None}
    assert slopes and all(torch.isfinite(slope).all() for slope in slopes.values())
    assert all(bool(slope.any()) for key, slope in slopes.items() if key.startswith(("law_parameters", "stiffness")))
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3)
    for _ in range(5):
        optimizer.zero_grad()
        model.losses(data)["loss"].backward()
        optimizer.step()
    assert float(model.losses(data)["loss"].detach()) < float(before.detach())


@pytest.mark.parametrize("name", VARIANTS)
def test_a_checkpoint_gives_the_same_force(stateful, data, name):
    model = stateful(name)
    with torch.no_grad():
        for p in model.parameters():
            p.add_(0.01 * torch.randn_like(p))
    again = rebuilt(dict(model.hparams))
    again.load_state_dict(model.state_dict())
    trial = data.select("held_out")[0]
    np.testing.assert_array_equal(model.predict_trial(trial)["force"], again.predict_trial(trial)["force"])


def test_a_model_is_trained_through_the_motion_where_it_moves_the_contact_or_where_told(stateful):
    assert [stateful(name).through for name in VARIANTS] == ["balance", "motion", "balance", "motion"]
    assert stateful("bb2", loss={"through": "balance"}).through == "balance"
    assert stateful("bb1", loss={"through": "motion"}).through == "motion"


def test_an_imposed_motion_is_no_motion_to_train_through(stateful):
    model = stateful("bb1")
    with pytest.raises(UserError, match=r"model.loss.through"):
        StateModel(**dict(model.hparams) | {"loss": {"force": "normalised", "through": "motion"},
                                            "scales": model.scales | {"mobility": 0.0}})  # fmt: skip


def test_the_force_now_does_not_depend_on_what_comes_later(stateful, data):
    model, trial = stateful("pe2"), data.select("held_out")[0]
    whole = model.predict_trial(trial)["force"]
    arrays = {name: torch.from_numpy(x[:120]) for name, x in model.arrays(trial).items()}
    with torch.no_grad():
        part = model.predict(arrays)["force"].squeeze(-1).numpy()
    np.testing.assert_allclose(part[:-1], whole[:119], rtol=1e-9)


def test_a_trial_is_started_anew_where_it_slides_fastest(stateful, data, batch):
    model, trial = stateful("pe2"), data.select("train")[0]
    first = np.flatnonzero(model.arrays(trial, "offline")["start"])
    assert len(first) > 1 and first[0] == 0
    speed = np.abs(trial.offline["v_slip"])
    assert all(speed[k] >= speed[max(k - 3, 0) : k + 4].max() for k in first[1:])
    assert sum(model.lengths) == len(trial)


def test_a_network_beside_a_law_leaves_to_it_what_the_law_can_say(stateful, data):
    model = stateful("pe2")
    arrays = [model.arrays(trial, "offline") for trial in data.select("train")]
    model.fit_scales({name: torch.from_numpy(np.concatenate([x[name] for x in arrays])) for name in arrays[0]})
    before = model.friction().tables[0]
    with torch.no_grad():
        model.network[-1].bias += 0.1  # as a larger mu_c
    np.testing.assert_allclose(model.friction().tables[0], before, rtol=1e-4)
    with torch.no_grad():
        model.network[-1].weight += 0.1  # of another shape
    v, N = model.knots[:, 0].abs(), model.knots[:, 1]
    departure = np.log(model.friction().tables[0] / before).ravel()
    met = model.met.numpy()
    assert np.sqrt(met @ departure**2) > 1e-4
    viscous = (v / N).numpy() / before.ravel()
    assert abs(met @ (departure * viscous)) < 1e-3 * np.sqrt((met @ departure**2) * (met @ viscous**2))


def test_a_motion_without_noise_can_be_trained_through_by_its_slip_alone(stateful, batch):
    model = stateful("bb1")
    clean = model.scales | {"force_noise": 0.0, "input_error": 0.0}
    told = StateModel(**dict(model.hparams) | {"loss": {"force": "normalised", "through": "motion"}, "scales": clean})
    assert told.through == "motion" and set(told.losses(batch(told))) == {"slip", "inputs", "consistency", "loss"}
    assert StateModel(**dict(model.hparams) | {"name": "bb2", "scales": clean}).through == "balance"


def test_a_rounded_stop_does_not_count_as_noise_of_the_force(data):
    from frictionpinn.data.input_noise import input_noise
    from frictionpinn.numerics.kalman import KalmanSmoother

    train = data.select("train")
    told = input_noise(data.recording, SYSTEMS["pob"](), KalmanSmoother(), train)
    noise = np.concatenate([t.seen["friction_force"] - t.truth["friction_force"] for t in train])
    assert told["force_noise"] == pytest.approx(np.sqrt(np.mean(noise**2)), rel=0.05)


def test_a_smooth_acceleration_gives_the_velocity_of_a_smooth_curve(stateful, data):
    trial = data.select("train")[0]
    w = 2 * np.pi / (10 * float(trial.t[1] - trial.t[0]))  # ten samples a period
    swung = replace(trial, offline={**trial.offline, "a_frictionless": np.cos(w * trial.t)})
    model, n = stateful("bb2"), len(trial.t) - 1
    missed = {}
    for source, table in {"smoothed": model.arrays(swung, "offline")["A"][:, 0], "raw": np.cos(w * trial.t)}.items():
        velocity = np.cumsum(0.5 * (table[1:] + table[:-1]) * np.diff(trial.t))
        wanted = (np.sin(w * trial.t) - np.sin(w * trial.t[0])) / w
        missed[source] = np.abs(velocity - wanted[1:])[5 : n - 5].max()
    assert missed["smoothed"] < 0.2 * missed["raw"]


def test_a_stiffer_bristle_slides_under_the_same_force(stateful):
    model = stateful("bb2", state={"elements": 2, "gaps": False, "delay": False})
    v, N = np.array([-0.4, 0.1, 0.5]), np.array([8.0, 14.0, 20.0])
    before = model.friction().steady(v, N)
    with torch.no_grad():
        model.stiffness += 1.0
    np.testing.assert_allclose(model.friction().steady(v, N), before, rtol=1e-4)


def test_stiffness_and_damping_are_trained_with_the_step_size_of_physical_parameters(stateful):
    model = stateful("bb2")
    network, physical = model.configure_optimizers().param_groups
    assert {id(p) for p in physical["params"]} == {id(p) for p in (model.stiffness, model.damping, model.sharp)}
    assert physical["lr"] == pytest.approx(model.optimizer_config["lr_physical"])
    assert physical["lr"] != network["lr"]


@pytest.mark.parametrize("elements", [0, 1.5, "two", True])
def test_an_impossible_number_of_bristles_is_told(stateful, elements):
    with pytest.raises(UserError, match=r"model.state.elements"):
        stateful("bb2", state={"elements": elements})


def test_a_start_of_a_black_box_that_there_is_not_is_refused(stateful):
    with pytest.raises(UserError, match=r"model.state.start"):
        stateful("bb2", state={"start": "lugre"})


def test_a_black_box_starts_where_a_law_makes_the_motion_as_likely_as_its_noise_allows(started, batch):
    told, flat = (started("bb2", state={"elements": 1, "start": start}) for start in ("law", "reach"))
    data = batch(told)  # the searches again, from where they ended
    assert told.loss_now(data) < 2.2 < flat.loss_now(data)  # a mean square over the noise for each of slip and force
    v, N = np.array([0.0, 5e-4, 0.1, 0.4]), np.full(4, 15.0)
    friction = told.friction()
    share = friction.elements[0, 0] * np.array([friction.reach(*pair)[0] for pair in zip(v, N, strict=True)]) / N
    assert share[2:] == pytest.approx(0.3, rel=0.02) and 0.35 < share[0] < 1.2
    assert told.physical() == {}  # and names nothing


def test_bristles_side_by_side_start_as_the_one_that_is_known(stateful):
    from frictionpinn.models.black_box_start import begin_as

    known = stateful("pe2").friction()
    model = stateful("bb2", state={"elements": 3, "gaps": False, "delay": False})
    begin_as(model, known)
    v, N = np.array([-0.4, 0.01, 0.1, 0.5]), np.array([8.0, 14.0, 14.0, 20.0])
    np.testing.assert_allclose(model.friction().steady(v, N), known.steady(v, N), rtol=2e-3)
    np.testing.assert_allclose(model.friction().elements[:2].sum(axis=1), known.elements[:2, 0], rtol=1e-4)


def test_a_start_far_off_is_left_for_one_where_the_law_fits_the_motion(started):
    near = {"sigma_0": 1e5, "sigma_1": 316.23, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3}
    bounds = {name: [value / 4, 4 * value] for name, value in near.items()}
    off = {"sigma_0": 3e5, "sigma_1": 90.0, "sigma_2": 0.2, "mu_c": 0.2, "mu_s": 0.25, "v_s": 3e-3}
    model = started("pe2", friction={"start": off, "bounds": bounds})
    found = model.physical()
    assert float(model.carried) == 1.0  # its law explains whole trials
    assert float(model.departs) == 0.0  # and leaves nothing to the network
    assert found["mu_c"] == pytest.approx(0.3, rel=0.02)
    assert found["sigma_0"] == pytest.approx(1e5, rel=0.4)
    assert found["sigma_1"] == pytest.approx(316.23, rel=0.4)


def test_a_law_that_explains_segments_and_not_whole_trials_is_fitted_to_segments(stateful, batch):
    from frictionpinn.models.state_start import find_start

    model = stateful("pe2", friction={"fixed": {"mu_s": 0.6, "v_s": 1e-3}})
    kicked = dict(batch(model))
    first = int(np.flatnonzero(kicked["start"][:, 0] == 2.0)[0])
    kicked["A"] = kicked["A"].clone()
    kicked["A"][first - 6 : first] += 3.0  # something pushes that is in no equation
    find_start(model, kicked)
    assert float(model.carried) == 0.0
    assert model.physical()["mu_c"] == pytest.approx(0.3, rel=0.05)


def test_a_network_departs_from_its_law_where_the_motion_tells_of_friction_that_the_law_cannot_say(stateful, batch):
    from frictionpinn.models.state_start import find_start

    model = stateful("pe2", friction={"fixed": {"mu_s": 0.6, "v_s": 1e-3}})
    resisted = dict(batch(model))
    v = resisted["seen_v"]
    resisted["A"] = resisted["A"] - 4.0 * v * v.abs()  # m/s^2: a drag that is in no equation
    find_start(model, resisted)
    assert float(model.departs) == 1.0
    assert float(model.tables()[2].detach().abs().max()) == 0.0  # it begins at rest


def test_a_network_without_a_say_changes_nothing(stateful):
    model = stateful("pe2")
    model.departs.fill_(0.0)
    v, N = np.linspace(0.05, 0.5, 5), np.full(5, 15.0)
    before = model.friction().steady(v, N)
    with torch.no_grad():
        for p in model.network.parameters():
            p.add_(0.1 * torch.randn_like(p))
    np.testing.assert_array_equal(model.friction().steady(v, N), before)


def test_a_parameter_that_is_fixed_stays_where_it_is_said_to_be(started):
    model = started("pe2", friction={"fixed": {"v_s": 2e-3}})
    assert model.physical()["v_s"] == pytest.approx(2e-3)


def test_friction_that_departs_from_proportion_to_the_load_costs_a_black_box(stateful, batch):
    model = stateful("bb2")
    data = batch(model)
    assert float(model.losses(data)["consistency"].detach()) == 0.0
    with torch.no_grad():
        model.network[-1].weight.add_(0.1)  # type: ignore[operator]
    told = model.tables()[2].detach().numpy().reshape(81, 3, -1)
    wanted = 10000.0 * np.mean((told - told.mean(axis=1, keepdims=True)) ** 2)
    assert float(model.losses(data)["consistency"].detach()) == pytest.approx(wanted, rel=1e-4) and wanted > 0


def test_a_step_beyond_what_numbers_hold_is_made_again_shorter():
    # As on the measured pendulum, where a departure so far from the law left a bristle that carries nothing.
    from frictionpinn.models.state_start import _fit

    class Overflowing(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.network = torch.nn.Parameter(torch.zeros(1, dtype=torch.float64))

        def losses(self, batch):
            return {
                "loss": 10
                - self.network.sum()
                + 1e-3 * torch.where(self.network < 20, self.network.exp(), torch.nan).sum()
            }

    model = Overflowing()
    _fit(model, {"v": torch.zeros(1)}, ("network",), 50)
    assert float(model.network.detach()) == pytest.approx(np.log(1e3), abs=1e-2)


def test_a_pendulum_s_simulated_motion_has_its_own_gravity():
    """A whole swing with more friction than the measured one had is that of the mechanism with more friction."""
    options = ["experiment=memory", "model=pe1", "model.loss.through=motion", "system=pendulum", "noise=none",
               "smoothing=none", "data.training_trials=1"]  # fmt: skip
    cfg = composed("train", options)
    system = build_system(cfg["system"])
    data = build_data(cfg, system)
    model, (trial,) = build_model(cfg, system, data), data.select("train")
    batch = {key: torch.from_numpy(x) for key, x in model.arrays(trial, "offline").items()}
    model.carried.fill_(1.0)
    model.departs.fill_(0.0)
    truth = cfg["data"]["truth"]
    model.law_parameters.place(truth | {name: 1.05 * truth[name] for name in ("mu_c", "mu_s")})
    start = {name: float(trial.measured[name][0]) for name in ("theta", "omega")}
    path = InputPath.from_signals(Mechanism(system, LAWS["lugre"]()), trial.t, trial.measured)
    own = simulate_in_motion(system, model.friction(), path, start).signals["omega"]
    told = model._along(batch, True, 0.0, True)["slip"].detach().numpy()
    left = np.sqrt(np.mean((own - trial.measured["omega"]) ** 2))
    assert np.sqrt(np.mean((told - own) ** 2)) < 0.1 * left


@pytest.fixture
def swinging(tmp_path):
    """A law that is fitted through a pendulum's motion, its rate differentiated from an angle that an encoder's play
    shifts at every reversal by a tenth of a milliradian; and the true one."""
    own = {"m": 1.0, "l": 0.5, "J": 0.02}
    law = {"mu_c": 0.02, "mu_s": 0.02, "v_s": 0.01, "sigma_0": 40.0, "sigma_1": 0.1, "sigma_2": 0.0}
    path = swing(own, law, first=0.7, play=1e-4).save(tmp_path / "swing.csv")
    return lambda compared: (*fitted(path, own, compared), law)


def test_friction_beside_a_velocity_that_was_differentiated_is_told_by_the_position(swinging):
    """Coulomb friction comes out half as large again at slow slip by the velocity: by the position it does not."""
    off = {}
    for compared in ("velocity", "position"):
        model, found, true = swinging(compared)
        assert (model.scales["position_noise"] > 0) == (compared == "position")
        off[compared] = np.abs(sliding(found, SPEEDS) / sliding(true, SPEEDS) - 1).max()
    assert off["position"] < 0.05
    assert off["velocity"] > 0.2


def test_what_is_compared_follows_from_what_was_measured(data):
    trials, pob = data.select("train"), SYSTEMS["pob"]()
    assert not compares_position(None, trials, pob)
    assert compares_position(None, [replace(trials[0], derived=True)], pob)
    assert not compares_position("velocity", [replace(trials[0], derived=True)], pob)
    blind = [replace(trial, measured={"v": trial.measured["v"]}, derived=True) for trial in trials]
    assert not compares_position(None, blind, pob)
    with pytest.raises(UserError, match="no measured position"):
        compares_position("position", blind, pob)
    with pytest.raises(UserError, match=r"model\.loss\.compare"):
        compares_position("angle", trials, pob)


def test_a_noise_that_no_sample_tells_apart_counts_once_for_as_long_as_it_lasts():
    white = np.random.default_rng(0).standard_normal((4, 2000))
    assert discount(list(0.3 * white)) == pytest.approx(0.09, rel=0.1)
    assert discount(list(np.repeat(white[:, :200], 10, axis=1))) == pytest.approx(10.0, rel=0.2)


def test_a_noise_that_smoothing_tells_is_taken_as_it_is(started, batch):
    model = started("pe1", loss={"through": "motion"})
    assert model.scales["assumed"] == 0.0 and float(model.discount) == 1.0
