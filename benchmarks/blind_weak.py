"""Weak effects: what a diagnosis makes of 0.5 to 1.5 % of the friction force, which data tell or hardly tell.

    python benchmarks/blind_weak.py [--count 40] [--from-seed 1000]

Recordings of benchmarks/blind.py, the effects by turns and of a size drawn for each. Right is the effect that acts,
alone or listed as alike, and "nothing missing" where the data do not tell; wrong is another name alone, and a
remainder that is said to depend on what it does not. The effect that acts beside another name is counted by itself.
Every answer is kept in benchmarks/results/blind_weak.json and not asked for again; writes blind_weak.txt.
"""

from __future__ import annotations

import argparse
import json

import numpy as np
from blind import FIXED, NAMED, RESULTS, run

SHARE = (0.005, 0.015)  # of the friction force, root mean square
KINDS = [kind for kind in NAMED if kind not in FIXED]


def drawn(place: int, first: int) -> tuple[str, int, float]:
    """Effect, seed and share of a recording."""
    seed = first + place
    return KINDS[place % len(KINDS)], seed, float(np.random.default_rng(seed).uniform(*SHARE))


def answer(case: dict) -> str:
    """What a diagnosis said, in the words of the table."""
    if "failed" in case:
        return "failed"
    if case["verdict"] in ("nothing missing", "unexplained"):
        return case["verdict"]
    named = [{name, *alike} for name, alike in zip(case["effects"], case["alike"], strict=True)]
    hit = [any(item.split(" ")[0] == case["kind"] for item in group) for group in named]
    return "right" if all(hit) else "beside another" if any(hit) else "another name"


def report(cases: list[dict]) -> list[str]:
    """The table."""
    told = [answer(case) for case in cases]
    lines = [f"python benchmarks/blind_weak.py: {len(cases)} recordings, effects of {100 * SHARE[0]:g} to "
             f"{100 * SHARE[1]:g} % of the friction force", ""]  # fmt: skip
    lines += [f"{kind:18s}{told.count(kind):4d}" for kind in sorted(set(told), key=told.count, reverse=True)]
    seconds = [case["command_s"] for case in cases if "command_s" in case]
    lines += [
        "",
        f"seconds of a command: median {np.median(seconds):.0f}, nine of ten {np.quantile(seconds, 0.9):.0f}",
        "",
    ]
    for case, said in zip(cases, told, strict=True):
        names = " + ".join(
            name + (f" (alike: {', '.join(alike)})" if alike else "")
            for name, alike in zip(case.get("effects", []), case.get("alike", []), strict=True)
        )
        rest = f"; depends on {case['depends_on']}" if case.get("depends_on") else ""
        lines.append(f"{case['seed']} {case['kind']:20s}{100 * case['share']:5.2f} %  {said:16s}{names}{rest}")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--from-seed", type=int, default=1000)
    given = parser.parse_args()
    path = RESULTS / "blind_weak.json"
    done = json.loads(path.read_text()) if path.exists() else []
    known = {case["seed"] for case in done}
    for place in range(given.count):
        kind, seed, share = drawn(place, given.from_seed)
        if seed not in known:
            done.append(run(kind, seed, share) | {"share": share})
            path.write_text(json.dumps(done, indent=1) + "\n")
            print(seed, kind, answer(done[-1]), flush=True)
            (RESULTS / "blind_weak.txt").write_text("\n".join(report(done)) + "\n")
    print("\n".join(report(done)))


if __name__ == "__main__":
    main()
