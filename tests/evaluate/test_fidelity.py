"""Ratios of simulators' errors over ours."""

from frictionpinn.evaluate.fidelity import fidelity, sentences


def entry(label, force, position):
    return {
        "label": label,
        "in_simulation": {
            "force_mse": {"value": force, "unit": "N^2"},
            "position_rms": {"x": {"value": position, "unit": "m"}},
        },
    }


def test_the_ratio_stands_with_both_errors_for_the_identified_law_and_the_model():
    methods = {"model": entry("PE1", 0.1, 2e-3), "identified": entry("LuGre", 0.01, 1e-3)}
    table = fidelity({"Traj. 1": {**methods, "mujoco": entry("MuJoCo", 0.2, 4e-3)}})
    own = table["Traj. 1"]["mujoco"]
    assert own["identified"]["force_mse"] == {"simulator": 0.2, "ours": 0.01, "ratio": 20.0, "unit": "N^2"}
    assert own["model"]["position_rms"]["x"]["ratio"] == 2.0
    first, second = sentences(table)
    assert "0.2 N² with MuJoCo" in first and "0.01 with LuGre, 20 times less" in first and "0.1 with PE1" in second


def test_a_simulation_that_failed_or_was_not_made_gives_no_ratio():
    failed = {"label": "MuJoCo", "in_simulation": {"failed": "contact lost"}}
    assert fidelity({"a": {"model": entry("PE1", 0.1, 1.0), "mujoco": failed}, "b": {}}) == {}
