"""evaluate.py export=...: forms by name, parameters that the run refined."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from frictionpinn.errors import UserError
from frictionpinn.workflow.export import export, sampling_interval
from frictionpinn.workflow.load import refined


def test_an_unknown_form_is_named_before_anything_is_written(tmp_path):
    with pytest.raises(UserError, match="export is 'onx'; allowed: c, mujoco, onnx; did you mean 'onnx'"):
        export({"run": str(tmp_path), "export": ["c", "onx"]})
    assert not list(tmp_path.iterdir())


def test_refined_parameters_go_with_the_law_and_the_trained_ones_with_the_network(quick, tmp_path):
    quick(tmp_path, "model=pe1")
    result = json.loads((tmp_path / "result.json").read_text())
    trained = result["parameters"]["mu_c"]["value"]
    result["refined"] = {"parameters": {"mu_c": {"value": 0.2875}}}
    (tmp_path / "result.json").write_text(json.dumps(result))
    assert refined(tmp_path) == {"mu_c": 0.2875}
    export({"run": str(tmp_path), "export": "c"})
    source = (tmp_path / "export" / "c" / "friction.c").read_text()
    law = source[source.index("friction_law_identified = {") :].splitlines()[0]
    assert "0.2875" in law and repr(trained) not in law and repr(trained) in source


def test_a_refinement_that_failed_is_not_handed_on(tmp_path):
    (tmp_path / "result.json").write_text(json.dumps({"refined": {"parameters": {"mu_c": {"value": None}}}}))
    with pytest.raises(UserError, match="a refined parameter has no value"):
        refined(tmp_path)


def test_the_time_between_samples_is_that_of_the_trials_as_a_network_saw_them(tmp_path):
    from frictionpinn.physics import SYSTEMS
    from frictionpinn.workflow.options import composed

    for trial, rate in (("a", 1000), ("b", 200)):
        t = np.arange(2 * rate) / rate
        columns = {"t": t, "x": np.cos(6 * t), "v": -6 * np.sin(6 * t), "force": np.sin(6 * t)}
        pd.DataFrame(columns).to_csv(tmp_path / f"{trial}.csv", index=False)
    paths = f"data.path=[{tmp_path}/a.csv,{tmp_path}/b.csv]"
    trained = composed("train", ["system=drive", "data=csv", paths, "data.held_out=[]"])
    (tmp_path / "result.json").write_text("{}")
    assert sampling_interval(tmp_path, trained, SYSTEMS["drive"]()) == pytest.approx(1 / 200)


def test_a_recording_that_changed_since_the_training_tells_no_interval(quick, csv, tmp_path):
    folder = tmp_path / "run"
    quick(folder, "data=csv", f"data.path={csv()}", "model=bb1")
    csv(lambda table: table.assign(t=2 * table["t"]))
    with pytest.raises(UserError, match=r"not the recording that the run was trained on: .*run\.csv"):
        export({"run": str(folder), "export": "c"})
    assert not (folder / "export").exists()
