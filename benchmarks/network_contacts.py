"""PE2 on a mechanism with two contacts: online force error of each, beside what one contact alone gives.

    python benchmarks/network_contacts.py --seeds 0 1 2 [--models pe2 pe2,memory]
    python benchmarks/network_contacts.py --report       # of the trainings that were made so far

The trials of conf/system/pob_hinge.yaml with 5 % noise on every signal, the last held out, at 200 Hz, 600 epochs. Both:
friction at box and hinge, learned at once. Alone: the same mechanism and inputs with friction at one of them only, the
other declared without. ``pe2,memory`` is experiment=memory, which follows the measured slip velocities with
several contacts. The error is that of the force from causal signals on the held-out trial, against the truth.
A training's errors are kept in benchmarks/results/network_contacts.json and not made again.
"""

from __future__ import annotations

import argparse
import json
import logging
import tempfile
import time
from pathlib import Path

import numpy as np

from frictionpinn.workflow.options import composed
from frictionpinn.workflow.train import train

RESULTS = Path(__file__).resolve().parent / "results"
CONTACTS, RATE, EPOCHS = ("box", "hinge"), 200, 600
CASES = {"both": CONTACTS, **{contact: (contact,) for contact in CONTACTS}}


def trained(own: tuple[str, ...], model: str, seed: int) -> dict:
    """Errors by contact of one training on a mechanism with friction at ``own`` alone, and its seconds."""
    name, _, memory = model.partition(",")
    options = ["experiment=memory"] if memory else []
    options += [f"model={name}", "system=pob_hinge", f"seed={seed}", f"data.rate_hz={RATE}"]
    options += [f"trainer.max_epochs={EPOCHS}", "trainer.progress_bar=false", "trainer.threads=1"]
    options += [f"friction.{contact}=none" for contact in CONTACTS if contact not in own]
    cfg, begin = composed("train", options), time.process_time()
    cfg["data"]["friction"] = {contact: "lugre" if contact in own else "none" for contact in CONTACTS}
    cfg["data"]["truth"] = {contact: cfg["data"]["truth"][contact] for contact in own}
    with tempfile.TemporaryDirectory() as folder:
        errors = train(cfg, Path(folder))["force_error"]["contacts"]
    table = {contact: {key: error[key]["rmse"] for key in ("model", "coulomb_viscous")}
             | {"force": error["model"]["reference_rms"]} for contact, error in errors.items()}  # fmt: skip
    return {"errors": table, "seconds": time.process_time() - begin}


def summary(model: str, kept: dict) -> list[str]:
    """Lines of the table of one variant."""
    unit, lines = {"box": "N", "hinge": "N m"}, [f"{model}, root mean square error of the online force"]
    heads = ("contact", "", "seed", "both", "alone", "ratio", "ratio of shares", "Coulomb + viscous fit, both")
    lines.append("{:8s} {:4s} {:>5s} {:>9s} {:>9s} {:>6s} {:>16s} {:>28s}".format(*heads))
    for contact in CONTACTS:
        seeds = sorted(set(kept["both"]) & set(kept[contact]), key=int)
        both, alone = ([kept[case][seed]["errors"][contact] for seed in seeds] for case in ("both", contact))
        ratios = [a["model"] / b["model"] for a, b in zip(both, alone, strict=True)]
        shares = [r * b["force"] / a["force"] for r, a, b in zip(ratios, both, alone, strict=True)]
        for k, seed in enumerate(seeds):
            lines.append(f"{contact:8s} {unit[contact]:4s} {seed:>5s} {both[k]['model']:9.4f} {alone[k]['model']:9.4f} "
                         f"{ratios[k]:6.2f} {shares[k]:16.2f} {both[k]['coulomb_viscous']:28.4f}")  # fmt: skip
        if seeds:
            lines.append(f"{contact:8s} median over {len(seeds)} seeds: ratio {np.median(ratios):.2f}, "
                         f"of shares of the force {np.median(shares):.2f}")  # fmt: skip
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--models", nargs="+", default=["pe2"])
    parser.add_argument("--report", action="store_true")
    args = parser.parse_args()
    logging.disable(logging.WARNING)
    path, lines = RESULTS / "network_contacts.json", [f"{RATE} Hz, {EPOCHS} epochs, 5 % noise"]
    kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for seed in [] if args.report else args.seeds:
        for model in args.models:
            for case, own in CASES.items():
                table = kept.setdefault(model, {}).setdefault(case, {})
                if str(seed) not in table:
                    table[str(seed)] = trained(own, model, seed)
                    path.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
                    print(model, case, seed, table[str(seed)], flush=True)
    for model, cases in kept.items():
        lines += ["", *summary(model, cases)]
    (RESULTS / "network_contacts.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
