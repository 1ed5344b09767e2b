"""One call for every estimator, and the refinement of a trained network."""

import numpy as np
import pytest

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.errors import UserError
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.estimate import ESTIMATORS, default_config, estimate
from frictionpinn.workflow.train import train

TRUTH = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 5e-3}


@pytest.fixture(scope="module")
def drive():
    system = SYSTEMS["drive"](M=1.0)
    trials = [{"duration": 2.0, "force": f"{a}*sin({w}*pi*t)"} for a, w in ((5, 2), (6, 2), (8, 3))]
    clean = simulate_recording(system, "lugre", TRUTH, trials, 200.0)
    return Mechanism(system, LAWS["lugre"]()), GaussianNoise(0.02)(clean, 0)


@pytest.mark.parametrize("method", ESTIMATORS)
def test_every_estimator_returns_the_same_kind_of_result(drive, method):
    mechanism, recording = drive
    found = estimate(method, mechanism, recording, epochs=60, simulations=60, seed=1)
    assert found.estimator == method
    assert set(found.names) == set(TRUTH)
    assert found.units["sigma_0"] == "N/m"
    assert found.values["mu_c"] == pytest.approx(TRUTH["mu_c"], rel=0.15)
    assert found.seconds > 0 and found.to_dict()["parameters"]["mu_c"]["unit"] == "N at a preload of 1"


def test_an_unknown_estimator_is_answered_with_the_nearest_name(drive):
    with pytest.raises(UserError, match="did you mean 'nelder_mead'"):
        estimate("nelder_meed", *drive)


def test_refining_a_trained_network_writes_intervals_beside_the_truth(tmp_path):
    options = ["model=pe2", "refine=true", "trainer.max_epochs=40", "trainer.progress_bar=false", "trainer.threads=1"]
    cfg = default_config([*options, "noise.level=0.02"])
    cfg["data"]["trials"] = cfg["data"]["trials"][2:4]
    cfg["data"]["held_out"] = []
    refined = train(cfg, tmp_path)["refined"]
    assert refined["started_from"] in ("pe2", "search")
    for name in ("sigma_0", "mu_c"):
        entry = refined["parameters"][name]
        assert entry["value"] == pytest.approx(entry["truth"], rel=0.25)
        assert entry["ci95"][0] < entry["value"] < entry["ci95"][1]
    assert np.isfinite(refined["log_likelihood"]["search"])


def test_a_black_box_cannot_be_refined(tmp_path):
    with pytest.raises(UserError, match="no parameters to refine"):
        train(default_config(["model=bb1", "refine=true"]), tmp_path)


def test_what_a_network_or_a_problem_cannot_take_into_account_is_refused(drive):
    import frictionpinn as fp
    from frictionpinn.identify import Problem, maximum_likelihood

    mechanism, recording = drive
    dragged = Mechanism(mechanism.system, mechanism.law, ("drag",))
    with pytest.raises(UserError, match=r"law alone: .* is effects=\['drag'\]; allowed: bounds, fixed"):
        fp.fit(dragged, recording, method="pe1")
    with pytest.raises(UserError, match=r"law alone: .* is windows=4"):
        fp.fit(mechanism, recording, method="pe2", windows=4)
    with pytest.raises(UserError, match=r"its recording and options: maximum_likelihood is recording, windows"):
        maximum_likelihood(Problem(mechanism, recording), recording, windows=2.0)


def test_what_is_no_recording_or_no_list_is_told_in_a_line(drive):
    import frictionpinn as fp

    with pytest.raises(UserError, match=r"not a recording: recording is 'run\.csv'"):
        fp.fit(drive[0], "run.csv")
    with pytest.raises(UserError, match=r"not a list of names: free is 'mu_c'; allowed: \['mu_c'\]"):
        fp.fit(*drive, free="mu_c")


def test_what_a_motion_in_one_direction_tells_nothing_of_does_not_end_a_fit():
    """Far beyond the Stribeck velocity all the time: mu_c and sigma_2 are found, the others are told to be unknown."""
    import frictionpinn as fp

    model = fp.mechanism(fp.system("drive", M=3.7), "stribeck")
    truth = {"mu_c": 6.2, "mu_s": 8.4, "v_s": 0.02, "sigma_2": 11.0}
    trials = [{"duration": 4.0, "force": "13 + 4*sin(5*t) + 2*sin(13*t)", "initial": {"v": 0.6}}]
    found = fp.fit(model, fp.simulate(model, truth, trials, rate_hz=250, noise=0.002))
    assert found.values["mu_c"] == pytest.approx(6.2, rel=0.05)
    assert found.values["sigma_2"] == pytest.approx(11.0, rel=0.05)
    assert any("mu_s does not show" in line for line in found.advice)
