"""Recordings written as files, and their reading."""

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
from hypothesis import HealthCheck, settings

from frictionpinn.data.read import read_recording
from frictionpinn.errors import UserError

SIGNALS = {"x": "m", "v": "m/s", "force": "N", "mu": ""}
COLUMNS = {"t": "t", "x": "x"}
SI = {"default": "SI"}
quick = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)


def read(path, columns=COLUMNS, units=SI, **options):
    return read_recording(path, columns=columns, units=units, signal_units=SIGNALS, **options)


def table(n=20):
    t = np.arange(n) * 0.01
    return {"t": t, "x": np.sin(40 * t), "force": np.cos(40 * t)}


def write_csv(path, data, sep=","):
    pd.DataFrame(data).to_csv(path, sep=sep, index=False)
    return path


def write_hdf5_mat(path, data):
    with h5py.File(path, "w") as file:
        for name, values in data.items():
            file[name] = values.reshape(1, -1)


WRITERS = {
    "a.csv": write_csv,
    "a.csv.gz": write_csv,
    "a.txt": lambda path, data: write_csv(path, data, "\t"),
    "a.parquet": lambda path, data: pd.DataFrame(data).to_parquet(path),
    "a.mat": lambda path, data: scipy.io.savemat(path, data),
    "a73.mat": write_hdf5_mat,
    "a.npz": lambda path, data: np.savez(path, **data),
}


def refused(pattern, path, *args, **kwargs):
    with pytest.raises(UserError, match=pattern) as caught:
        read(path, *args, **kwargs)
    assert "\n" not in str(caught.value)
