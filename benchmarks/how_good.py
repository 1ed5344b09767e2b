"""The page "How good": one figure and its tables, from the results of the other benchmarks.

    python benchmarks/how_good.py

Reads wide_identify_now, wide_diagnose_now, blind, blind_contacts, blind_weak and diagnose_measured from
benchmarks/results; writes docs/figures/how_good.png and what stands between the markers of docs/accuracy.md.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import blind_contacts
import blind_report
import blind_weak
import numpy as np
import wide_report
from accuracy import fill_page
from blind import FAINT, NAMED
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from frictionpinn.evaluate.style import INK

ROOT = Path(__file__).resolve().parents[1]
RESULTS, FIGURE = ROOT / "benchmarks" / "results", ROOT / "docs" / "figures" / "how_good.png"
SIGNS = {"sigma_0": r"$\sigma_0$", "sigma_1": r"$\sigma_1$", "sigma_2": r"$\sigma_2$", "mu_c": r"$\mu_c$",
         "mu_s": r"$\mu_s$", "v_s": r"$v_s$"}  # fmt: skip
MACHINES = {"emps": "linear drive (EMPS)", "damper": "friction damper", "pendulum": "pendulum in air"}
LEGEND = {"loc": "upper center", "frameon": False, "fontsize": 8.5, "borderaxespad": 0, "columnspacing": 1,
          "handlelength": 1.2}  # fmt: skip


class Asked(NamedTuple):
    """What was missing, in which recordings, and how many answers were right, "nothing missing", and wrong."""

    what: str
    where: str
    right: int
    nothing: int
    wrong: int

    @property
    def of(self) -> int:
        """Recordings."""
        return self.right + self.nothing + self.wrong


def read(name: str):
    """A result file."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def parameters() -> dict[str, tuple[float, int, int, int]]:
    """Parameter -> error over the Cramer-Rao bound, root mean square over the recordings that tell it, and their
    number; intervals that hold the truth, of how many."""
    cases, found = read("wide_identify_now"), {}
    for name in wide_report.NAMES:
        own = [c for c in cases if name in c["truth"]]
        ratios = np.array([wide_report.ratio(c, name) for c in own])
        inside = [c["inside"][name] for c in own if name in c["inside"]]
        told = ratios[np.isfinite(ratios)]
        found[name] = float(np.sqrt(np.mean(told**2))), len(told), sum(inside), len(inside)
    return found


def names() -> list[Asked]:
    """What diagnoses of unseen recordings answered."""
    kinds, drawn = set(NAMED) - set(FAINT), read("wide_diagnose_now")
    clean, lacking = ([c for c in drawn if bool(c["true_effects"]) == lacks] for lacks in (False, True))
    swings = [c for c in read("blind") if c["kind"] in kinds and blind_report.unseen(c)]
    two = [c for c in read("blind_contacts") if c["kind"] != "clean" and c["seed"] >= 1000]

    def of(what: str, where: str, cases: list[dict], right: Callable[[dict], bool]) -> Asked:
        said = ["right" if right(c) else "nothing" if c.get("verdict") == "nothing missing" else "wrong" for c in cases]
        return Asked(what, where, *(said.count(answer) for answer in ("right", "nothing", "wrong")))

    return [
        of("nothing is missing", "four systems, three laws, drawn at random", clean, wide_report.right),
        of("one effect or two", "the same", lacking, wide_report.right),
        of(f"one of {len(kinds)} effects", "pendulum on a box, LuGre, six trials", swings, blind_report.right),
        of("one effect, two contacts", "pendulum with a hinge, cart-pole, two masses", two, blind_contacts.right),
        of("one weak effect", "0.5 to 1.5 % of the friction force", read("blind_weak"),
           lambda c: blind_weak.answer(c) == "right"),
    ]  # fmt: skip


def machines() -> dict[str, tuple[float, float, str, str, list[str], str]]:
    """Machine -> held-out error before, after, noise, unit, the effects that were added, and the verdict."""
    found = {}
    for key, title in MACHINES.items():
        r = read("diagnose_measured")[key]
        simulated = r["errors"].get("theta")  # an angle to compare; the others' force was measured
        entry = simulated or next(e for e in r["errors"].values() if "relative" in e)
        values, scale, unit = (entry, 1000, "mrad") if simulated else (entry["relative"], 100, "%")
        before, after, floor = (scale * values[k] for k in ("before", "after", "noise_floor"))
        noise = f"{floor:.2g} {unit} ({entry['noise_from']})"
        found[title] = before, after, noise, unit, [e["name"] for e in r["effects"]], r["verdict"]
    return found


