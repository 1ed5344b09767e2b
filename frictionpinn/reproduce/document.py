"""The document: every table and figure from the result files alone, ours beside the published ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..evaluate.estimators import LABELS, rows
from . import text
from .claims import claims
from .runs import read

Result = Mapping[str, Any]
PARTS = ("fidelity", "memory", "equations", "transfer", "identification", "ablation")
KINDS = {"online": "online", "in_simulation": "in simulation"}


def document(results: Path) -> str:
    """Markdown of the whole reproduction.

    Args:
        results: folder with <part>.json and the figures; parts that are not there are left out, and said to be.
    """
    found = {name: read(results / f"{name}.json") for name in PARTS if (results / f"{name}.json").is_file()}
    sections = [text.HEAD, *_made(found), "## Which of the paper's claims hold\n", _claims(found)]
    for name, section in SECTIONS.items():
        if name in found:
            sections += section(found[name], results.name)
    return "\n".join(sections).rstrip() + "\n"


def _made(found: Mapping[str, Result]) -> list[str]:
    missing = [name for name in PARTS if name not in found]
    settings = sorted({result["setting"]["name"] for result in found.values()})
    seconds = sum(result["seconds"] for result in found.values())
    lines = [text.MADE.format(settings=" and ".join(settings), minutes=number(seconds / 60))]
    if missing:
        lines.append(f"Not run yet: {', '.join(missing)}.\n")
    return lines


def _claims(found: Mapping[str, Result]) -> str:
    return grid(["the paper's claim", "here", "measured"], [list(row) for row in claims(found)])


def fidelity(result: Result, folder: str) -> list[str]:
    """Errors online and in simulation, trajectories, characteristics."""
    in_motion = [text.IN_MOTION] if result["setting"].get("rollout") else []
    lines = ["## Friction force, online and in simulation\n", text.FIDELITY, *in_motion, seeds(result)]
    for name, methods in result["errors"].items():
        about = result["trajectories"][name]
        rest, far = 100 * about["at_rest"]["value"], about["displacement"]
        lines.append(
            f"**{name}**: {number(about['duration']['value'])} s, at rest {number(rest)} % of it, the box ends "
            f"{number(far['value'])} {far['unit']} from its start.\n"
        )
        lines.append(_errors(methods))
    lines.append(f"![mean square errors of every method]({folder}/errors.png)\n")
    for model in result["setting"]["shown"]:
        lines += [f"![{model.upper()} on {name}]({folder}/{model}_trajectory_{k + 1}.png)\n"
                  for k, name in enumerate(result["errors"])]  # fmt: skip
    lines += ["### Parameters that the networks learned\n", _learned(result["parameters"])]
    told = result["characteristics"]
    off = ", ".join(f"{name} {number(rms)} {told['unit']}" for name, rms in told["difference_rms"].items())
    lines += ["## Friction characteristics\n", text.CHARACTERISTICS, f"Root mean square difference: {off}.\n"]
    return [*lines, f"![friction characteristics of PE1, BB1 and LuGre]({folder}/characteristics.png)\n"]


def _errors(methods: Mapping[str, Any]) -> str:
    best = methods.get("pe1", {}).get("in_simulation", {}).get("value")
    heads = ["method"]
    for kind in KINDS.values():
        heads += [f"{kind}, N²", f"published, {kind}"]
    body = []
    for row in sorted(methods.values(), key=lambda row: not row["model"]):
        cells = [row["label"]]
        for kind in KINDS:
            cell = row.get(kind)
            cells += [spread(cell), number((cell or {}).get("published"))]
        value = row.get("in_simulation", {}).get("value")
        body.append([*cells, number(value / best if value is not None and best else None)])
    return grid([*heads, "in simulation, over PE1's"], body)


def _learned(table: Mapping[str, Any]) -> str:
    models = list(table)
    if not models:
        return "None was trained.\n"
    names = [name for name in table[models[0]] if table[models[0]][name]["truth"] is not None]
    body = [[model.upper(), *(spread(table[model][name]) for name in names)] for model in models]
    body.append(["truth", *(number(table[models[0]][name]["truth"]) for name in names)])
    return grid(["model", *(unit(name, table[models[0]][name]["unit"]) for name in names)], body)


def memory(result: Result, folder: str) -> list[str]:
    """Published, with windows and with a state side by side."""
    lines = ["## Networks with memory\n", text.MEMORY, seeds(result)]
    seconds = result["seconds_of_training"]
    heads = ["model", "memory", *(head for kind in KINDS.values() for head in (f"{kind}, N²", f"published, {kind}"))]
    for name, methods in result["errors"].items():
        body = []
        for key, row in methods.items():
            model, variant = key.split("_")
            cells = [spread(row.get(kind)) for kind in KINDS]
            published = [number((row.get(kind) or {}).get("published")) for kind in KINDS]
            between = [cell for pair in zip(cells, published, strict=True) for cell in pair]
            body.append([model.upper(), text.VARIANTS[variant], *between, number(seconds[key]["value"])])
        lines += [f"**{name}**\n", grid([*heads, "training, s"], body)]
    return lines


def equations(result: Result, folder: str) -> list[str]:
    """What the published equations cost."""
    lines = ["## What the published equations cost\n", text.EQUATIONS]
    trajectories = list(next(iter(result["errors"].values())))
    for name in trajectories:
        body = []
        for case, table in result["errors"].items():
            for method, kinds in table[name].items():
                label = "force balance" if method == "force_balance" else method.upper()
                body.append([case, label, number(kinds["online"]), number(kinds["in_simulation"])])
        lines += [f"**{name}**\n", grid(["equations", "method", "online, N²", "in simulation, N²"], body)]
    identified = result["identified"]
    names = list(next(iter(identified.values())))
    body = [
        [case, *(f"{number(table[name]['value'])} ± {number(table[name]['std'])}" for name in names)]
        for case, table in identified.items()
    ]
    first = next(iter(identified.values()))
    body.append(["truth", *(number(first[name]["truth"]) for name in names)])
    heads = ["equations", *(unit(name, first[name]["unit"]) for name in names)]
    return [*lines, "Maximum likelihood under the same equations, with its standard errors:\n", grid(heads, body)]


def transfer(result: Result, folder: str) -> list[str]:
    """Train system x test system x model."""
    lines = ["## Transfer\n", text.TRANSFER, seeds(result)]
    body = []
    for model, trained in result["matrix"].items():
        for train, tested in trained.items():
            for test, cell in tested.items():
                ratio = result["ratios"].get(model, {}).get(f"{train} > {test}", {})
                cells = [model.upper(), train, test]
                for kind in KINDS:
                    cells += [spread(cell[kind]), number(ratio.get(kind))]
                body.append(cells)
    for test, cell in result["coulomb_viscous"].items():
        body.append(["Coulomb + viscous fit", test, test, *(c for kind in KINDS for c in (spread(cell[kind]), "-"))])
    heads = ["model", "trained on", "tested on"]
    for kind in KINDS.values():
        heads += [f"{kind}, N²", "over the one trained there"]
    return [*lines, grid(heads, body), f"![transfer between systems]({folder}/transfer.png)\n"]


def identification(result: Result, folder: str) -> list[str]:
    """The table of identified parameters, twice, and the published one."""
    lines = ["## Parameter identification\n", text.IDENTIFICATION, seeds(result)]
    setting = result["setting"]
    limits = [f"{setting['epochs']} steps of the networks"] if setting["epochs"] else []
    limits += [f"{setting['simulations']} simulations of a search"] if setting["simulations"] else []
    if limits:
        lines.append(f"At most {' and '.join(limits)} in this setting.\n")
    for name, protocol in result["protocols"].items():
        cells = list(rows(protocol))
        lines += [f"**{text.PROTOCOLS[name]}**\n", grid(cells[0], cells[1:])]
    lines += ["**As published**\n", _published(result["published"])]
    return [*lines, f"![error against time]({folder}/identification.png)\n", text.IDENTIFICATION_NOTES]


def _published(table: Mapping[str, Any]) -> str:
    names = list(table["truth"])
    labels = LABELS | {"truth": "truth"}
    body = [
        [labels[key], *(number(row[name]) for name in names), number(row.get("minutes"))] for key, row in table.items()
    ]
    return grid(["estimator", *names, "minutes"], body)


def ablation(result: Result, folder: str) -> list[str]:
    """What each choice buys."""
    lines = ["## What each choice buys\n", text.ABLATION, seeds(result)]
    body = []
    for name, entry in result["ablations"].items():
        for level, cell in entry["levels"].items():
            default = "default" if level == result["default"][name] else ""
            errors = [spread(cell.get(kind)) for kind in KINDS]
            body.append([name, entry["model"].upper(), f"`{entry['key']}={level}`", *errors, default])
    heads = ["ablation", "model", "level", "online, the held-out swing, N²", "in simulation, Traj. 1 and 2, N²", ""]
    return [*lines, grid(heads, body), f"![what each choice buys]({folder}/ablation.png)\n"]


SECTIONS = {
    "fidelity": fidelity,
    "memory": memory,
    "transfer": transfer,
    "identification": identification,
    "equations": equations,
    "ablation": ablation,
}


def seeds(result: Result) -> str:
    """How many seeds and which overrides a part ran with."""
    setting = result["setting"]
    count = len(setting["seeds"])
    several = f"Medians over {count} seeds, in brackets the lowest and the highest." if count > 1 else "One seed."
    changed = f" Trained with `{' '.join(setting['train'])}`." if setting.get("train") else ""
    return f"{several}{changed} (setting {setting['name']}, {number(result['seconds'] / 60)} min)\n"


def number(value: float | None) -> str:
    """Three digits; a dash for none."""
    return "-" if value is None else f"{value:.3g}"


def spread(cell: Mapping[str, Any] | None) -> str:
    """Median [lowest, highest] of an entry over seeds; how many failed."""
    if cell is None:
        return "-"
    known = [value for value in cell["by_seed"].values() if value is not None]
    told = number(cell["value"])
    if len(known) > 1:
        told += f" [{number(min(known))}, {number(max(known))}]"
    return told + (f" ({cell['failed']} failed)" if cell["failed"] else "")


def unit(name: str, text_: str) -> str:
    """Heading of a parameter's column."""
    return name if text_ == "1" else f"{name}, {text_.replace('*', ' ')}"


def grid(heads: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [heads, ["---"] * len(heads), *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"
