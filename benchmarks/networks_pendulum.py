"""Why a network with memory alone is off on the measured pendulum's raw tail: its loss beside that of known friction.

    FRICTIONPINN_DATA=... python benchmarks/networks_pendulum.py [--epochs 1500]

A black box with one bristle is trained through the motion on the training runs. Then maximum likelihood over
windows of 4 s on the same runs gives Coulomb + drag and viscous + drag friction; each stands in the network's place
(the same bristle, its sliding force and the rest set), and the network's own loss is evaluated: residuals of the
velocity over half swings, the errors of their starts estimated anew. Beside it free runs of 4 s from the measured
state, of the training runs, of one of them alone, of the authors' validation runs and of the raw tail. Last some
viscous friction instead of Coulomb friction, by maximum likelihood on the training runs: what these hardly tell apart,
and the validation runs do, decides on the raw tail, which swings far less.
Then the two kinds that networks_measured.py finds best, the mean of trainings without one run each and one training
alone, with more or less of the ends of the runs left out, where a low-pass shows what they were padded with: friction
at low speeds, which these runs hardly tell, comes out another one each time.
Writes benchmarks/results/networks_pendulum.txt.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from networks_measured import (
    BAGGED,
    BESIDE,
    FROM_ANGLE,
    MOTION,
    fitted,
    found_model,
    plain_pendulum,
    rollout_error,
    trained,
)

from frictionpinn.data import sets
from frictionpinn.data.sets import FIT, HELD_OUT

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "networks_pendulum.txt"
NAME = "multiarm_pendulum"
ALONE = {"id_4": ["id_4"], "vad 1, 2": ["vad_1", "vad_2"], "raw tail": ["raw"]}
VISCOUS = (2e-5, 5e-5, 1e-4)  # N m s/rad
KINDS = {"bb1, three bristles": ["model=bb1", "model.state.elements=3"], "pe1": ["model=pe1"]}
ENDS = (2.0, 3.0, 6.0)  # periods of the cutoff that are left out


def stands_in(model: Any, p: dict[str, float]) -> Any:
    """Tables of the model's bristle in which mu_c N slides, and sigma_2 + drag |v| is left beside it."""
    T, rows, told = (x.detach() for x in type(model).tables(model))
    speed = model.knots[:, 0].abs().reshape(T.shape[1:])
    return (
        torch.stack([torch.full_like(T[0], p["mu_c"]) / rows[0, 0], p["sigma_2"] + p["drag"] * speed]),
        rows,
        0 * told,
    )


def loss_over_starts(model: Any, batch: dict[str, torch.Tensor]) -> float:
    """Loss of the motion, the errors of the starts those that fit best."""
    search = torch.optim.LBFGS(model.errors.parameters(), max_iter=200, line_search_fn="strong_wolfe")

    def loss() -> torch.Tensor:
        search.zero_grad()
        parts = model.losses(batch)
        total = parts["slip"] + parts["inputs"]
        total.backward()
        return total.detach()

    search.step(loss)
    return float(loss())


def without_ends(name: str, content: dict[str, Any], epochs: int) -> list[str]:
    """Validation runs and raw tail by what is left out of the runs' ends: one training beside a diagnosed model's
    effects, and the mean of four."""
    lines = [f"{name} through the motion {BESIDE}, trained on all training runs",
             f"{'':24}{'one training':>22}  {'mean of four':>22}",
             f"{'ends left out, periods':24}" + (2 * f"{'vad 1, 2':>12}{'raw tail':>10}  ").rstrip()]  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        for ends in ENDS:
            sets.PADDED, row = ends, f"{ends:<24g}"
            for way in ((), (BAGGED,)):
                place = Path(folder) / f"{ends:g} {len(way)}"
                options = [*KINDS[name], MOTION, BESIDE, *way]
                system, model, data, _ = fitted(NAME, options, FIT[NAME], content, epochs, place)
                check, tail = (rollout_error(model, system, [data.by_name[run] for run in ALONE[own]])
                               for own in ("vad 1, 2", "raw tail"))  # fmt: skip
                row += f"{check:12.2f}{tail:10.2f}  "
            lines.append(row.rstrip())
            print(lines[-1], flush=True)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--epochs", type=int, default=1500)
    epochs = parser.parse_args().epochs
    torch.set_num_threads(1)
    options = ["model=bb1", "model.state.elements=1", MOTION, FROM_ANGLE,
               f"system.parameters.J={plain_pendulum(FIT[NAME])['J']}"]  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        system, model, data, _ = trained(NAME, options, list(HELD_OUT[NAME]), epochs, Path(folder) / "run")
    arrays = [model.arrays(trial, "offline") for trial in data.select("train")]
    batch = {key: torch.from_numpy(np.concatenate([own[key] for own in arrays])) for key in arrays[0]}
    lines = [f"bb1 with one bristle through the motion, {epochs} steps; free runs of 4 s, mrad"]
    lines.append(f"{'':22} {'half its loss':>13}  {'training runs':>13}" + "".join(f"{title:>10}" for title in ALONE))

    def add(title: str) -> None:
        half = 0.5 * len(batch["v"]) * loss_over_starts(model, batch)
        alone = [[data.by_name[name] for name in names] for names in ALONE.values()]
        first, *others = (rollout_error(model, system, trials) for trials in (data.select("train"), *alone))
        lines.append(f"{title:22} {half:13.0f}  {first:13.2f}" + "".join(f"{error:10.2f}" for error in others))
        print(lines[-1], flush=True)

    add("network")
    cases = [("Coulomb + drag", ("mu_c", "drag"), {"sigma_2": 0.0}),
             ("viscous + drag", ("sigma_2", "drag"), {"mu_c": 1e-6})]  # fmt: skip
    cases += [(f"Coulomb + drag + {v:g} v", ("mu_c", "drag"), {"sigma_2": v}) for v in VISCOUS]
    for title, free, fixed in cases:
        tables = stands_in(model, plain_pendulum(FIT[NAME], free, ("drag",), **fixed))
        model.tables = lambda tables=tables: tables
        add(title)
    with tempfile.TemporaryDirectory() as folder:
        content = found_model("id_4", ["vad_1", "vad_2", "raw"], Path(folder))
    for name in KINDS:
        lines += ["", *without_ends(name, content, epochs)]
    RESULT.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
