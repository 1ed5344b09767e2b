"""The user's loop: record with the PID alone, diagnose, identify, compensate; held against the oracle.

python benchmarks/compensation.py --diagnosed

Every axis is recorded with the PID alone and identified twice from that recording: LuGre alone, and with the effect
that a diagnosis adds to it. Arms are then run with what is believed (20 % wrong), with LuGre as identified, and with
the effect. Axes, motions and options are those of the main table; the two axes of a circle are alike, since each axis
is identified once. Rows and what was identified are kept in benchmarks/results/compensation_diagnosed.json: axes that
stand there are not identified again, only compensated; without that file all are.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path

import numpy as np
from compensation import ARMS, DELAY, FIRST, REFERENCES, closed, compensator, figures, made
from compensation_learned import alone, declared
from compensation_oracle import WITHIN
from compensation_plants import KINDS, Draw, draw
from compensation_report import keep, kept, unit

from frictionpinn.control.record import recorded
from frictionpinn.errors import UserError
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.compensate import identified

EFFECTS = ("asymmetry", "position_friction", "ripple")  # that a diagnosis tries: those of the axes
SEEDS = range(FIRST, FIRST + 3)  # the odd one with the load
COMPARED = ("feedforward", "estimator")
RATE = 100.0  # Hz, of the recording: encoder and torque are averaged to it
CASES = {"believed": "as believed, 20 % wrong", "alone": "LuGre identified", "added": "effect diagnosed and added"}


def diagnosed(chosen: dict, kinds: Iterable[str] = tuple(KINDS)) -> None:
    """Measure these kinds of axis, keep the others, and write rows and table after every axis."""
    found, before = kept("diagnosed", kinds), kept("diagnosed", ())
    known = {(row["name"], row["seed"]): row["identified"] for rows in before.values() for row in rows}
    for name in kinds:
        found[name] = []
    for seed in SEEDS:
        for name in kinds:
            found[name].append(follow(chosen, name, seed, known.get((name, seed))))
            keep("diagnosed", found, _table)


def follow(chosen: dict, name: str, seed: int, told: dict | None = None) -> dict:
    """One axis through the loop: what was identified, and rms errors by motion, arm and case."""
    it = draw(name, seed)
    own, told, found = declared(it), told or identify(it, name), {"believed": it}
    for case, what in told.items():
        if what["parameters"]:
            mechanism = Mechanism(own.system, own.law, tuple(what["effects"]))
            found[case] = Draw(it.plant, mechanism, what["parameters"], it.loaded)
    errors = {"oracle": _errors(name, seed, partial(compensator, "oracle"), it)}
    for arm in COMPARED:
        for case, axis in found.items():
            errors[f"{arm}, {case}"] = _errors(name, seed, made(chosen, name, arm), axis)
    return {"name": name, "seed": seed, "identified": told, "errors": errors}


def identify(it: Draw, name: str) -> dict[str, dict]:
    """Verdict, effects and parameters of LuGre alone and with what a diagnosis adds, and the time that they took."""
    own = declared(it)
    law = [par.name for par in own.law.parameters if par.value is None]
    # a preload scales mu_c and mu_s, which are free
    free = [*law, *(key for key, value in own.system.values.items() if value and key != "preload")]
    recording = recorded(alone(name, it), own, DELAY, RATE)
    options = {"free": free, "start": {key: it.believed[key] for key in free}}
    told: dict[str, dict] = {}
    with tempfile.TemporaryDirectory() as place:
        for case, effects in (("alone", ()), ("added", EFFECTS)):
            begun = time.process_time()
            try:
                mechanism, values, verdict = identified(own, recording, Path(place), effects=list(effects), **options)
            except UserError as error:
                told[case] = {"verdict": f"not identified: {error}", "effects": [], "parameters": {}}
                continue
            told[case] = {
                "verdict": verdict,
                "effects": [effect.name for effect in mechanism.effects],
                "parameters": {key: float(f"{value:.5g}") for key, value in values.items()},
                "seconds": round(time.process_time() - begun),
            }
    return told


def _errors(name: str, seed: int, make, axis: Draw) -> dict[str, float]:
    """Rms errors by motion, every axis of a motion the same."""
    return {m: float(f"{figures(closed(name, m, seed, make, lambda _: axis))['rms']:.5g}") for m in REFERENCES}


def _table(found: dict) -> list[str]:
    """Verdicts, ratios to the oracle, and what was found on every axis."""
    rows = [row for axes in found.values() for row in axes]
    whole = [row for row in rows if all(f"estimator, {case}" in row["errors"] for case in CASES)]
    names = [name for name in KINDS if any(row["name"] == name for row in whole)]
    seeds = {name: "+".join(str(row["seed"]) for row in rows if row["name"] == name) for name in found}
    lines = [
        "python benchmarks/compensation.py --diagnosed",
        f"seeds {', '.join(f'{name} {told}' for name, told in seeds.items())} (odd ones carry the load);",
        f"identified from 12 s with the PID alone, encoder and torque at {RATE:g} Hz,",
        f"started from what is believed, 20 % wrong; effects tried: {', '.join(EFFECTS)}; time of one core",
        "",
        *_gains(whole, names),
        *_within(whole, names),
        "",
        "our estimator's rms error over the oracle's, ratio of medians over seeds",
    ]
    for name in names:
        lines += ["", f"  {name:<34}" + "".join(f"{text:>16}" for text in REFERENCES)]
        for case, title in CASES.items():
            cells = [ratio(whole, name, motion, f"estimator, {case}") for motion in REFERENCES]
            lines.append(f"    {title:<32}" + "".join(f"{cell:>16.2f}" for cell in cells))
    lines += ["", "what was found; rms errors: medians over motions"]
    for row in rows:
        factor, told = unit(row["name"])
        added, alone_ = row["identified"]["added"], row["identified"]["alone"]
        head = f"  {row['name']} {row['seed']}: true effect {KINDS[row['name']].effect}; {added['verdict']}: "
        head += f"{', '.join(added['effects']) or 'nothing'}"
        if alone_["verdict"].startswith("not identified"):
            head += f"; LuGre alone: {alone_['verdict']}"
        medians = {key: factor * float(np.median(list(errors.values()))) for key, errors in row["errors"].items()}
        parts = []
        for arm in COMPARED:
            values = [f"{medians[f'{arm}, {case}']:.3g}" for case in CASES if f"{arm}, {case}" in medians]
            parts.append(f"{ARMS[arm]} {' to '.join(values)}")
        seconds = sum(part.get("seconds", 0) for part in row["identified"].values())
        lines.append(f"{head} ({seconds} s)")
        lines.append(f"    {told}: {'; '.join(parts)}; oracle {medians['oracle']:.3g}")
    return lines


def ratio(rows: list[dict], name: str, motion: str, arm: str, base: str = "oracle") -> float:
    """Median rms error over seeds, of one arm over another."""
    own = [row["errors"] for row in rows if row["name"] == name]
    return float(np.median([e[arm][motion] for e in own]) / np.median([e[base][motion] for e in own]))


def _gains(rows: list[dict], names: list[str]) -> list[str]:
    """Further gain over LuGre alone, over the seeds on which an effect was found."""
    lines, told = [], [row for row in rows if row["identified"]["added"]["effects"]]
    own = [name for name in names if any(row["name"] == name for row in told)]
    for arm in COMPARED:
        gains = {n: np.median([ratio(told, n, m, f"{arm}, added", f"{arm}, alone") for m in REFERENCES]) for n in own}
        lower = sum(gain < 1.0 for gain in gains.values())
        lines.append(
            f"{ARMS[arm]}, with the effect that was diagnosed: lower than LuGre alone in {lower} of {len(names)}"
        )
        told_gains = ", ".join(f"{name} {100 * (1 - gain):.0f} %" for name, gain in gains.items())
        lines.append(f"  plants (median over motions): {told_gains}")
    return lines


def _within(rows: list[dict], names: list[str]) -> list[str]:
    lines = []
    for case, title in CASES.items():
        ratios = [ratio(rows, name, motion, f"estimator, {case}") for name in names for motion in REFERENCES]
        within = sum(value <= WITHIN for value in ratios)
        middle = f"{np.median(ratios):.2f}" if ratios else "unknown"
        lines.append(
            f"{ARMS['estimator']}, {title}: within {WITHIN:g} times the oracle's in {within} of {len(ratios)} "
            f"settings; ratio median {middle}"
        )
    return lines
