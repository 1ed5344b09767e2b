"""The effect that nobody declared: diagnosed on recordings with the PID alone, and added before compensating.

python benchmarks/compensation.py --diagnosed
"""

from __future__ import annotations

import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
from compensation import ARMS, DELAY, FIRST, closed, compensator, figures, made
from compensation_learned import alone, declared
from compensation_oracle import WITHIN
from compensation_plants import KINDS, Draw, draw
from compensation_report import save

from frictionpinn.control.record import recorded
from frictionpinn.errors import UserError
from frictionpinn.workflow.compensate import identified

EFFECTS = ("asymmetry", "position_friction", "ripple")  # that a diagnosis tries: those of the axes
TRIED = ("slow triangle", "reversing sine", "point to point", "multisine")
SEEDS = (FIRST, FIRST + 1)  # without and with the load
COMPARED = ("feedforward", "estimator")
RATE = 100.0  # Hz, of the recording: encoder and torque are averaged to it


def diagnosed(chosen: dict) -> None:
    """Rms error of LuGre alone and with what the diagnosis added, both identified from the same recording."""
    lines = [
        "python benchmarks/compensation.py --diagnosed",
        f"identified from 12 s with the PID alone (encoder and torque at {RATE:g} Hz), started from what is believed,",
        f"20 % wrong; effects tried: {', '.join(EFFECTS)}; rms error, LuGre alone and with what the",
        f"diagnosis added, medians over {', '.join(TRIED)}",
        "",
    ]
    rows = []
    for name in KINDS:
        for seed in SEEDS:
            try:
                rows.append(_diagnosed(chosen, name, seed))
                lines.append(rows[-1]["line"])
            except UserError as error:
                lines.append(f"  {name} {seed}: could not be identified ({error})")
            print(lines[-1], flush=True)
            save("diagnosed", [*lines, "", *_verdicts(rows)])


def _verdicts(rows: list[dict]) -> list[str]:
    lines = []
    for arm in COMPARED:
        gained = {name: [r[arm] for r in rows if r["name"] == name and r["found"]] for name in KINDS}
        better = [
            f"{name} ({', '.join(f'{100 * (1 - gain):.0f} %' for gain in gains)} lower)"
            for name, gains in gained.items()
            if gains and max(gains) < 1.0
        ]
        lines.append(
            f"{ARMS[arm]}: a lower median with the added effect, on every seed where one was added, in {len(better)} "
            f"of {len(KINDS)} plants: {', '.join(better) or 'none'}"
        )
    for case in ("alone", "added"):
        ratios = [ratio for row in rows for ratio in row["ratios"][case]]
        within = sum(ratio <= WITHIN for ratio in ratios)
        lines.append(
            f"{ARMS['estimator']}, {case}: within {WITHIN:g} times the oracle's rms error in {within} of {len(ratios)} "
            f"motions; ratio median {np.median(ratios) if ratios else np.nan:.2f}"
        )
    return lines


def _diagnosed(chosen: dict, name: str, seed: int) -> dict:
    kind, it = KINDS[name], draw(name, seed)
    own = declared(it)
    law = [par.name for par in own.law.parameters if par.value is None]
    free = [*law, *(key for key, value in own.system.values.items() if value)]
    recording = recorded(alone(name, it), own, DELAY, RATE)
    options = {"free": free, "start": {key: it.believed[key] for key in free}}
    begun, models = time.time(), {}
    with tempfile.TemporaryDirectory() as place:
        for case, effects in (("alone", ()), ("added", EFFECTS)):
            mechanism, values, verdict = identified(own, recording, Path(place), effects=list(effects), **options)
            models[case] = (Draw(it.plant, mechanism, values, it.loaded), verdict)
    seconds = time.time() - begun
    errors = {
        (arm, case): _errors(name, seed, made(chosen, name, arm), found)
        for arm in COMPARED
        for case, (found, _) in models.items()
    }
    best = np.array([figures(closed(name, m, seed, partial(compensator, "oracle")))["rms"] for m in TRIED])
    found, verdict = models["added"]
    names = [effect.name for effect in found.model.effects]
    medians = {key: float(np.median(values)) for key, values in errors.items()}
    cells = "; ".join(
        f"{ARMS[arm]} {1e6 * medians[arm, 'alone']:.3g} to {1e6 * medians[arm, 'added']:.3g}" for arm in COMPARED
    )
    return {
        "name": name,
        "found": bool(names),
        "line": f"  {name} {seed}: true effect {kind.effect}; {verdict}: {', '.join(names) or 'nothing'} "
        f"({seconds:.0f} s); rms in µ: {cells}; oracle {1e6 * np.median(best):.3g}",
        "ratios": {case: (errors["estimator", case] / best).tolist() for case in models},
        **{arm: medians[arm, "added"] / medians[arm, "alone"] for arm in COMPARED},
    }


def _errors(name: str, seed: int, make, found: Draw) -> np.ndarray:
    return np.array([figures(closed(name, motion, seed, make, lambda _: found))["rms"] for motion in TRIED])
