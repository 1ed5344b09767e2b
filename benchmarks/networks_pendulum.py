"""What the measured pendulum tells a network with memory of slower swings: its loss beside that of known friction.

    FRICTIONPINN_DATA=... python benchmarks/networks_pendulum.py [--epochs 1500]

A black box with one bristle is trained through the motion on the training runs. Then maximum likelihood over
windows of 4 s on the same runs gives Coulomb + drag and viscous + drag friction; each stands in the network's place
(as a bristle of a milliradian and the rest), and the network's own loss is evaluated: residuals of the angle over half
swings, at the noise that its law leaves, the errors of their starts estimated anew. Beside it free runs of 4 s from the
measured state, of the training runs, of one of them alone, of the authors' validation runs and of the raw tail. Last
some viscous friction instead of Coulomb friction, by maximum likelihood on the training runs: what these hardly tell
apart, and the validation runs do, decides on the raw tail, which swings far less.
Then maximum likelihood on every run alone, beside the drag of all training runs: what friction and inertia each has.
And networks beside the drag that a diagnosis finds, the motion compared by the angle and by the rate, which was
differentiated from it: friction over slip velocity that each learns, and its free runs.
Writes benchmarks/results/networks_pendulum.txt.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from networks_measured import BESIDE, FROM_ANGLE, MOTION, fitted, found_model, plain_pendulum, rollout_error, trained

from frictionpinn.data.sets import FIT, HELD_OUT, load_public

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "networks_pendulum.txt"
NAME = "multiarm_pendulum"
ALONE = {"id_4": ["id_4"], "vad 1, 2": ["vad_1", "vad_2"], "raw tail": ["raw"]}
VISCOUS = (2e-5, 5e-5, 1e-4)  # N m s/rad
SPEEDS = (0.2, 1.0, 3.0)  # rad/s: the tail's, the slowest swings' of the validation runs, these runs' at the fastest
REACH = 1e-3  # rad, of a bristle that stands for Coulomb friction


def stands_in(model: Any, p: dict[str, float]) -> Any:
    """Tables of a short bristle that slides at mu_c, with sigma_2 + drag |v| beside it."""
    T, _, told = (x.detach() for x in type(model).tables(model))
    speed = model.knots[:, 0].abs().reshape(T.shape[1:])
    rows = torch.tensor([[p["mu_c"] / REACH], [0.0], [0.0], [1.0]], dtype=torch.float64)
    return torch.stack([torch.full_like(T[0], REACH), p["sigma_2"] + p["drag"] * speed]), rows, 0 * told


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


def by_run(drag: float) -> list[str]:
    """Coulomb friction and inertia that every run alone has beside the same drag, and how far it swings."""
    lines = [f"by maximum likelihood on one run, beside a drag of {drag:.3g} N m s^2/rad^2",
             f"{'':8}{'swings, rad':>14}{'Coulomb friction, N m':>24}{'inertia, kg m^2':>18}"]  # fmt: skip
    for trial in load_public(NAME, from_angle=True).trials:
        swing = np.abs(trial.signals["theta"] - np.pi)
        first, last = (float(swing[part].max()) for part in (slice(0, len(swing) // 4), slice(-len(swing) // 4, None)))
        found = plain_pendulum([trial.name], ("mu_c",), ("drag",), drag=drag, sigma_2=0.0)
        lines.append(f"{trial.name:8}{f'{first:.2f} to {last:.2f}':>14}{found['mu_c']:24.3g}{found['J']:18.4g}")
        print(lines[-1], flush=True)
    return lines


def by_comparison(epochs: int, folder: Path) -> list[str]:
    """What a network beside the drag learns of friction by the angle and by the rate, and its errors in free runs."""
    content = found_model("id_4", list(HELD_OUT[NAME]), folder)
    lines = ["bb1 with one bristle beside the drag that a diagnosis finds; free runs of 4 s, mrad",
             f"{'compared':10}" + "".join(f"{f'mN m at {v:g} rad/s':>20}" for v in SPEEDS)
             + "".join(f"{title:>12}" for title in ALONE)]  # fmt: skip
    for compared in ("position", "velocity"):
        options = ["model=bb1", "model.state.elements=1", MOTION, BESIDE, f"model.loss.compare={compared}"]
        system, model, data, _ = fitted(NAME, options, FIT[NAME], content, epochs, folder / compared)
        friction = model.friction()
        settled = [1e3 * float(friction.rates(v, 1.0, friction.settled(v, 1.0))[0]) for v in SPEEDS]
        errors = [rollout_error(model, system, [data.by_name[name] for name in names]) for names in ALONE.values()]
        lines.append(f"{compared:10}" + "".join(f"{F:20.3g}" for F in settled) + "".join(f"{e:12.2f}" for e in errors))
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
    lines += ["", *by_run(plain_pendulum(FIT[NAME], ("mu_c", "drag"), ("drag",), sigma_2=0.0)["drag"])]
    with tempfile.TemporaryDirectory() as other:
        lines += ["", *by_comparison(epochs, Path(other))]
    RESULT.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
