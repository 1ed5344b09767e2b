"""Bad recordings and bad options, kept and generated: each ends in success or in one clear line.

FRICTIONPINN_EXAMPLES: how many options are generated; of recordings five times as many.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "data"))
from nasty import KEPT, SIGNALS, recordings, swing

from frictionpinn.errors import UserError
from frictionpinn.workflow import cli
from frictionpinn.workflow.build import build_system
from frictionpinn.workflow.experiment import build_data, build_model

CONF = Path(__file__).resolve().parents[2] / "conf"
EXAMPLES = int(os.environ.get("FRICTIONPINN_EXAMPLES", "60"))
SECONDS = 10.0  # of the processor, for one case: none hangs


def generated(count: int) -> settings:
    return settings(
        max_examples=count,
        derandomize=True,  # the same cases everywhere; more of them by FRICTIONPINN_EXAMPLES
        deadline=None,  # the processor's time is what counts, see SECONDS
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
    )


OWN = ["data=csv", "smoothing=savgol", "model=bb1", "model.network.width=8"]


def built(make: Callable[[], dict]) -> bool:
    """Whether data and model are built; False where a line says why not, anything else is raised."""
    begin = time.process_time()
    try:
        cfg = make()
        system = build_system(cfg["system"])
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore", RuntimeWarning)
            data = build_data(cfg, system)
            model = build_model(cfg, system, data)
            data.prepare_for(model)
    except UserError as error:
        line = str(error)
        assert line and "\n" not in line and len(line) < 2000
        return False
    finally:
        assert time.process_time() - begin < SECONDS
    return True


@pytest.fixture(scope="module")
def build(configure) -> Callable[..., bool]:
    """``build(path, *overrides)``: the recording with options, both as the command line takes them."""

    def run(path: Path, *overrides: str) -> bool:
        options = [*OWN, f"data.path={path}", *overrides]

        def compose() -> dict:
            cli.check_command_line(CONF, "train", options)
            return configure(*options)

        return built(compose)

    return run


@pytest.fixture(scope="module")
def read(configure) -> Callable[[Path], bool]:
    """``read(path)``: the recording with sound options, which are composed once."""
    cfg = configure(*OWN, "data.path=nothing")
    return lambda path: built(lambda: {**cfg, "data": {**cfg["data"], "path": str(path)}})


@pytest.mark.parametrize("name", KEPT)
def test_a_kept_recording_is_read_or_refused_in_one_line(configure, read, tmp_path, name):
    make, refusal = KEPT[name]
    content = make()
    path = tmp_path / "run.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    if refusal is None:
        assert read(path)
        return
    with pytest.raises(UserError, match=refusal) as caught:
        cfg = configure(*OWN, f"data.path={path}")
        build_data(cfg, build_system(cfg["system"]))
    assert "\n" not in str(caught.value)


@generated(5 * EXAMPLES)
@given(made=recordings())
def test_a_generated_recording_is_used_or_refused_in_one_line(read, tmp_path, made):
    name, raw = made
    (tmp_path / name).write_bytes(raw)
    read(tmp_path / name)


UNITS = [
    "mm",
    "m",
    "inch",
    "deg",
    "m/s",
    "mm/s^2",
    "deg/s",
    "SI",
    "ms",
    "metre",
    "m/",
    "kg",
    "°",
    "%",
    "",
    "1/0",
    "m**m",
]
KEYS = [
    "seed", "data.rate_hz", "data.held_out", "data.validation", "data.trial_column", "data.columns", "data.units",
    "data.gains", "data.max_samples", "data.steps_per_epoch", "model.network.width", "model.network.depth",
    "model.network.activation", "model.network.odd", "model.windows.v_slip", "model.inputs", "model.loss.force",
    "optimizer.lr", "optimizer.warmup", "smoothing.offline", "smoothing.online", "noise", "system.parameters.m_b",
    "system.parameters.g", "system.parameters.J_L", "friction.start", "friction.bounds.mu_c", "trainer.max_epochs",
    "model", "system", "smoothing", "optimizer", "friction",
]  # fmt: skip
scalars = st.one_of(
    st.sampled_from(["null", "true", "0", "-1", "1e400", "nan", "inf", "''", "[]", "{}", "[1,2]", "[[6,1]]", "x", "1.5",
                     "pe1", "drive", "kalman", "[1]", "[2,2]", "{window_s: 0}", "{window_s: -1, order: 3}", "'a b'"]),
    st.integers(-5, 500).map(str),
    st.floats(allow_nan=False).map(repr),
    st.text(alphabet="abz01[]{}:,. _-'\"=$%~", max_size=8),
    st.builds("{{default: SI, {}: '{}'}}".format, st.sampled_from(SIGNALS), st.sampled_from(UNITS)),
)  # fmt: skip
overrides = st.lists(st.builds("{}={}".format, st.sampled_from(KEYS), scalars), min_size=1, max_size=3)


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("sound") / "run.csv"
    swing().to_csv(path, index=False)
    return path


@generated(EXAMPLES)
@given(chosen=overrides)
def test_generated_options_are_used_or_refused_in_one_line(build, sound, chosen):
    build(sound, *chosen)


# ---- at scale

MEASURE = """
import resource, sys, time
from frictionpinn.data.read import read_recording
from frictionpinn.data.tables import columns_of
from frictionpinn.physics import SYSTEMS
units = SYSTEMS["pob"]().signal_units
names = [n for n in columns_of(sys.argv[1]) if n in units or n == "t"]
before, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
recording = read_recording(sys.argv[1], columns={n: n for n in names}, units={"default": "SI"}, signal_units=units,
                           trial_column="trial")
grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
print(len(recording), len(recording.trials), grown * 1024, time.perf_counter() - begin)
"""


def test_a_long_recording_needs_no_more_than_four_times_its_file(tmp_path):
    path = tmp_path / "long.csv"
    swing(100_000, 3).to_csv(path, index=False)
    told = subprocess.run([sys.executable, "-c", MEASURE, path], capture_output=True, text=True, check=True).stdout
    rows, trials, memory, _ = (float(item) for item in told.split())
    assert (rows, trials) == (300_000, 3)
    assert memory < 4 * path.stat().st_size


def test_too_many_samples_for_one_batch_are_refused_and_fewer_taken_at_a_lower_rate(configure, sound):
    cfg = configure(*OWN, f"data.path={sound}", "data.max_samples=50")
    with pytest.raises(UserError, match=r"more samples than one batch may have: .*run\.csv is 80 samples long; .*= 50"):
        build_data(cfg, build_system(cfg["system"]))
    cfg = configure(*OWN, f"data.path={sound}", "data.max_samples=50", "data.rate_hz=50")
    data = build_data(cfg, build_system(cfg["system"]))
    assert len(data.recording) == 40 and np.diff(data.recording.trials[0].t) == pytest.approx(0.02)
