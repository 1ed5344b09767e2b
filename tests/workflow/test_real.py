"""The public recordings: each trains with its command and reports both held-out errors."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from frictionpinn.data.public import DATASETS

FOLDER = Path(os.environ.get("FRICTIONPINN_DATA", "missing"))
COMMANDS = {
    "emps": ("model=bb1", "system=drive", ["pulses"], "N"),
    "brfd": ("model=pe1", "system=damper", None, "N"),
    "multiarm_pendulum": ("model=bb1", "system=pendulum", ["vad_1", "vad_2", "raw"], "N*m"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_it_trains_and_reports_both_errors(quick, tmp_path, name):
    if not (FOLDER / DATASETS[name].folder).is_dir():
        pytest.skip(f"no recording {name} in {FOLDER}: set FRICTIONPINN_DATA to the folder of the public sets")
    model, system, held_out, unit = COMMANDS[name]
    result = quick(tmp_path, model, system, f"data={name}", epochs=15)
    error = result["force_error"]
    assert error["on"] == "held-out trials" and error["unit"]["rmse"] == unit
    assert held_out is None or result["data"]["trials"]["held_out"] == held_out
    assert not set(result["data"]["trials"]["train"]) & set(result["data"]["trials"]["held_out"])
    for key in ("model", "coulomb_viscous"):
        assert np.isfinite(error[key]["rmse"]) and error[key]["rmse"] > 0
        assert error[key]["reference"] == "friction force implied by the equation of motion"
    assert error["coulomb_viscous"]["relative"] < 1.5
    assert all("truth" not in entry for entry in result["parameters"].values())