def figure(told: dict, asked: list[Asked], real: dict) -> Figure:
    """Parameters, names, machines."""
    drawn = Figure(figsize=(13, 3.9), layout="constrained")
    left, middle, right = drawn.subplots(1, 3, width_ratios=(0.9, 1, 1))
    for axes in (left, middle, right):
        axes.spines[["top", "right"]].set_visible(False)
    at = np.arange(len(told))[::-1]
    left.axvspan(0, 1, color=INK["band"], lw=0)
    left.plot([ratio for ratio, *_ in told.values()], at, "o", color=INK["model"], ms=9)
    left.set_yticks(at, [SIGNS[name] for name in told], fontsize=12)
    inside, of = (sum(row[k] for row in told.values()) for k in (2, 3))
    left.set(xlim=(0, 2), ylim=(-0.6, len(told) - 0.4), xlabel="error / least possible error",
             title="Parameters about as good as can be;\n"
                   f"{100 * inside / of:.0f} % of 95 % intervals hold the truth")  # fmt: skip
    _answers(middle, asked)
    at = np.arange(len(real))[::-1]
    shares = [100 * after / before for before, after, *_ in real.values()]
    right.barh(at, 100, color=INK["baseline"], height=0.55, label="Coulomb + viscous")
    right.barh(at, shares, color=INK["model"], height=0.55, label="and what was found")
    for y, share, (before, after, _, unit, *_) in zip(at, shares, real.values(), strict=True):
        right.text(share + 2, y, f"{before:.2f} → {after:.2f} {unit}", va="center", fontsize=11)
    right.set_yticks(at, list(real))
    right.set(xlim=(0, 100), ylim=(-0.6, len(real) - 0.1), title="Measured machines:\nheld-out error before and after",
              xlabel="held-out error, % of that before")  # fmt: skip
    right.legend(ncols=2, **LEGEND)
    return drawn


def _answers(axes: Axes, asked: list[Asked]) -> None:
    """Bars of right, missed and wrong answers."""
    at, start = np.arange(len(asked))[::-1], np.zeros(len(asked))
    labels = {"right": "right", "nothing": '"nothing missing"', "wrong": "wrong"}
    for (part, label), colour in zip(labels.items(), ("observer", "baseline", "model"), strict=True):
        share = np.array([100 * getattr(own, part) / own.of for own in asked])
        axes.barh(at, share, left=start, color=INK[colour], height=0.55, label=label)
        start += share
    for y, own in zip(at, asked, strict=True):
        axes.text(3, y, f"{own.right} of {own.of}", va="center", color="white", fontsize=11)
    axes.set_yticks(at, [own.what for own in asked])
    axes.set(xlim=(0, 100), ylim=(-0.6, len(asked) - 0.1), xlabel="unseen recordings, %",
             title="What a model lacks\nis called by its name")  # fmt: skip
    axes.legend(ncols=3, **LEGEND)


def table(head: tuple[str, ...], rows: list[tuple]) -> str:
    """A table in Markdown."""
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in lines)


def main() -> None:
    told, asked, real = parameters(), names(), machines()
    figure(told, asked, real).savefig(FIGURE, dpi=130)
    fill_page("parameters", table(
        ("parameter", "error / bound", "recordings", "intervals that hold the truth"),
        [(name, f"{ratio:.2f}", n, f"{inside} of {of}") for name, (ratio, n, inside, of) in told.items()],
    ))  # fmt: skip
    fill_page("names", table(
        ("what is missing", "recordings", "right", '"nothing missing"', "wrong", "of"),
        [(own.what, own.of, own.right, own.nothing, own.wrong, own.where) for own in asked],
    ))  # fmt: skip
    fill_page("machines", table(
        ("machine", "Coulomb + viscous", "with what was found", "noise", "effects", "verdict"),
        [(title, f"{before:.2f} {unit}", f"{after:.2f} {unit}", noise, ", ".join(effects), verdict)
         for title, (before, after, noise, unit, effects, verdict) in real.items()],
    ))  # fmt: skip


if __name__ == "__main__":
    main()
