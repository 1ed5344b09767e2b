"""What excites which parameter: sensitivities over a motion, and least standard errors by experiment."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import frictionpinn as fp
from frictionpinn.evaluate.style import INK
from frictionpinn.numerics.simulate import Simulator

VALUES = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.5, "v_s": 0.02}
RATE = 1000.0  # Hz
SIGMAS = {"x": 1e-5, "v": 1e-3, "a": 0.05, "force": 0.02}  # noise, SI units
MOTION = {"duration": 2.0, "x": "0.12*(2/3 - cos(pi*t) + cos(pi*t)**3/3)/pi"}  # velocity 0.12 sin(pi t)^3
EXPERIMENTS = {
    "small reversals, never sliding": {"duration": 2.0, "force": "2.5*sin(6*pi*t)"},
    "slow starts and stops": {"duration": 2.0, "force": "5*sin(2*pi*t)"},
    "force ramps, breakaway": {"duration": 2.0, "force": "5*abs(sin(pi*t))*sin(pi*t)"},
    "steady sliding, slow": {"duration": 2.0, "force": "5.5*tanh(20*t)"},
    "fast sliding both ways": {"duration": 2.0, "force": "15*sin(3*pi*t)"},
    "all of them in one": {"duration": 2.0, "force": "(2.5 + 6*t)*sin(3*pi*t)"},
}


def sensitivities() -> Figure:
    """How the friction force changes for a change of each parameter by 1 %, over a motion with slow starts."""
    drive = fp.mechanism(fp.system("drive", imposed=True), "lugre")
    trial = fp.simulate(drive, VALUES, [MOTION], rate_hz=RATE).trials[0]
    motion = {name: trial.signals[name] for name in ("x", "v", "a")} | {"force": np.zeros_like(trial.t)}
    run = Simulator(drive).simulate(trial.t, motion, VALUES, sensitivities=tuple(VALUES))
    figure = Figure(figsize=(8.5, 7.2), layout="constrained")
    rows = figure.subplots(1 + len(VALUES), 1, sharex=True)
    rows[0].plot(trial.t, run.v_slip, color=INK["reference"], lw=1.6)
    rows[0].set_ylabel("slip velocity\n(m/s)", rotation=0, ha="right", va="center", fontsize=9)
    stuck = np.abs(run.v_slip) < 0.5 * VALUES["v_s"]
    for k, (name, value) in enumerate(VALUES.items()):
        change = 1e3 * 0.01 * value * run.sensitivities["F"][:, k]
        axes = rows[k + 1]
        axes.fill_between(trial.t, change, color=INK["model"], lw=0)
        reach = float(np.max(np.abs(change)))
        axes.set_ylim(-1.1 * reach, 1.1 * reach)
        axes.set_ylabel(f"{name}\nup to {reach:.2g} mN", rotation=0, ha="right", va="center", fontsize=9)
    for axes in rows:
        axes.spines[["top", "right", "bottom"]].set_visible(False)
        axes.set_yticks([])
        axes.tick_params(axis="x", length=0)
        axes.axhline(0, color=INK["reference"], lw=0.5)
        axes.fill_between(trial.t, 0, 1, where=stuck, transform=axes.get_xaxis_transform(), color=INK["band"], zorder=0,
                          lw=0)  # fmt: skip
    rows[-1].set_xlabel("time (s); shaded: near rest, slower than half the Stribeck velocity")
    rows[-1].tick_params(axis="x", length=3)
    rows[1].set_title("change of the friction force for 1 % of a parameter", fontsize=9)
    return figure


def experiments() -> Figure:
    """Least relative standard error of every parameter in experiments of 2 s (the Cramer-Rao bound)."""
    drive = fp.mechanism("drive", "lugre")
    told = np.full((len(EXPERIMENTS), len(VALUES)), np.inf)
    for k, trial in enumerate(EXPERIMENTS.values()):
        bound = fp.bound(drive, fp.simulate(drive, VALUES, [trial], rate_hz=RATE), VALUES, sigmas=SIGMAS)
        told[k] = [bound.relative.get(name, np.inf) for name in VALUES]
    told = np.where(np.isfinite(told), told, np.inf)
    figure = Figure(figsize=(8.5, 3.4), layout="constrained")
    axes = figure.subplots()
    shade = np.clip(np.log10(np.minimum(told, 1e3)), -3.5, 0.5)
    axes.imshow(shade, cmap="RdYlGn_r", aspect="auto", alpha=0.45)
    for (row, column), value in np.ndenumerate(told):
        text = "not told" if value > 1 else f"{100 * value:.2g} %"
        axes.text(column, row, text, ha="center", va="center", fontsize=9)
    axes.set_xticks(range(len(VALUES)), list(VALUES))
    axes.set_yticks(range(len(EXPERIMENTS)), list(EXPERIMENTS))
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_xlabel("least relative standard error from a recording of 2 s at 1 kHz (Cramer-Rao bound)")
    return figure
