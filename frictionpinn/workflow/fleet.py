"""The summary of a fleet: many recordings diagnosed, in one table and on one page.

How many lack what, and where; and which stand out. A recording stands out

- by an effect that was found in less than a tenth of them, or
- by a number (a parameter that most have, the error on held-out trials) that lies further from the fleet's median than
  chance would bring one of all these numbers in a hundred fleets, spread as the median absolute deviation tells, and
  further than its own 95 % interval.

Source of the second: Iglewicz and Hoaglin, How to Detect and Handle Outliers (1993).
"""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jinja2 import Template

from ..show import LOOKS, readable_unit
from .manifest import Job, result_of, status_of, write_text
from .summary import as_csv

RARE = 0.1  # of the fleet: what fewer lack is that recording's own
CHANCE = 0.01  # of a fleet in which a number stands out by chance alone
LEAST = 3.5  # robust standard deviations at least: tails of such a spread are heavy
FEWEST = 8  # recordings by which a spread is told
MANY = 0.5  # of the fleet: parameters that fewer have are none of it
Result = Mapping[str, Any]


@dataclass(frozen=True)
class Member:
    """A recording of a fleet.

    Attributes:
        name: its varied options, of a path alone the file's name.
        folder: of its diagnosis.
        error: why there is none.
        result: as in ``result.json``, empty where there is none.
        stands_out: why.
    """

    name: str
    folder: str
    error: str = ""
    result: Result = field(default_factory=dict)
    stands_out: list[str] = field(default_factory=list)

    @property
    def effects(self) -> list[str]:
        """What it lacks."""
        return found(self.result) if self.result else []


def found(result: Result) -> list[str]:
    """Effects that a diagnosis found, of a robot with their joints."""
    return list(dict.fromkeys(e["name"].partition(" ")[0] for e in result["effects"]))


def left(result: Result) -> list[str]:
    """What no name fits: of a robot the joints."""
    rest = result.get("unexplained")
    if not rest:
        return []
    return [f"unexplained@{joint}" for joint in rest] if "robot" in result else ["unexplained"]


def errors(result: Result) -> tuple[float, float]:
    """Error before and after on held-out trials (else on all), of a robot relative to its torque, in the mean."""
    if "robot" not in result:
        return float(result["error"]["before"]), float(result["error"]["after"])
    every = result["torque_error"].values()
    told = [e for e in every if e["held_out"]] or list(every)
    before, after = (statistics.fmean(x for e in told for x in e[key]) for key in ("before", "after"))
    return before, after


def _in_unit(result: Result, value: float) -> str:
    if "robot" in result:
        return f"{100 * value:.3g} %"
    return f"{value:.4g} {readable_unit(result['error']['unit'])}".rstrip()


def line(result: Result) -> str:
    """A diagnosis in a line."""
    before, after = errors(result)
    lacks = ", ".join([*found(result), *left(result)]) or "nothing missing"
    return f"{lacks}; error {_in_unit(result, before)} -> {_in_unit(result, after)}"


def summarise(folder: Path, jobs: Sequence[Job], told: str) -> list[Member]:
    """Write fleet.csv and fleet.html to the sweep's folder, print the table; return the recordings."""
    members = stand_out([_member(job, folder) for job in jobs])
    table = counts(members)
    write_text(folder / "fleet.csv", _as_csv(members))
    write_text(folder / "fleet.html", page(members, table))
    done = [m for m in members if m.result]
    for name, where in table.items():
        whole = sum(1 for m in done if name in {e.partition("@")[0] for e in (*m.effects, *left(m.result))})
        places = ", ".join(f"{n} in {place.replace('_', ' ')}" for place, n in where.items() if place)
        print(f"  {name}: {whole} of {len(done)}" + (f" ({places})" if places else ""))
    for m in members:
        if m.stands_out:
            print(f"  stands out: {m.name}: {'; '.join(m.stands_out)}")
    print(f"{len(done)} of {len(members)} recordings diagnosed; fleet.csv and the page fleet.html are in {told}",
          flush=True)  # fmt: skip
    return members


