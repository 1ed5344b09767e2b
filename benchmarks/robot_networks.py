"""Networks for the joints of the UR10e: torque error of every variant on motions that it has not seen.

    python benchmarks/robot_networks.py

Each is trained on ``50sec`` and ``30sec`` by ``train.py experiment=ur10e model=...``; a step of pe1 and pe2, which see
rates, takes three times as long as one of a black box, and they get half as many. Beside them, on the same recordings,
Coulomb + viscous friction and an offset, and what networks begin at: LuGre in every joint, friction that may grow with
the load, an offset. Results go to results/robot_networks.txt; runs that are in ``--folder`` already are not repeated.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from frictionpinn.workflow.options import composed
from frictionpinn.workflow.train import train

RESULTS = Path(__file__).parent / "results" / "robot_networks.txt"
EPOCHS = {"bb1": 300, "bb2": 300, "pe1": 150, "pe2": 150}


def run(name: str, folder: Path) -> dict:
    """The result of a training."""
    if (folder / "result.json").is_file():
        return json.loads((folder / "result.json").read_text(encoding="utf-8"))
    folder.mkdir(parents=True)
    options = ["experiment=ur10e", f"model={name}", f"trainer.max_epochs={EPOCHS[name]}", "trainer.threads=1"]
    return train(composed("train", options), folder)


def told(results: dict[str, dict]) -> str:
    """The table."""
    lines = ["relative torque error in %, joints 1 to 6 and their mean; epochs, seconds by the clock of one thread"]
    first = next(iter(results.values()))
    for trial in first["data"]["trials"]["held_out"]:
        lines.append(f"{trial}, held out")
        rows = {"Coulomb + viscous": first["torque_error"][trial]["coulomb_viscous"],
                "LuGre, load, identified": first["torque_error"][trial]["identified"]}  # fmt: skip
        rows |= {name: result["torque_error"][trial]["model"] for name, result in results.items()}
        for name, errors in rows.items():
            spent = ""
            if name in results:
                t = results[name]["training"]
                spent = f"{t['epochs']:7d} {t['seconds']['training']:6.0f} s"
            joints = "".join(f"{100 * x:6.1f}" for x in errors)
            lines.append(f"  {name:<24}{joints} {100 * np.mean(errors):7.2f}{spent}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=None)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        text = told({name: run(name, folder / name) for name in EPOCHS})
    RESULTS.write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
