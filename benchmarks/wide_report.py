"""Tables of benchmarks/wide.py: one label, or two beside each other on the seeds that both have.

    python benchmarks/wide_report.py identify before [after]
    python benchmarks/wide_report.py diagnose before [after]      (without arguments: every file of results)

Writes benchmarks/results/wide_<mode>_<label>.txt, or wide_<mode>_<before>_<after>.txt.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np

RESULTS = Path(__file__).resolve().parent / "results"
BEHIND = 2.0  # in log-likelihood, of a fit from the truth at the same noise levels
NORMAL = 0.6745  # median size of a standard normal variable
FLOOR = 1.05  # of the noise: held-out errors below are as good as they can be
CLEAR = 6.0  # least standard errors: a strength beyond shows for certain
NAMES = ("sigma_0", "sigma_1", "sigma_2", "mu_c", "mu_s", "v_s")
LAWS = ("lugre", "stribeck", "coulomb_viscous")
NOTES = {
    "identify": """behind: cost above that of the Levenberg-Marquardt fit from the truth, same noise levels, in
log-likelihood; error / bound: errors of the logarithm over the Cramer-Rao bound's relative standard error at the true
noise levels, root mean square and, in brackets, median over that of a normal variable (1 where efficient); not behind:
of the fits that are not behind; inside 95 %: intervals that hold the truth, of the told""",
    "diagnose": """right: the true effect first in the answer or listed as alike to one that is; of two
