"""The exported compensator beside the one in Python: the same torque and interval, cycle by cycle, to rounding."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

import frictionpinn as fp
from frictionpinn.control import Compensator, reference
from frictionpinn.export.compensator import write_compensator_c
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

LUGRE = {"sigma_0": 1e5, "sigma_1": 300.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.5, "v_s": 2e-3}
ADAPTS = {"adapt": {"mu_c": 0.1, "mu_s": 0.1, "v_s": 0.1, "sigma_2": 0.03}, "spread": {"mu_c": 0.3, "mu_s": 0.3},
          "disturbance": 9.0, "delay": 1.5e-3, "limit": 12.0}  # fmt: skip
MAIN = """#include <stdio.h>
#include "compensator.h"
static compensator c;
int main(void)
{
    double r[3], q, u;
    compensator_reset(&c);
    while (scanf("%lf %lf %lf %lf %lf", &r[0], &r[1], &r[2], &q, &u) == 5) {
        const compensator_command now = compensator_update(&c, r, q, u);
        printf("%.17g %.17g %.17g\\n", now.torque, now.low, now.high);
    }
    return 0;
}
"""


def rows(scale: float) -> np.ndarray:
    """Reference, a position that deviates from it, and torques, of one second."""
    t = np.arange(1000) * 1e-3
    wanted = reference("sine", scale, 0.5)(t)
    rng = np.random.default_rng(0)
    position = wanted[:, 0] + 1e-2 * scale * np.sin(40 * t) + 1e-4 * scale * rng.normal(size=len(t))
    position[500] = np.nan
    return np.column_stack([wanted, position, 5 * np.sin(13 * t)])


@pytest.mark.parametrize(
    ("system", "law", "effects", "values", "options"),
    [
        ("drive", "lugre", (), LUGRE, ADAPTS | {"stroke": (-4e-3, 6e-3), "cells": 9, "uneven": 0.2}),
        ("drive", "lugre", (), LUGRE, ADAPTS),
        ("drive", "lugre", (), LUGRE, {"delay": 2e-3}),
        ("joint", "lugre", ("asymmetry", "dwell"), LUGRE | {"W_cos": 2.0, "asymmetry": 0.1, "dwell": 0.2}, ADAPTS),
        (
            "drive",
            "coulomb_viscous",
            ("ripple",),
            {"mu_c": 3.0, "sigma_2": 2.0, "ripple_sin": 0.5, "ripple_cos": 0.2, "ripple_wavelength": 2e-3},
            {"disturbance": 20.0},
        ),
        ("drive", "coulomb_viscous", ("drift",), {"mu_c": 3.0, "sigma_2": 2.0, "drift": 0.01}, {"disturbance": 20.0}),
    ],
    ids=[
        "learns the stroke",
        "estimator",
        "feed-forward",
        "joint with effects",
        "pi",
        "law without memory, with a clock",
    ],
)
def test_c_gives_the_torque_and_the_interval_of_python(tmp_path: Path, system, law, effects, values, options):
    check(tmp_path, Compensator(Mechanism(SYSTEMS[system](), LAWS[law](), effects), values, **options))


def test_c_gives_the_torque_of_python_with_all_that_the_default_estimator_learns(tmp_path: Path):
    axis = Mechanism(SYSTEMS["drive"](), LAWS["lugre"]())
    default = fp.compensate(axis, LUGRE | {"M": 1.0}, delay=1.5e-3, resolution=1e-6, stroke=(-5e-3, 5e-3))
    check(tmp_path, default)
    assert abs(default.asymmetry) > 0.01 and abs(default.disturbance) > 0.1
    assert all(abs(default.parameters[name] / LUGRE[name] - 1) > 1e-3 for name in ("mu_c", "mu_s", "sigma_0"))


def check(folder: Path, compensator: Compensator) -> None:
    """Run both along the same rows."""
    names = write_compensator_c(folder, compensator)
    (folder / "main.c").write_text(MAIN, encoding="ascii")
    flags = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    program = folder / "main"
    subprocess.run(["cc", *flags, "-o", program, folder / "main.c", folder / names[1], "-lm"], check=True)
    data = rows(5e-3)
    text = "\n".join(" ".join(map(repr, row)) for row in data.tolist())
    said = subprocess.run([program], input=text, capture_output=True, text=True, check=True).stdout
    theirs = np.array([line.split() for line in said.splitlines()], dtype=float)
    ours = np.array([compensator.update(row[:3], row[3], row[4]) for row in data])
    assert theirs.shape == ours.shape
    np.testing.assert_allclose(theirs, ours, rtol=1e-9, atol=1e-9)


def test_a_cycle_without_a_reference_or_a_torque_adds_nothing_in_c_and_spoils_no_later_one(tmp_path: Path):
    write_compensator_c(tmp_path, Compensator(Mechanism(SYSTEMS["drive"](), LAWS["lugre"]()), LUGRE, **ADAPTS))
    (tmp_path / "main.c").write_text(MAIN, encoding="ascii")
    subprocess.run(["cc", "-std=c99", "-o", "main", "main.c", "compensator.c", "-lm"], cwd=tmp_path, check=True)

    def said(data: np.ndarray) -> list[str]:
        text = "\n".join(" ".join(map(repr, row)) for row in data.tolist())
        return subprocess.run([tmp_path / "main"], input=text, capture_output=True, text=True, check=True).stdout.split(
            "\n"
        )

    data, lost = rows(5e-3), [[np.nan, 0, 0, 0, 0], [0, 0, np.inf, 0, 0], [0, 0, 0, 0, np.nan]]
    whole, holed = said(data), said(np.insert(data, 700, lost, axis=0))
    assert holed[700:703] == ["0 0 0"] * 3 and holed[:700] + holed[703:] == whole


def test_a_compensator_in_c_that_runs_for_months_counts_no_further_than_its_delay(tmp_path: Path):
    write_compensator_c(tmp_path, Compensator(Mechanism(SYSTEMS["drive"](), LAWS["lugre"]()), LUGRE, **ADAPTS))
    counts = MAIN.replace(
        "    return 0;", '    printf("%d %d 0\\n", c.begun < 10, c.begun >= COMPENSATOR_PAST);\n    return 0;'
    )
    (tmp_path / "main.c").write_text(counts, encoding="ascii")
    subprocess.run(["cc", "-std=c99", "-o", "main", "main.c", "compensator.c", "-lm"], cwd=tmp_path, check=True)
    text = "\n".join(" ".join(map(repr, row)) for row in rows(5e-3).tolist())
    said = subprocess.run([tmp_path / "main"], input=text, capture_output=True, text=True, check=True).stdout
    assert said.splitlines()[-1] == "1 1 0"  # a long of 32 bits would be over in 25 days of cycles of 1 ms


def test_c_allocates_nothing_and_keeps_all_memory_in_the_struct(tmp_path: Path):
    write_compensator_c(tmp_path, Compensator(Mechanism(SYSTEMS["drive"](), LAWS["lugre"]()), LUGRE, **ADAPTS))
    source = (tmp_path / "compensator.c").read_text(encoding="ascii")
    assert "alloc" not in source and "free(" not in source
    statics = [line for line in source.splitlines() if line.startswith("static ") and "(" not in line]
    assert all(line.startswith("static const") for line in statics)
