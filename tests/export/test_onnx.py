"""ONNX: the graph gives what the model gives, for any number of instants, and says what goes in."""

from __future__ import annotations

import json

import numpy as np
import pytest

from frictionpinn.data.contact import BASE
from frictionpinn.errors import UserError
from frictionpinn.export.extras import require
from frictionpinn.export.histories import windows

onnx = pytest.importorskip("onnx", reason="needs the extra: pip install -e '.[export]'")
onnxruntime = pytest.importorskip("onnxruntime", reason="needs the extra: pip install -e '.[export]'")


def feed(run, session) -> dict[str, np.ndarray]:
    """The histories of a held-out trial, as a controller would have them."""
    signals = {name: run.trial.online[name] for name in BASE}
    signals |= {f"{name}_rate": run.trial.rates[name] for name in BASE}
    names = [item.name for item in session.get_inputs()]
    return {name: windows(signals[name], run.portable.length).astype(np.float32) for name in names}


@pytest.mark.parametrize("name", ["pe2", "bb1"])
def test_the_graph_predicts_a_trial_as_the_model_does_whatever_the_batch(exported, name):
    run = exported(name)
    session = onnxruntime.InferenceSession(run.file("onnx", "friction.onnx"), providers=["CPUExecutionProvider"])
    inputs = feed(run, session)
    expected = run.model.predict_trial(run.trial)["force"]
    whole = session.run(["force"], inputs)[0][:, 0]
    assert whole == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())
    for count in (1, 7):
        part = session.run(["force"], {key: values[:count] for key, values in inputs.items()})[0]
        assert part.shape == (count, 1) and part[:, 0] == pytest.approx(whole[:count], abs=1e-5)


def test_names_units_and_interval_stand_in_the_file(exported):
    run = exported("pe2")
    proto = onnx.load(run.file("onnx", "friction.onnx"))
    table = {item.key: json.loads(item.value) for item in proto.metadata_props}
    assert table["inputs"]["a_frictionless_rate"]["unit"] == "m/s^3"
    assert table["inputs"]["v_slip"]["shape"] == ["batch", 48] and table["interval"] == {"value": 0.005, "unit": "s"}
    assert table["parameters"]["mu_c"] == pytest.approx(run.model.physical()["mu_c"])
    assert {value.name: value.doc_string for value in proto.graph.output}["force"].endswith(", N")


def test_the_check_against_torch_is_told_and_kept(exported):
    run = exported("pe2")
    check = json.loads(run.file("onnx", "export.json").read_text())["check"]
    assert 0 < check["relative"] < 1e-3 and "differs from torch by at most" in run.told


def test_a_graph_that_differs_is_refused(exported, tmp_path, monkeypatch):
    from frictionpinn.export import onnx_model

    run = exported("bb1")
    monkeypatch.setattr(onnx_model, "reference", lambda *_: {"force": np.ones(1000)})
    with pytest.raises(UserError, match="differs from the model"):
        onnx_model.write_onnx(tmp_path, run.model, run.portable)


def test_a_missing_package_is_named_with_its_cure():
    with pytest.raises(UserError, match=r"no_such_package; pip install -c constraints.txt -e '.\[export\]'"):
        require("export", "onnx", "no_such_package")
