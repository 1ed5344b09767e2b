"""Table and figure of estimators beside each other."""

from __future__ import annotations

import math
import statistics
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from ..show import Table, readable_unit
from .style import INK

LABELS = {
    "maximum_likelihood": "maximum likelihood",
    "pe1": "PE1",
    "pe2": "PE2",
    "least_squares": "least squares",
    "nelder_mead": "Nelder-Mead",
    "genetic": "genetic algorithm",
}
PER_PANEL = 50  # characters of a title above a panel
COLORS = {
    "maximum_likelihood": INK["model"],
    "pe1": "#edae49",
    "pe2": "#b5651d",
    "least_squares": "#2a9d8f",
    "nelder_mead": "#457b9d",
    "genetic": INK["baseline"],
}


def summary(runs: list[Mapping[str, Any]], key: str, name: str | None = None) -> tuple[float, float, float] | None:
    """Median, lowest and highest over the seeds of an entry (of ``values[name]`` where a name is given); None: none."""
    found = [run[key] if name is None else run[key].get(name) for run in runs]
    known = [value for value in found if value is not None]
    return (statistics.median(known), min(known), max(known)) if known else None


def rows(result: Mapping[str, Any]) -> Iterator[list[str]]:
    """Cells of the table, the heading first: median [lowest, highest] over the seeds; the truth last."""
    names = [name for name in result["units"] if name != "force_mse"]
    units = [readable_unit(result["units"][name]) for name in names]
    heads = [f"{name} ({unit})" if unit else name for name, unit in zip(names, units, strict=True)]
    force = readable_unit(result["units"]["force_mse"])
    yield [
        "estimator",
        *heads,
        "time (s)",
        "processor time (s)",
        "simulations",
        f"force error ({force})",
        "seeds complete",
    ]
    for method, runs in result["methods"].items():
        cells = [_cell(summary(runs, "values", name)) for name in names]
        cells += [_cell(summary(runs, key)) for key in ("seconds", "processor_seconds", "simulations", "force_mse")]
        told = sum(all(value is not None for value in run["values"].values()) for run in runs)
        yield [LABELS[method], *cells, f"{told} of {len(runs)}"]
    if result["truth"]:
        yield ["truth", *(f"{result['truth'].get(name, float('nan')):.3g}" for name in names), *["-"] * 5]


def _cell(found: tuple[float, float, float] | None) -> str:
    if found is None:
        return "-"
    middle, low, high = (f"{value:.3g}" for value in found)
    return middle if low == high else f"{middle} [{low}, {high}]"


def _text(cells: Sequence[Sequence[str]]) -> str:
    return Table(tuple(cells[0]), tuple(tuple(row) for row in cells[1:])).text()


def table(result: Mapping[str, Any]) -> str:
    """The table for a terminal."""
    cells = list(rows(result))
    first = len([name for name in result["units"] if name != "force_mse"]) + 1  # what these cost stands below
    effort = [[row[0], *row[first:]] for row in cells if row[first] != "-"]
    lines = [_text([row[:first] for row in cells]), "", _text(effort)]
    seeds = len(result["seeds"])
    several = f"median [lowest, highest] over {seeds} seeds; " if seeds > 1 else ""
    whole = [run.get("force_mean_square") for runs in result["methods"].values() for run in runs]
    unit = readable_unit(result["units"]["force_mse"])
    of = f" (mean square of the force itself: {whole[0]:.3g} {unit})" if whole and whole[0] is not None else ""
    lines.append(f"{several}force error: held-out trial simulated{of}; complete: every parameter was found")
    if result.get("start") is not None:
        label = LABELS.get(str(result["start"]), "")
        lines.append(
            f"started from {f'the parameters of {label}; its time is not counted' if label else result['start']}"
        )
    return "\n".join(lines)


def error_against_time(results: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Force error against processor time, a panel for each set of bounds, a line for each seed, a dot at its end."""
    figure = Figure(figsize=(1.5 + 5.2 * len(results), 4.8), layout="constrained")
    panels = figure.subplots(1, len(results), sharey=True, squeeze=False)[0]
    traces = [run["trace"] for result in results.values() for runs in result["methods"].values() for run in runs]
    # A start is at 0 s, which a logarithm has not: it is drawn where the first of all was measured.
    first = min((seconds for trace in traces for seconds, mse in trace if mse and seconds > 0), default=1.0)
    errors_seen = [mse for trace in traces for _, mse in trace if mse]
    for axis, (title, result) in zip(panels, results.items(), strict=True):
        for method, runs in result["methods"].items():
            for run in runs:
                way = [(max(seconds, first), mse) for seconds, mse in run["trace"] if mse]
                if not way:
                    continue
                times, errors = zip(*way, strict=True)
                axis.plot(times, errors, color=COLORS[method], lw=1.0, alpha=0.7, zorder=2)
                axis.plot(times[-1], errors[-1], "o", color=COLORS[method], ms=6, zorder=3)
        unit = readable_unit(result["units"]["force_mse"])
        axis.set(xscale="log", yscale="log", xlabel="processor time (s)", title=title)
        axis.grid(True, which="major", color="#e8ecf1", zorder=0)
    panels[0].set(ylabel=f"mean square error of the simulated force ({unit})")
    if errors_seen:  # a decade at least: estimators that differ by a percent are to look alike
        middle = math.sqrt(min(errors_seen) * max(errors_seen))
        low, high = panels[0].get_ylim()
        panels[0].set_ylim(min(low, middle / math.sqrt(10)), max(high, middle * math.sqrt(10)))
    shown = next(iter(results.values()))["methods"]
    for method in shown:
        panels[0].plot([], [], "o-", color=COLORS[method], label=LABELS[method])
    figure.legend(loc="outside lower center", ncols=3 * len(results), frameon=False, fontsize=9)
    title = "Identification: a line for each seed, a dot where the estimator ends"
    figure.suptitle(textwrap.fill(title, PER_PANEL * len(results)))
    return figure