also one, the other said to be no more than a change of its parameters (a constant force beside a spring shifts where
that is relaxed); clear: every strength is more than 6 least standard errors (Cramer-Rao, fitted trials) from zero;
floor: noise of the slip velocity in the held-out trials; intervals: of clean recordings and of those whose answer is
right""",
}


def report(mode: str, labels: list[str]) -> str:
    """Write and return the table of a label, or of several on the seeds that all have."""
    found = {label: json.loads((RESULTS / f"wide_{mode}_{label}.json").read_text()) for label in labels}
    shared = set.intersection(*({c["seed"] for c in cases} for cases in found.values()))
    found = {label: [c for c in cases if c["seed"] in shared] for label, cases in found.items()}
    columns = {label: (_identify if mode == "identify" else _diagnose)(cases) for label, cases in found.items()}
    rows = list(dict.fromkeys(row for column in columns.values() for row in column))
    asked = "--imposed " * all(c.get("imposed") for cases in found.values() for c in cases) + f"--{mode}"
    lines = [f"python benchmarks/wide.py {asked}: {len(shared)} drawn recordings, seeds {_ranges(shared)}"]
    lines += [f"{label}: commit {', '.join(sorted({c.get('commit') or '?' for c in cases}))}"
              for label, cases in found.items()]  # fmt: skip
    lines += ["", f"{'':44s}" + "".join(f"{label:>24s}" for label in labels)]
    lines += [f"{row:44s}" + "".join(f"{columns[label].get(row, ''):>24s}" for label in labels) for row in rows]
    lines += ["", NOTES[mode], ""]
    for label, cases in found.items():
        lines += [f"{label}, every case:", *map(_identified if mode == "identify" else _diagnosed, cases), ""]
    text = "\n".join(lines)
    (RESULTS / f"wide_{mode}_{'_'.join(labels)}.txt").write_text(text)
    return text


# identification -----------------------------------------------------------------------------------------------
def behind(case: dict) -> float:
    """Log-likelihood by which a fit stays behind the one from the truth; NaN where there is none."""
    ends = case.get("cost"), case.get("cost_from_truth")
    return np.nan if None in ends else ends[0] - ends[1]


def ratio(case: dict, name: str) -> float:
    """Error of the logarithm over the bound; NaN where the estimate or the bound tells nothing."""
    value, least, truth = case["values"].get(name), case["bound"].get(name), case["truth"][name]
    return np.log(value / truth) * truth / least if value and least and value > 0 else np.nan


def _identify(cases: list[dict]) -> dict[str, str]:
    good = [c for c in cases if "failed" not in c]
    lost = [c for c in good if behind(c) > BEHIND]
    rows = {
        "failed": _share(len(cases) - len(good), len(cases)),
        f"behind by more than {BEHIND:g}": _share(len(lost), len(good)),
        "behind by more than 20": _share(sum(behind(c) > 20 for c in good), len(good)),
        f"ahead by more than {BEHIND:g}": _share(sum(behind(c) < -BEHIND for c in good), len(good)),
        "no fit from the truth": _share(sum(np.isnan(behind(c)) for c in good), len(good)),
    }
    for key in ("law", "system"):
        for value in sorted({c[key] for c in good}):
            own = [c for c in good if c[key] == value]
            rows[f"  behind: {value}"] = _share(sum(c in lost for c in own), len(own))
    for name in NAMES:
        rows[f"every law, {name}: error / bound"] = _spread([ratio(c, name) for c in good if name in c["truth"]])
    rows["inside 95 %, every law"] = _inside(good, NAMES)
    for law in LAWS:
        for name in NAMES:
            own = [c for c in good if c["law"] == law and name in c["truth"]]
            if own:
                rows[f"{law} {name}: error / bound"] = _spread([ratio(c, name) for c in own])
                rows[f"  {law} {name}, not behind"] = _spread([ratio(c, name) for c in own if c not in lost])
                rows[f"  {law} {name}, inside 95 %"] = _inside(own, [name])
    for law in LAWS:
        own = [c for c in good if c["law"] == law]
        rows[f"inside 95 %, {law}"] = _inside(own, NAMES)
        rows[f"inside 95 %, {law}, not behind"] = _inside([c for c in own if c not in lost], NAMES)
    rows |= {f"outcome: {k}": str(n) for k, n in Counter(c["outcome"] for c in good).most_common()}
    return rows | _times(good)


def _identified(case: dict) -> str:
    if "failed" in case:
        return f"{case['seed']:6d} failed: {' '.join(case['failed'])}"
    far = ", ".join(f"{n} {d:.1f}" for n, d in case["distance"].items() if d is not None and abs(d) > 3)
    return (
        f"{_about(case)} {case['outcome']:15s} behind {behind(case):9.1f} {case['seconds']:6.1f} s"
        f"  {'standard errors off: ' + far if far else ''}"
    )


# diagnosis ----------------------------------------------------------------------------------------------------
def named(case: dict) -> str:
    """How an answer names the truth: alone, first, alike, one of two; or wrong, nothing, unexplained, failed."""
    if "failed" in case:
        return "failed"
    truth, told = case["true_effects"], case["effects"]
    every = {*told, *(name for alike in case["alike"] for name in alike)}
    if not truth:
        return {"nothing missing": "alone", "effect found": "wrong"}.get(case["verdict"], "unexplained")
    if set(told) == set(truth):
        return "alone"
    if len(truth) == 1 and told[:1] == truth:
        return "first"
    if (set(truth) <= every) if len(truth) > 1 else truth[0] in every:
        return "alike"
    if set(truth) & every and set(truth) <= every | {*case.get("inseparable", ())}:
        return "alike"
    if set(truth) & every:
        return "one of two"
    return {"nothing missing": "nothing", "effect found": "wrong"}.get(case["verdict"], "unexplained")


def right(case: dict) -> bool:
    """Whether an answer counts as right."""
    return named(case) in ("alone", "first", "alike")


def _clear(case: dict) -> bool:
    return all(z is not None and z > CLEAR for z in case.get("shows", {}).values())


def _diagnose(cases: list[dict]) -> dict[str, str]:
    groups = [[c for c in cases if len(c.get("true_effects", ())) == n] for n in range(3)]
    clean, single, pairs = groups
    rows = {
        "right, of all": _share(sum(map(right, cases)), len(cases)),
        "clean: nothing missing": _share(sum(map(right, clean)), len(clean)),
        "clean: false alarms": _share(sum(named(c) == "wrong" for c in clean), len(clean)),
        "clean: unexplained": _share(sum(named(c) == "unexplained" for c in clean), len(clean)),
        "one effect: right": _share(sum(map(right, single)), len(single)),
    }
    for kind in ("alone", "first", "alike", "wrong", "nothing", "unexplained"):
        rows[f"  {kind}"] = _share(sum(named(c) == kind for c in single), len(single))
    clear = [c for c in single if _clear(c)]
    rows["one effect, clear: right"] = _share(sum(map(right, clear)), len(clear))
    rows["two effects: both right"] = _share(sum(map(right, pairs)), len(pairs))
    rows["  one of two"] = _share(sum(named(c) == "one of two" for c in pairs), len(pairs))
    rows["failed"] = _share(sum("failed" in c for c in cases), len(cases))
    rows["  timeout"] = str(sum(c.get("failed") == ["timeout"] for c in cases))
    good = [c for c in cases if "failed" not in c]
    near = [c["error"]["after"] / c["error"]["noise_floor"] <= FLOOR for c in good]
    rows[f"held-out error at most {FLOOR:g} of the floor"] = _share(sum(near), len(near))
    every = [max(c["errors"].values()) <= FLOOR for c in good if c["errors"]]
    rows["  of every signal and of the friction force"] = _share(sum(every), len(every))
    told = [c for c in good if right(c)]
    for law in LAWS:
        rows[f"intervals of the law, {law}"] = _inside([c for c in told if c["law"] == law], NAMES)
    rows["intervals of the effects"] = _inside(told, {n for c in told for n in c["true_values"]})
    rows["intervals of every parameter"] = _inside(told, {n for c in told for n in c["inside"]})
    for law in LAWS:
        own = [c for c in cases if c.get("law") == law]
        rows[f"right: {law}"] = _share(sum(map(right, own)), len(own))
    for system in sorted({c["system"] for c in cases if "system" in c}):
        own = [c for c in cases if c.get("system") == system]
        rows[f"right: {system}"] = _share(sum(map(right, own)), len(own))
    return rows | _times(cases)


def _diagnosed(case: dict) -> str:
    if "system" not in case:
        return f"{case['seed']:6d} failed: {' '.join(case['failed'])}"
    shows = "/".join(f"{z:.0f}" if z is not None else "-" for z in case["shows"].values())
    told = "+".join(case.get("effects", ())) or case.get("verdict", " ".join(case.get("failed", ())))
    alike = ", ".join(name for names in case.get("alike", ()) for name in names)
    ratio = f"{case['error']['after'] / case['error']['noise_floor']:6.3f}" if "error" in case else f"{'':6s}"
    return (
        f"{_about(case)} {named(case):11s} truth {'+'.join(case['true_effects']) or 'clean':34s} shows {shows:9s}"
        f" after/floor {ratio} {case['seconds']:6.1f} s  {told}{f' (alike: {alike})' if alike else ''}"
    )


# both ---------------------------------------------------------------------------------------------------------
def _about(case: dict) -> str:
    quantised = "q" if case["quantised"] else " "
    return (
        f"{case['seed']:6d} {case['system']:8s} {case['law']:15s} {case['rate_hz']:5.0f} Hz {case['trials']:2d} trials "
        f"{case['samples']:5d} {100 * case['level']:4.1f} %{quantised}"
    )


def _share(count: int, of: int) -> str:
    return f"{count} of {of}" + (f" ({100 * count / of:.0f} %)" if of else "")


def _spread(ratios: list[float]) -> str:
    r = np.abs([x for x in ratios if np.isfinite(x)])
    return f"{np.sqrt(np.mean(r**2)):.2f} ({np.median(r) / NORMAL:.2f}), n {len(r)}" if len(r) else "none told"


def _inside(cases: list[dict], names) -> str:
    told = [v for c in cases for n, v in c["inside"].items() if n in names]
    return _share(sum(told), len(told))


def _times(cases: list[dict]) -> dict[str, str]:
    rows = {}
    for key, what in (("seconds", "wall"), ("processor_s", "processor")):
        s = [c[key] for c in cases if key in c]
        told = (np.median(s), np.quantile(s, 0.9), max(s)) if s else ()
        rows[f"{what} s: median, nine of ten, longest"] = ", ".join(f"{x:.0f}" for x in told)
    return rows


def _ranges(seeds: set[int]) -> str:
    first = [s for s in sorted(seeds) if s - 1 not in seeds]
    last = [s for s in sorted(seeds) if s + 1 not in seeds]
    return ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in zip(first, last, strict=True))


if __name__ == "__main__":
    asked = [(sys.argv[1], sys.argv[2:])] if sys.argv[1:] else []
    for path in [] if asked else sorted(RESULTS.glob("wide_*_*.json")):
        _, mode, label = path.stem.split("_", 2)
        asked.append((mode, [label]))
    for mode, labels in asked:
        print(report(mode, labels))
