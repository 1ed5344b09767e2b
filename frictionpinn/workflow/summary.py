"""The summary of a sweep: a row for each run, mean and spread over seeds, on the terminal, as files and as a figure."""

from __future__ import annotations

import csv
import io
import math
import statistics
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..evaluate.picture import save_png
from ..show import unit_of_error
from .manifest import Job, result_of, status_of, whole, write_text
from .summary_figure import summary_figure

Row = dict[str, Any]
OWN = ("job", "folder", "state")


def summarise_sweep(folder: Path, jobs: Sequence[Job], told: str) -> list[Row]:
    """Write summary.csv, groups.csv and summary.png to the sweep's folder, print the table; return the rows."""
    rows = [row(job, folder) for job in jobs]
    swept = list(dict.fromkeys(key for job in jobs for key in job.swept))
    grouped = groups(rows, swept)
    write_text(folder / "summary.csv", as_csv(rows))
    write_text(folder / "groups.csv", as_csv(grouped))
    keys = group_keys(swept)
    if any("force_rmse" in item for item in rows):
        figure = summary_figure(rows, grouped, keys)
        with whole(folder / "summary.png") as temporary:
            save_png(figure, temporary)
    print_table(grouped, keys)
    finished = sum(item["state"] == "finished" for item in rows)
    files = "summary.csv, groups.csv" + (" and summary.png" if (folder / "summary.png").exists() else "")
    print(f"{finished} of {len(rows)} jobs finished; {files} are in {told}", flush=True)
    return rows


def row(job: Job, folder: Path) -> Row:
    """One job: its options, then force errors, loss and parameters; nothing that differs from run to run by chance.

    ``force_rmse`` is on held-out trials, in ``force_unit``; ``force_relative`` is over the root mean square force;
    ``<parameter>`` in SI units, ``<parameter>_off`` relative to the truth where it is known; ``refined_...`` likewise.
    """
    own: Row = {"job": job.number, "folder": job.folder, "state": "finished", **job.swept}
    result = result_of(folder / job.folder, job.digest)
    if result is None:
        status = status_of(folder / job.folder)
        state = "failed" if status["state"] == "failed" else "unfinished"
        return {**own, "state": state, "error": status.get("error", "")}
    error = result["force_error"]
    own |= {"system": result["system"], "model": result["model"], "seed": result["training"]["seed"]} | own
    own |= {
        "force_rmse": error["model"]["rmse"],
        "force_unit": error["unit"]["rmse"],
        "force_relative": error["model"]["relative"],
        "coulomb_viscous_rmse": error["coulomb_viscous"]["rmse"],
        "loss": result["training"]["loss"].get("loss"),
        "epochs": result["training"]["epochs"],
    }
    tables = {"": result["parameters"], "refined_": result.get("refined", {}).get("parameters", {})}
    for prefix, table in tables.items():
        for name, entry in table.items():
            own[f"{prefix}{name}"] = entry["value"]
            if entry.get("truth") and entry["value"] is not None:
                own[f"{prefix}{name}_off"] = entry["value"] / entry["truth"] - 1
    return own


def group_keys(swept: Sequence[str]) -> list[str]:
    """The varied options that are no mere repetition."""
    return [key for key in swept if key != "seed"]


def groups(rows: Sequence[Row], swept: Sequence[str]) -> list[Row]:
    """Mean and standard deviation over the runs that differ in nothing but the seed, in order of first appearance."""
    keys = group_keys(swept)
    together: dict[tuple, list[Row]] = {}
    for item in rows:
        together.setdefault(tuple(item[key] for key in keys), []).append(item)
    table = []
    for values, members in together.items():
        done = [item for item in members if item["state"] == "finished"]
        entry: Row = {**dict(zip(keys, values, strict=True)), "runs": len(done), "jobs": len(members)}
        units = {item["force_unit"] for item in done}
        entry["force_unit"] = units.pop() if len(units) == 1 else ""
        numbers = [name for name in _union(done) if name not in (*OWN, *keys, "seed", "epochs")]
        for name in numbers:
            found = [item[name] for item in done if isinstance(item.get(name), int | float)]
            if found:
                entry[f"{name}_mean"] = statistics.fmean(found)
                entry[f"{name}_std"] = statistics.stdev(found) if len(found) > 1 else math.nan
            if found and name.endswith("_off"):
                entry[f"{name}_abs"] = statistics.fmean(map(abs, found))
        table.append(entry)
    return table


def print_table(grouped: Sequence[Row], keys: Sequence[str]) -> None:
    """Mean and spread of every group, on the terminal."""
    from rich.console import Console
    from rich.table import Table

    names = [name[: -len("_off_abs")] for name in _union(grouped) if name.endswith("_off_abs")]
    table = Table(title="mean ± standard deviation over the runs; parameters: mean error, % of the truth")
    for key in (*keys, "runs", "force error", "/ C + v fit", *names):
        head = key.replace(".", ".\n") if key in names else key  # the contact above its parameter
        table.add_column(head, justify="left" if key in keys else "right", overflow="fold")
    for entry in grouped:
        cells = [str(entry[key]) for key in keys] + [f"{entry['runs']} of {entry['jobs']}"]
        if "force_rmse_mean" in entry:
            unit = unit_of_error(str(entry["force_unit"])) if entry["force_unit"] else ""
            cells.append(f"{spread(entry, 'force_rmse')} {unit}".rstrip())
            cells.append(f"{entry['force_rmse_mean'] / entry['coulomb_viscous_rmse_mean']:.3g}")
            cells += [f"{100 * entry[f'{n}_off_abs']:.2g}" if f"{n}_off_abs" in entry else "" for n in names]
        table.add_row(*cells)
    console = Console(width=None if sys.stdout.isatty() else 160)
    console.print(table)


def spread(entry: Mapping[str, Any], name: str) -> str:
    """Mean and standard deviation as people write them."""
    mean, deviation = entry[f"{name}_mean"], entry[f"{name}_std"]
    return f"{mean:.4g}" if math.isnan(deviation) else f"{mean:.4g} ± {deviation:.2g}"


def _union(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(name for item in rows for name in item))


def as_csv(rows: Sequence[Row]) -> str:
    """Rows as CSV with a column for every name that any has, errors last."""
    names = _union(rows)
    names = [name for name in names if name != "error"] + [name for name in names if name == "error"]
    buffer = io.StringIO(newline="")
    writer = csv.DictWriter(buffer, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()
