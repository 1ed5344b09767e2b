"""Whoever waits is told what is done and how long the rest may take; at the end, what to do next."""

from __future__ import annotations

import logging
import os
import pty
import re
import select
import subprocess
import sys
import time

import pytest
from commands import ROOT, call

from frictionpinn import progress
from frictionpinn.numerics.parallel import in_parallel
from frictionpinn.progress import Steps, in_words

DRIVE = ["system=drive", "data.rate_hz=100", "friction=coulomb_viscous", "data.friction=coulomb_viscous"]
DRIVE += ["data.truth={mu_c: 3.0, sigma_2: 2.0}"]


def test_the_rest_is_told_at_the_pace_so_far(caplog, monkeypatch):
    now = iter([0.0, 30.0, 50.0, 90.0])
    monkeypatch.setattr(progress.time, "perf_counter", lambda: next(now))
    with caplog.at_level(logging.INFO):
        steps = Steps(3)
        for name in "abc":
            steps.finish(name)
    assert caplog.messages == ["a (1 of 3, about 60 s left)", "b (2 of 3, about 25 s left)", "c (3 of 3)"]


def test_long_steps_say_where_they_are_and_what_would_make_them_shorter(caplog, monkeypatch):
    now = iter([0.0, *(400.0 * k for k in (1, 1, 2, 2, 3, 3))])
    monkeypatch.setattr(progress.time, "perf_counter", lambda: next(now))
    progress.shorter("a million samples; data.rate_hz=100")
    with caplog.at_level(logging.INFO):
        steps = Steps(3, "effects fitted")
        for _ in range(3):
            steps.step()
    assert caplog.messages == [
        "effects fitted: 1 of 3, about 13 min left",
        "this goes on for about 13 min more: a million samples; data.rate_hz=100",
        "effects fitted: 2 of 3, about 7 min left",
    ]


def test_the_first_of_many_does_not_tell_how_long_the_others_take(caplog, monkeypatch):
    now = iter([0.0, *(t for k in range(20) for t in (100.0 + 10 * k,) * 2)])  # it compiles, or is the largest
    monkeypatch.setattr(progress.time, "perf_counter", lambda: next(now))
    progress.shorter("fewer samples")
    with caplog.at_level(logging.INFO):
        steps = Steps(20, "effects tested")
        for _ in range(3):
            steps.step()
    assert caplog.messages == [
        "effects tested: 1 of 20",
        "effects tested: 2 of 20, about 3 min left",
        "effects tested: 3 of 20, about 3 min left",
    ]


def test_short_work_says_nothing(caplog):
    with caplog.at_level(logging.INFO):
        assert in_parallel(lambda k: k * k, [1.0] * 5, "squares") == [0, 1, 4, 9, 16]
        assert list(progress.counted([1, 2, 3], "numbers")) == [1, 2, 3]
    assert caplog.messages == []


def test_work_side_by_side_is_counted(caplog, monkeypatch):
    monkeypatch.setattr(progress, "SHORT", 0.0)
    with caplog.at_level(logging.INFO):
        in_parallel(lambda k: time.sleep(0.01), [1.0] * 4, "sleeps")
    assert [m.split(",")[0] for m in caplog.messages] == [f"sleeps: {k} of 4" for k in (1, 2, 3)]


@pytest.mark.parametrize(("seconds", "words"), [(0.4, "0 s"), (89.0, "89 s"), (100.0, "2 min"), (7200.0, "2 h")])
def test_times_are_words(seconds, words):
    assert in_words(seconds) == words


def test_estimators_beside_each_other_say_how_many_are_left_and_what_comes_next(tmp_path):
    done = call("identify.py", *DRIVE, "methods=[maximum_likelihood,least_squares]", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.search(r"seed 0, maximum_likelihood: .* \(1 of 2.*\)\n", done.stdout) and "(2 of 2)" in done.stdout
    assert done.stdout.splitlines()[-1].startswith("next: python diagnose.py ")


def test_a_diagnosis_ends_with_what_its_verdict_suggests(tmp_path):
    options = [*DRIVE, "data=simulated", "diagnose.effects=[constant_force]"]
    options += ["data.effects={constant_force: {constant_force: 0.5}}", "noise.level=0.01"]
    done = call("diagnose.py", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    last = done.stdout.splitlines()[-1]
    found = re.fullmatch(r"next: python train.py model=bb1 friction=(\S+/augmented.yaml) learns .*", last)
    assert found and (tmp_path / found.group(1)).is_file()


def test_a_terminal_shows_the_time_that_passes_and_is_left_clean(tmp_path):
    main, other = pty.openpty()
    command = [sys.executable, str(ROOT / "identify.py"), *DRIVE, "methods=[pe1]", "epochs=300", "friction=lugre"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=other)
    shown, began = b"", time.monotonic()
    while b"0:02" not in shown and time.monotonic() - began < 90:
        if select.select([main], [], [], 0.2)[0]:
            shown += os.read(main, 4096)
    process.terminate()
    process.wait()
    os.close(main), os.close(other)
    assert b"\r\x1b[K0:02  " in shown
