"""The reference: pages of what ``fp`` exports, of results, systems, laws and effects, from the package itself."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from pathlib import Path

import sympy as sp

import frictionpinn as fp
from frictionpinn.physics import EFFECTS, LAWS, SYSTEMS
from frictionpinn.physics.base import CONTACT, FrictionLaw
from frictionpinn.physics.notation import in_latex, tidy
from frictionpinn.show import readable_unit

GROUPS = {
    "What there is": ("systems", "laws", "effects"),
    "A model": ("system", "mechanism"),
    "A recording": ("read", "simulate", "check"),
    "What it tells": ("fit", "bound", "diagnose", "online"),
    "A controller": ("compensate",),
    "A network": ("train", "evaluate", "export"),
    "What goes wrong": ("UserError",),
}
RESULTS = {
    "physics.mechanism": ("Mechanism",),
    "data.recording": ("Recording", "Trial"),
    "api.recordings": ("Check",),
    "identify.result": ("Estimate",),
    "identify.bound": ("Bound",),
    "diagnose.diagnosis": ("Diagnosis",),
    "api.training": ("Run", "Evaluation"),
    "online.estimator": ("OnlineEstimator", "Reading"),
    "control.compensator": ("Compensator", "Command"),
    "show": ("Shown", "Table"),
}
PAGES = (
    "reference/python.md",
    "reference/results.md",
    "reference/systems.md",
    "reference/laws.md",
    "reference/effects.md",
)
SHORT = {CONTACT.v: sp.Symbol("v"), CONTACT.zdot: sp.Symbol("zdot"), CONTACT.N: sp.Symbol("F_N")}


def write(folder: Path) -> None:
    """Write every page of the reference below a folder."""
    texts = (functions(), results(), systems(), laws(), effects())
    for name, text in zip(PAGES, texts, strict=True):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def functions() -> str:
    """What ``import frictionpinn as fp`` gives; a name without a group is put at the end."""
    rest = [name for name in fp.__all__ if name not in sum(GROUPS.values(), ())]
    groups = GROUPS | ({"More": tuple(rest)} if rest else {})
    parts = ["# Python functions\n\n`import frictionpinn as fp`, then `fp.read`, `fp.fit` and so on. What they return: "
             "[results](results.md)."]  # fmt: skip
    for heading, names in groups.items():
        parts.append(f"## {heading}")
        parts += [_described(_place(name), 3) for name in names]
    return "\n\n".join(parts) + "\n"


def results() -> str:
    """The classes whose objects the functions return."""
    parts = ["# Results\n\nEvery result prints as a table, shows in a notebook with its figures, and has `.plot()`, "
             "`.figures()`, `.to_dict()` and `.save(folder)`."]  # fmt: skip
    parts += [_described(f"frictionpinn.{module}.{name}", 2) for module, names in RESULTS.items() for name in names]
    return "\n\n".join(parts) + "\n"


def systems() -> str:
    """Every system with its signals and parameters."""
    parts = ["# Systems\n\nSignals have the names that columns of a recording are found by. A system of your own: "
             "[extend](../guide/extending.md)."]  # fmt: skip
    for name, kind in SYSTEMS.items():
        made = kind()
        signals = [(f"`{signal}`", readable_unit(unit)) for signal, unit in made.signal_units.items()]
        values = [(f"`{p.name}`", readable_unit(p.unit), p.text, f"{p.value:g}") for p in kind.parameters]
        parts += [f"## {name} {{ #{name} }}", f"**{kind.title}**", quoted(inspect.getdoc(kind) or ""),
                  table(("signal", "unit"), signals), table(("parameter", "unit", "", "default"), values)]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def laws() -> str:
    """Every law with its equations and parameters."""
    parts = ["# Friction laws\n\nFrom slip velocity $v$, normal force $F_N$ and, where there is memory, the bristle's "
             "deflection $z$. Units are those of a linear drive; a joint has N m and rad in their place."]  # fmt: skip
    drive = fp.system("drive")
    for name, kind in LAWS.items():
        law = kind()
        values = [(f"`{p.name}`", readable_unit(drive.unit(p)), p.text, "" if p.value is None else f"{p.value:g}")
                  for p in law.parameters]  # fmt: skip
        parts += [f"## {name} {{ #{name} }}", *(f"$$\n{told}\n$$" for told in equations_of(law)),
                  quoted(inspect.getdoc(kind) or ""), table(("parameter", "unit", "", "default"), values)]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def equations_of(law: FrictionLaw) -> list[str]:
    """LaTeX of a law's force, of its bristle's rate and of g, where it has one."""
    p, g = law.symbols, sp.Symbol("g")
    shown = {"F": law.force(CONTACT, p)}
    if law.memory:
        capacity = law.capacity(CONTACT, p)
        shown |= {r"\dot{z}": sp.sympify(law.bristle_rate(CONTACT, p)).subs(capacity, g), "g": capacity}
    return [latex(name, tidy(sp.sympify(side).xreplace(SHORT), SHORT[CONTACT.v])) for name, side in shown.items()]


def latex(left: str, side: sp.Expr) -> str:
    """An equation in LaTeX, products by a thin space; the left side is LaTeX already."""
    right = in_latex(sp.Eq(sp.Symbol("Q"), sp.sympify(side), evaluate=False)).partition("=")[2]
    return f"{left} ={right}".replace(r"\cdot", r"\,")


def effects() -> str:
    """Every effect with its parameters; the gallery shows them."""
    drive = fp.system("drive")
    rows = []
    for name, kind in EFFECTS.items():
        names = ", ".join(f"`{p.name}`" for p in _parameters(kind, drive))
        rows.append((f"[{name}](../effects.md#{name})", quoted(kind.said()["occurs"]), names))
    return ("# Effects\n\nWhat a diagnosis tries, and what a mechanism may be given: "
            '`fp.mechanism("drive", "lugre", ["drag"])`. Equation, residual and experiment of each: '
            "[gallery](../effects.md). Parameters of effects on sensors, inputs and masses are named after these.\n\n"
            + table(("effect", "occurs", "parameters (on a drive, where it can act there)"), rows) + "\n")  # fmt: skip


def _parameters(kind, system) -> tuple:
    """An effect's parameters on the first system and law where it can act."""
    for where in (system, *(made() for made in SYSTEMS.values())):
        for law in LAWS.values():
            if kind().applies(where, law(), ("presliding",)):
                return kind().make_parameters(where, law())
    return kind.parameters


def table(columns: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    lines = [list(columns), ["---"] * len(list(columns)), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def quoted(text: str) -> str:
    """Prose of a docstring, whose asterisks, underscores and brackets are meant as they stand."""
    for mark in "\\*_[]<":
        text = text.replace(mark, f"\\{mark}" if mark != "<" else "&lt;")
    return text.replace("$", "&#36;")


def _place(name: str) -> str:
    return f"frictionpinn.{fp._PLACES[name]}.{name}"


def _described(place: str, level: int) -> str:
    return f"::: {place}\n    options:\n      heading_level: {level}"