def _member(job: Job, folder: Path) -> Member:
    result = result_of(folder / job.folder, job.digest)
    paths = [value.strip("'\"") for key, value in job.swept.items() if key == "data.path"]
    name = Path(paths[0]).name if len(job.swept) == 1 and paths else job.label
    if result is None:
        return Member(name, job.folder, str(status_of(folder / job.folder).get("error", "not finished")))
    return Member(name, job.folder, "", result)


def counts(members: Sequence[Member]) -> dict[str, dict[str, int]]:
    """Effect -> joint (empty where there is none) -> how many lack it there; what most lack first."""
    every = Counter(e for m in members if m.result for e in (*m.effects, *left(m.result)))
    table: dict[str, dict[str, int]] = {}
    for name, n in every.items():
        kind, _, where = name.partition("@")
        table.setdefault(kind, {})[where] = n
    return {
        kind: dict(sorted(table[kind].items()))
        for kind in sorted(table, key=lambda k: (k == "unexplained", -sum(table[k].values())))
    }


def stand_out(members: Sequence[Member]) -> list[Member]:
    """Tell of each recording in what it stands out, see the module."""
    done = [m for m in members if m.result]
    if len(done) < FEWEST:
        return list(members)
    common = Counter(e for m in done for e in m.effects)
    for m in done:
        m.stands_out.extend(f"{e}, in {common[e]} of {len(done)}" for e in m.effects if common[e] < RARE * len(done))
    numbers: dict[str, dict[int, tuple[float, float]]] = {"error on held-out trials": {}}
    for k, m in enumerate(done):
        numbers["error on held-out trials"][k] = errors(m.result)[1], 0.0
        for name, p in m.result["parameters"].items():
            if name.startswith(("inertia.", "robot.")) or not p.get("told", True) or p["value"] is None:
                continue
            low, high = (x if x is not None else p["value"] for x in p.get("ci95") or (p["value"],) * 2)
            numbers.setdefault(name, {})[k] = p["value"], max(high - p["value"], p["value"] - low)
    shared = {name: values for name, values in numbers.items() if len(values) > max(MANY * len(done), FEWEST - 1)}
    looks = sum(len(values) for values in shared.values())
    far = max(LEAST, -statistics.NormalDist().inv_cdf(CHANCE / (2 * looks)))
    for name, values in shared.items():
        middle = statistics.median(x for x, _ in values.values())
        spread = 1.4826 * statistics.median(abs(x - middle) for x, _ in values.values())
        for k, (x, reach) in values.items():
            if abs(x - middle) > max(far * spread, reach) and spread > 0:
                done[k].stands_out.append(f"{name} {x:.3g}, the fleet's median {middle:.3g}")
    return list(members)


def page(members: Sequence[Member], table: Mapping[str, Mapping[str, int]]) -> str:
    """The page, from ``fleet.html`` beside this file."""
    done = [m for m in members if m.result]
    rows = []
    for m in done:
        before, after = errors(m.result)
        rows.append((m, _in_unit(m.result, before), _in_unit(m.result, after), after))
    rows.sort(key=lambda row: (not row[0].stands_out, -row[3]))
    places = sorted({where for own in table.values() for where in own if where}, key=lambda w: (len(w), w))
    text = Template(Path(__file__).with_name("fleet.html").read_text(encoding="utf-8"))
    return text.render(
        looks=LOOKS, members=members, done=done, failed=[m for m in members if not m.result], rows=rows,
        table=table, places=places, whole=any("" in own for own in table.values()), left=left,
        clean=sum(1 for m in done if not m.effects and not left(m.result)), fewest=FEWEST,
    )  # fmt: skip


def _as_csv(members: Sequence[Member]) -> str:
    rows = []
    for m in members:
        row: dict[str, Any] = {"recording": m.name, "folder": m.folder, "error": m.error}
        if m.result:
            before, after = errors(m.result)
            row |= {"effects": " ".join(m.effects), "unexplained": " ".join(left(m.result)), "error_before": before,
                    "error_after": after, "stands_out": "; ".join(m.stands_out)}  # fmt: skip
            row |= {name: p["value"] for name, p in m.result["parameters"].items() if not name.startswith("inertia.")}
        rows.append(row)
    return as_csv(rows)
