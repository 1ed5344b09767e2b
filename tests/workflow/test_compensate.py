"""The whole chain as a command: recorded with the PID alone, identified, compensated, recorded again."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import pytest
from commands import call
from pages import assert_reads_everywhere

from frictionpinn.control import Loop
from frictionpinn.workflow.compensate import _figure, _told

SHORT = [
    "record.duration=1.5",
    "record.trials=[{name: sine, amplitude: 5.0e-3, period: 1.0}, {name: multisine, amplitude: 7.0e-3, period: 1.5}]",
    "follow.duration=2.0",
    "follow.motions=[{name: sine, amplitude: 4.0e-3, period: 0.8}]",
    "diagnose.effects=[]",
    "hydra.run.dir=run",
]


def test_an_axis_is_identified_and_tracks_better_and_the_compensator_is_there_as_c(tmp_path):
    done = call("compensate.py", *SHORT, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    row = result["motions"]["sine"]
    assert row["after"] < 0.2 * row["before"] and result["verdict"] == "not diagnosed"
    assert result["parameters"]["mu_c"] == pytest.approx(3.0, rel=0.1)
    page = (tmp_path / "run" / "report.html").read_text()
    assert "torque is at its limit" not in page + done.stdout + done.stderr
    assert_reads_everywhere(page)
    command = ["cc", "-std=c99", "-c", "-Wall", "-Werror", "-o", tmp_path / "x.o", tmp_path / "run" / "compensator.c"]
    subprocess.run(command, check=True)


def test_a_machine_whose_torque_does_not_suffice_for_the_motion_is_told(tmp_path):
    done = call("compensate.py", *SHORT, "machine.limit=4.6", "scale=10", cwd=tmp_path)
    assert "The torque is at its limit of 4.6 N in" in done.stdout.replace("\n", " ") + done.stderr
    assert "The torque is at its limit of 4.6 N in" in (tmp_path / "run" / "report.html").read_text()


def test_the_figure_shows_what_compensation_leaves_on_a_scale_of_its_own():
    t = np.linspace(0.0, 3.0, 301)
    error = np.sin(7 * t)
    error[t < 0.5] *= 10  # while it learns

    def run(amplitude: float) -> Loop:
        same, reference = np.zeros_like(t), np.column_stack([amplitude * error, 0 * t, 0 * t])
        return Loop(t, reference, *[same] * 8)

    top, middle, bottom = _figure(run(2e-4), run(2e-6), "m", "N", "title").axes
    assert [axes.get_ylabel() for axes in (top, middle)] == ["tracking error (mm)", "tracking error (µm)"]
    low, high = middle.get_ylim()
    assert -2.5 < low < -2.0 < 2.0 < high < 4.0  # what is counted fills it
    assert np.allclose(middle.lines[0].get_ydata(), 2 * error) and bottom.get_ylabel() == "friction (N)"


@pytest.mark.parametrize(
    ("value", "told"), [(2e-8, "20 nm"), (9.99e-4, "999 µm"), (9.996e-4, "1 mm"), (0.295, "295 mm"), (1.99, "1.99 m")]
)
def test_an_error_is_told_in_three_digits_whatever_the_size_of_the_machine(value, told):
    assert _told(value, "m") == told


@pytest.mark.parametrize(
    ("option", "part"),
    [
        ("system=pob", "drive, joint, pendulum"),
        ("machine.delay=1.2e-3", "multiples of 0.0005 s"),
        ("machine.delay=-1.0e-3", "machine.delay is -0.001; allowed: 0 to 0.0124 s"),
        ("machine.delay=0.5", "machine.delay is 0.5; allowed: 0 to 0.0124 s with loop.delay=0.0015"),
        ("machine.delay=null", "no number: machine.delay"),
        ("machine.limit=3", "machine.limit is 3; allowed: above 4.5 N"),
        ("machine.resolution=0", "resolution is 0"),
        ("machine.resolution=5e-3", "machine.resolution is 0.005; allowed: above 0, up to 0.0008 m"),
        ("follow.duration=0", "follow.duration is 0; allowed: 0.4 s"),
        ("record.duration=0.5", "record.duration is 0.5; allowed: 0.75 s"),
        ("control.gain=-1", "gain is -1"),
        ("+control.gian=1", "unknown key: control is gian"),
        ("control.spread.mu_c=-0.1", "spread.mu_c is -0.1"),
        ("control.limit=-1", "limit is -1"),
        ("control.limit=null", "impossible value: limit"),
        ("control.transition=0.1", "an option that nothing reads: transition is 0.1"),
        ("loop.sensitivity=null", "impossible value: sensitivity"),
        ("record.rate_hz=null", "impossible rate: rate_hz"),
        ("record.trials=[]", "record.trials is []"),
        ("follow.motions=[]", "follow.motions is []"),
        ("follow.motions=[{name: sine, amplitud: 1.0, period: 1.0}]", "amplitude (unit of position)"),
        ("machine.effects={asymetry: {asymmetry: 0.1}}", "did you mean 'asymmetry'"),
        ("machine.effects={asymmetry: {asymetry: 0.1}}", "machine.asymetry"),
        ("record.rate_hz=1e5", "rate_hz"),
        ("scale=0", "scale is 0"),
        ("follow.motions=[{name: sine, amplitude: small, period: 1.0}]", "amplitude is small"),
        ("control.bandwidth=900", "interval is 0.001; allowed: below 0.000556 s"),
        ("follow.motions=[{name: sinus, amplitude: 1.0, period: 1.0}]", "did you mean 'sine'"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(option, part, tmp_path):
    done = call("compensate.py", *SHORT, option, cwd=tmp_path)
    assert done.returncode == 2 and part in done.stderr.splitlines()[-1]
