"""A compensator as C99: fixed memory, no allocation, the cycle of :mod:`..control.recursions` with its equations."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import sympy as sp

from .. import __version__
from ..control.compensator import Compensator
from ..control.filter import ALIKE, FURTHEST, MEMORY_OF_SCALE, ROUND_OFF, SLOPES, WILD
from ..control.recursions import ITERATIONS, SETTLED
from ..numerics.whiteness import NORMAL_95
from .c_code import fill
from .functions import c_statements

NUMBERS = ("h", "lag", "inertia", "noise", "walk", "still", "passing", "limit", "gain", "low", "width")


def write_compensator_c(folder: Path, compensator: Compensator) -> list[str]:
    """Write ``compensator.h`` and ``compensator.c`` of a compensator with its parameters and options.

    A cycle of the C code gives the torque and the interval of :meth:`Compensator.update` to rounding.

    Returns:
        Names of the files.
    """
    plan, system = compensator.plan, compensator.mechanism.system
    n_s, n_w, n_u, _ = plan.sizes
    k, past = len(plan.places), compensator.memory.past.shape[0]
    sizes = {"n_s": n_s, "n_w": n_w, "n_u": n_u, "n_p": len(plan.p), "k": k, "n": len(compensator.memory.X)}
    sizes |= {"past": past, "row": SLOPES + k, "cells": plan.cells}
    n = sizes["n"]
    doubles = n + n * n + n_s * (k + 2) + n_w + len(plan.p) + past * (SLOPES + k) + 6
    header = fill(
        "compensator.h", **sizes, title=compensator.mechanism.name, version=__version__, bytes=doubles,
        interval=f"{plan.h:g}", delay=f"{plan.lag * plan.h:g}", force=system.force_unit, slip=system.slip_unit,
    )  # fmt: skip
    numbers = {name: _number(getattr(plan, name)) for name in NUMBERS}
    lists = {name: _list(getattr(plan, name)) for name in ("p", "known", "walks", "spread")}
    clocks = "".join(f"    u[{place}] = {'t' if runs else '1.0'};\n" for place, runs in plan.clocks.tolist())
    source = fill(
        "compensator.c", **sizes, **numbers, **lists, **_functions(compensator), clocks=clocks,
        names=", ".join(f'"{name}"' for name in compensator.names),
        places=", ".join(map(str, plan.places.tolist())) or "0", filters=int(plan.filters), iterations=ITERATIONS,
        memory=_number(MEMORY_OF_SCALE), settled=_number(SETTLED), wild=_number(WILD), furthest=_number(FURTHEST),
        z95=_number(NORMAL_95), alike=_number(ALIKE), round_off=_number(ROUND_OFF),
    )  # fmt: skip
    for name, text in {"compensator.h": header, "compensator.c": source}.items():
        (folder / name).write_text(text, encoding="utf-8")
    return ["compensator.h", "compensator.c"]


def _functions(compensator: Compensator) -> dict[str, str]:
    """Bodies of ``newton``, ``friction`` and ``strengths``, from the equations."""
    mechanism, kernels = compensator.mechanism, compensator.kernels
    vectors = kernels.symbols
    places = {
        symbol: sp.Symbol(f"{vector}[{i}]", real=True)
        for vector, symbols in zip("swup", vectors, strict=True)
        for i, symbol in enumerate(symbols)
    }
    rows = list(mechanism.residuals)
    adapted = [par.symbol for par in mechanism.parameters if par.name in compensator.adapt]
    adapted.sort(key=lambda symbol: list(compensator.adapt).index(symbol.name))
    by = [[sp.diff(row, symbol) for row in rows for symbol in symbols] for symbols in (*vectors[:2], adapted)]
    wanted = {"newton": [*rows, *by[0], *by[1]], "strengths": by[2]}
    bodies = {name: _body({f"out[{i}]": e for i, e in enumerate(found)}, places) for name, found in wanted.items()}
    return bodies | {"friction": _body({"return": mechanism.friction}, places)}


def _body(expressions: dict[str, sp.Expr], places: dict[sp.Symbol, sp.Symbol]) -> str:
    """Statements for what is not identically zero; arguments that none reads are named, lest compilers warn."""
    found = {
        target: sp.sympify(e).xreplace(places) for target, e in expressions.items() if e != 0 or target == "return"
    }
    used = {symbol.name[0] for expr in found.values() for symbol in expr.free_symbols}
    unused = [name for name in "swup" if name not in used] + ([] if found else ["out"])
    return "".join(f"    (void){name};\n" for name in unused) + c_statements(found)


def _number(value: float) -> str:
    return repr(float(value))


def _list(values: Iterable[float]) -> str:
    return ", ".join(_number(value) for value in values) or "0.0"
