"""What measured mechanisms lack beyond Coulomb and viscous friction: the presets of diagnose.py on three public sets.

    python benchmarks/diagnose_measured.py [--only emps,damper,pendulum]

Writes benchmarks/results/diagnose_measured.txt and diagnose_measured.json.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
BY_HAND = {
    "emps": "5.95 % before; 2.68 % with asymmetric viscous friction, delay, presliding, low-speed term",
    "damper": "86.5 % before, 26.4 % with presliding, 14.1 % with presliding, asymmetry and backlash",
    "pendulum": "8.84 mrad on the end of this run before (viscous, as published), 1.29 with Coulomb and drag",
}


def run(preset: str) -> dict:
    """One preset through the command line."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(ROOT / "diagnose.py"), f"preset={preset}", f"hydra.run.dir={folder}/out"]
        subprocess.run(command, check=True, cwd=folder, stdout=subprocess.DEVNULL)
        return json.loads((Path(folder) / "out" / "result.json").read_text())


def row(preset: str, r: dict) -> list[str]:
    """Lines of one set."""
    entry = next((e for e in r["errors"].values() if "relative" in e), r["error"])
    if preset == "pendulum":
        figures = [f"{1e3 * r['errors']['theta'][key]:.2f} mrad" for key in ("before", "after", "noise_floor")]
    else:
        figures = [f"{100 * entry['relative'][key]:.2f} %" for key in ("before", "after", "noise_floor")]
    effects = ", ".join(e["name"] for e in r["effects"]) or "none"
    rest = r["unexplained"] and f"; beyond them something depends on {' or '.join(r['unexplained']['depends_on'][:2])}"
    return [
        f"{preset:9s} before {figures[0]:>10s}  after {figures[1]:>10s}  noise {figures[2]:>10s}  {r['seconds']:.0f} s",
        f"          added: {effects}{rest or ''}",
        f"          by hand: {BY_HAND[preset]}",
        *(f"          {n} = {p['value']:.4g} {p['unit']} [{p['ci95'][0]:.4g}, {p['ci95'][1]:.4g}]"
          for e in r["effects"] for n, p in e["parameters"].items()),
        "",
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="emps,damper,pendulum")
    wanted = parser.parse_args().only.split(",")
    path = RESULTS / "diagnose_measured.json"
    done = json.loads(path.read_text()) if path.exists() else {}
    for preset in wanted:
        r = run(preset)
        keys = ("verdict", "effects", "error", "errors", "refused", "unexplained", "parameters", "seconds", "data")
        done[preset] = {key: r[key] for key in keys}
        path.write_text(json.dumps(done, indent=1))
        print("\n".join(row(preset, r)), flush=True)
    head = "python benchmarks/diagnose_measured.py: error on held-out trials; declared is Coulomb + viscous friction"
    rows = [line for preset in BY_HAND if preset in done for line in row(preset, done[preset])]
    lines = [head, "", *rows]
    (RESULTS / "diagnose_measured.txt").write_text("\n".join(lines))


if __name__ == "__main__":
    main()
