"""What a residual should cost where a law has no memory: Student's t with 4 or 10 degrees of freedom, or squares.

    python benchmarks/identify_loss.py [--seeds 0 60] [--only stribeck]

Recordings of benchmarks/wide.py on which it was developed (seeds below 1000), with laws without memory and no effect:
root mean square over them of the error over the Cramer-Rao bound, parameter by parameter, and the share of 95 %
intervals that hold the truth. Every fit is kept in benchmarks/results/identify_loss.json and not made again.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from wide import declared, draw, least_errors

from frictionpinn.errors import UserError
from frictionpinn.identify import maximum_likelihood
from frictionpinn.numerics.loss import LOSSES, StudentT

RESULTS = Path(__file__).resolve().parent / "results"
COMPARED = {"t, 4": StudentT(4.0), "t, 10": StudentT(10.0), "gaussian": LOSSES["gaussian"]}
MEMORYLESS = ("coulomb_viscous", "stribeck")


def fitted(seed: int, law: str, loss: str) -> dict | None:
    """Errors over the bound, and whether the interval holds the truth; None where the law is another one."""
    case = draw(seed, effects=False)
    if case.law != law:
        return None
    LOSSES["compared"] = COMPARED[loss]
    try:
        found = maximum_likelihood(declared(case), case.recording, loss="compared")
    except UserError as error:
        return {"error": str(error)}
    least, truth = least_errors(case), case.truth
    told = [name for name in found.names if least.get(name)]
    return {
        "off": {name: float((found.values[name] - truth[name]) / least[name]) for name in told},
        "inside": {name: bool(found.ci95[name][0] <= truth[name] <= found.ci95[name][1]) for name in told},
    }


def table(done: dict[str, dict[str, dict]], law: str) -> list[str]:
    """Lines on one law: recordings that were fitted with all of the losses."""
    own = {seed: by for seed, by in done.items() if all(by.get(f"{law}, {loss}", {}).get("off") for loss in COMPARED)}
    lines = [f"{law}: {len(own)} recordings"]
    names = sorted({name for by in own.values() for name in by[f"{law}, gaussian"]["off"]})
    for loss in COMPARED:
        cells = []
        for name in names:
            off = [by[f"{law}, {loss}"]["off"][name] for by in own.values() if name in by[f"{law}, {loss}"]["off"]]
            cells.append(f"{name} {np.sqrt(np.mean(np.square(off))):.2f}")
        inside = [x for by in own.values() for x in by[f"{law}, {loss}"]["inside"].values()]
        lines.append(
            f"  {loss:9s} " + "  ".join(f"{cell:12s}" for cell in cells) + f"  in 95 %: {100 * np.mean(inside):.0f} %"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs=2, default=[0, 60])
    parser.add_argument("--only", nargs="+", default=list(MEMORYLESS), choices=MEMORYLESS)
    given = parser.parse_args()
    path = RESULTS / "identify_loss.json"
    done = json.loads(path.read_text()) if path.exists() else {}
    for seed in range(*given.seeds):
        for law in given.only:
            for loss in COMPARED:
                if f"{law}, {loss}" not in done.get(str(seed), {}) and (found := fitted(seed, law, loss)):
                    done.setdefault(str(seed), {})[f"{law}, {loss}"] = found
                    path.write_text(json.dumps(done, indent=1) + "\n")
                    print(seed, law, loss, found, flush=True)
    lines = ["python benchmarks/identify_loss.py: error over the bound, laws without memory; columns by parameter", ""]
    for law in MEMORYLESS:
        lines += table(done, law)
    (RESULTS / "identify_loss.txt").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
