"""What the verdicts mean: one recording for each, diagnosed, and what is left before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import frictionpinn as fp
from frictionpinn.data.recording import Recording
from frictionpinn.evaluate.style import INK

TRUTH = {"mu_c": 3.0, "sigma_2": 2.0}
STUCK = {"sigma_0": 1e6, "sigma_1": 1e3, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 0.01}
SIGMAS = {"x": 5e-4, "v": 4e-3, "a": 0.03, "force": 0.06}  # noise, SI units
STROKES = ("0.05*sin(4*t)", "0.05*sin(7*t)", "0.03*sin(3*t) + 0.02*sin(9*t)")
COLORS = {"effect found": INK["model"], "nothing missing": "#2a9d8f", "partly explained": "#d9722e",
          "unexplained": "#b8860b", "refused": "#6c757d"}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """What acts beside the declared law, which names the diagnosis may use, and a push."""

    words: str
    acts: Mapping[str, float]
    effects: Sequence[str]
    tried: Sequence[str]
    push: str = ""  # of a drive whose motion is simulated, not imposed


CASES = (
    Case("nothing acts beside the declared law", {}, (), ("constant_force", "drag")),
    Case("a constant force acts", {"constant_force": 0.4}, ("constant_force",), ("constant_force", "drag")),
    Case("a constant force, and friction that depends on position: only the first is tried",
         {"constant_force": 0.4, "position_gradient": 2.0}, ("constant_force", "position_friction"),
         ("constant_force",)),
    Case("friction that depends on position: no name that is tried fits",
         {"position_gradient": 3.0}, ("position_friction",), ("inertia",)),
    Case("a drive pushed below breakaway: nothing slips, as the check says before any fit",
         {}, (), ("constant_force",), "2*sin(6*t)"),
)  # fmt: skip


def system(case: Case):
    """A drive whose force and motion are both measured, where nothing else is said."""
    return fp.system("drive", imposed=not case.push)


def recorded(case: Case) -> Recording:
    """The recording of a case: three trials, the last held out by the diagnosis."""
    law, own = ("lugre", STUCK) if case.push else ("coulomb_viscous", TRUTH)
    truth = fp.mechanism(system(case), law, list(case.effects))
    moves = [{"force": case.push}] * 3 if case.push else [{"x": path, "force": "0"} for path in STROKES]
    clean, rng = (
        fp.simulate(truth, own | case.acts, [{"duration": 3.0, **move} for move in moves], rate_hz=100),
        np.random.default_rng(0),
    )
    noisy = [trial.with_signals(**{name: trial.signals[name] + sigma * rng.standard_normal(len(trial))
                                   for name, sigma in SIGMAS.items()}) for trial in clean.trials]  # fmt: skip
    return replace(clean, trials=tuple(noisy))


def verdicts() -> Figure:
    """A row for each case: the force's residual on the held-out trial, of the declared and the final model."""
    figure = Figure(figsize=(8.5, 1.75 * len(CASES)), layout="constrained")
    rows = figure.subplots(len(CASES), 1, sharex=True)
    for axes, case in zip(rows, CASES, strict=True):
        log = recorded(case)
        wrong = [sentence for sentence in fp.check(log, system(case)).findings if sentence.startswith("wrong")]
        verdict = "refused" if wrong else _diagnosed(axes, case, log)
        if wrong:
            trial = log.trials[-1]
            axes.plot(trial.t, trial.signals["v"], ".", ms=3, color=INK["baseline"])
            axes.axhspan(-2 * SIGMAS["v"], 2 * SIGMAS["v"], color=INK["band"], zorder=0)
            axes.set_ylabel("measured\nvelocity (m/s)")
        axes.set_title(verdict, loc="left", fontsize=11, fontweight="bold", color=COLORS[verdict])
        axes.set_title(case.words, loc="right", fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
    rows[-1].set_xlabel("time (s); shaded: the noise, two standard deviations")
    handles = [
        rows[1].plot([], [], ".", ms=8, color=color, label=words)[0]
        for color, words in ((INK["baseline"], "declared model"), (INK["model"], "with what was added"))
    ]
    figure.legend(handles=handles, frameon=False, loc="outside lower center", ncols=2, fontsize=9)
    return figure


def _diagnosed(axes: Axes, case: Case, log: Recording) -> str:
    """Draw what is left of the force on the held-out trial; the verdict."""
    told = fp.diagnose(fp.mechanism(system(case), "coulomb_viscous"), log, effects=list(case.tried))
    t, sigma = told.before.models[0].t, told.noise["force"]
    axes.axhspan(-2 * sigma, 2 * sigma, color=INK["band"], zorder=0)
    fits = ((told.before, INK["baseline"]), (told.after, INK["model"]))
    for fit, color in fits[: 1 + bool(told.accepted)]:
        axes.plot(t, fit.state.pieces[0].residuals["force"], ".", ms=3, color=color)
    reach = 1.2 * float(np.nanpercentile(np.abs(told.before.state.pieces[0].residuals["force"]), 99))
    axes.set_ylim(-max(reach, 4 * sigma), max(reach, 4 * sigma))
    axes.set_ylabel("model minus\nmeasured (N)")
    return told.verdict
