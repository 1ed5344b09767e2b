"""A friction law and a trained network as C99 that needs nothing but libm."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from string import Template

import numpy as np
import sympy as sp

from .. import __version__
from ..numerics.torch_functions import capacity_rate
from ..physics import CONTACT, FrictionLaw, System
from .functions import ACTIVATIONS, bristle, c_statements
from .portable import PortableModel

_TEMPLATES = Path(__file__).parent / "templates"
_SIGNAL_TEXT = {
    "v_slip": "slip velocity",
    "normal_force": "normal force",
    "a_frictionless": "slip acceleration without friction",
}


def fill(template: str, **values: object) -> str:
    """The text of a template with its places filled."""
    return Template((_TEMPLATES / template).read_text(encoding="utf-8")).substitute(values)


def write_c(folder: Path, portable: PortableModel) -> list[str]:
    """Write ``friction.h``, ``friction.c`` and, where the equations of motion allow, ``simulate.c``.

    Of one of several contacts ``hinge_friction.h`` and ``hinge_friction.c``, every name with the contact before it, so
    that those of all contacts fit into one program.

    Returns:
        Names of the files.
    """
    from .c_simulate import simulate_source

    network = {"name": portable.name}
    header = _law_header(portable.law, portable.system) if portable.law else ""
    source = _law_source(portable.law, portable.identified) if portable.law else ""
    header += fill("network.h", **network, **_header_places(portable))
    source += fill("network.c", **network, **_source_places(portable))
    files = {
        "friction.h": _header(portable.title, portable.system, header),
        "friction.c": f'#include "friction.h"\n\n#include <float.h>\n#include <math.h>\n{source}',
        "simulate.c": simulate_source(portable),
    }
    return write_files(folder, at_contact(files, portable.contact) if portable.contact else files)


def write_law_c(folder: Path, law: FrictionLaw, values: Mapping[str, float], system: System) -> list[str]:
    """Write ``friction.h`` and ``friction.c`` of a law alone, with these parameters (SI units)."""
    header = _header(f"{law.name} friction", system, _law_header(law, system))
    source = f'#include "friction.h"\n\n#include <float.h>\n#include <math.h>\n{_law_source(law, values)}'
    return write_files(folder, {"friction.h": header, "friction.c": source})


def at_contact(files: Mapping[str, str | None], contact: str) -> dict[str, str | None]:
    """The files with the contact's name before theirs and before every name that they share with a program."""

    def own(text: str) -> str:
        text = re.sub(r"\bfriction(?=_|\.[ch]\b)", f"{contact}_friction", text)
        return re.sub(r"\bFRICTION(?=_)", f"{contact.upper()}_FRICTION", text)

    return {own(name): text and own(text) for name, text in files.items()}


def write_files(folder: Path, files: Mapping[str, str | None]) -> list[str]:
    """Write the files that have a text; returns their names."""
    for name, text in files.items():
        if text is not None:
            (folder / name).write_text(text, encoding="utf-8")  # of a law of one's own, comments may say µ
    return [name for name, text in files.items() if text is not None]


def _header(title: str, system: System, parts: str) -> str:
    units = {"force": system.force_unit, "slip": system.slip_unit}
    return fill("friction.h", title=title, version=__version__, parts=parts, **units)


# the law ------------------------------------------------------------------------------------------------------
def _law_header(law: FrictionLaw, system: System) -> str:
    fields = [f"    double {par.name}; /* {par.text}, {system.unit(par)} */" for par in law.parameters]
    formula = (type(law).__doc__ or law.name).strip().splitlines()[0]
    return fill("law.h", name=law.name, formula=formula, fields="\n".join(fields))


def _law_source(law: FrictionLaw, values: Mapping[str, float]) -> str:
    rate, slope = bristle(law)
    force = law.force(CONTACT, law.symbols)
    functions = {
        "force": (force, (CONTACT.v, CONTACT.N, CONTACT.z, CONTACT.zdot)),
        "capacity": (law.capacity(CONTACT, law.symbols), (CONTACT.v, CONTACT.N)),
        "rate": (rate, (CONTACT.v, CONTACT.N, CONTACT.z)),
        "slope": (slope, (CONTACT.v, CONTACT.N, CONTACT.z)),
    }
    places = {}
    for name, (expr, arguments) in functions.items():
        expr = sp.sympify(expr)
        unused = [symbol.name for symbol in arguments if symbol not in expr.free_symbols]
        unused += [] if expr.free_symbols & set(vars(law.symbols).values()) else ["p"]
        places[f"{name}_unused"] = "".join(f"    (void){item};\n" for item in unused)
        places[name] = c_statements({"return": _with_struct(expr, law)})
    given = ", ".join(_number(values[par.name]) for par in law.parameters)
    return fill("law.c", name=law.name, values=given, **places)


def _with_struct(expr: sp.Expr, law: FrictionLaw) -> sp.Expr:
    """The expression with p->name for every parameter."""
    return expr.xreplace({par.symbol: sp.Symbol(f"p->{par.name}", real=True) for par in law.parameters})


# the network --------------------------------------------------------------------------------------------------
def _fields(portable: PortableModel) -> list[tuple[str, str]]:
    """Field of ``friction_signals`` and what it is, in order: the signals, then their rates where they are needed."""
    units = portable.units
    fields = [(name, f"{_SIGNAL_TEXT[name]}, {units[name]}") for name in portable.signals]
    if portable.estimator:
        fields += [(f"{name}_rate", f"its rate, {units[name + '_rate']}") for name in portable.signals]
    return fields


def _header_places(portable: PortableModel) -> dict[str, object]:
    fields = [f"    double {name}; /* {text} */" for name, text in _fields(portable)]
    return {
        "fields": "\n".join(fields),
        "length": portable.length,
        "interval": repr(portable.interval),
        "count": len(portable.signals),
        "kept": len(fields),
    }


def _source_places(portable: PortableModel) -> dict[str, object]:
    value, slope = ACTIVATIONS[portable.activation]
    sizes = [portable.layers[0][0].shape[1], *(len(bias) for _, bias in portable.layers)]
    read = [f"    row[{i}] = {_read(name)};" for i, (name, _) in enumerate(_fields(portable))]
    return {
        "features": len(portable.mean),
        "widest": max(sizes),
        "layers": len(portable.layers),
        "inputs": len(portable.inputs),
        "kept": len(_fields(portable)),
        "arrays": _arrays(portable, sizes),
        "activation": c_statements({"return": value}),
        "slope": c_statements({"return": slope}),
        "read": "\n".join(read),
        "direct": _odd() if portable.odd else _plain(),
        "force": _force(portable),
    }


def _read(name: str) -> str:
    if name == "normal_force":
        return "fabs(now->normal_force)"
    if name == "normal_force_rate":
        return "now->normal_force < 0.0 ? -now->normal_force_rate : now->normal_force_rate"
    return f"now->{name}"


def _arrays(portable: PortableModel, sizes: list[int]) -> str:
    index = ", ".join(str(portable.signals.index(name)) for name in portable.inputs)
    lines = [f"static const int input[INPUTS] = {{{index}}};"]
    lines += [f"static const int size[LAYERS + 1] = {{{', '.join(map(str, sizes))}}};"]
    for name in ("mean", "scale", "signs"):
        lines.append(f"static const double {name}[FEATURES] = {_list(getattr(portable, name))};")
    for k, (weight, bias) in enumerate(portable.layers):
        lines.append(f"static const double weight_{k}[] = {_list(weight.ravel())};")
        lines.append(f"static const double bias_{k}[] = {_list(bias)};")
    for kind in ("weight", "bias"):
        names = ", ".join(f"{kind}_{k}" for k in range(len(portable.layers)))
        lines.append(f"static const double *const {kind}[LAYERS] = {{{names}}};")
    rows = [", ".join(_list(row) for row in portable.weights[name]) for name in portable.inputs]
    table = ", ".join(f"{{{row}}}" for row in rows)
    lines.append(f"static const double window[INPUTS][FRICTION_SAMPLES][FEATURES] = {{{table}}};")
    return "\n".join(lines)


def _list(values: Iterable[float]) -> str:
    texts = [_number(value) for value in np.asarray(values).tolist()]
    rows = [", ".join(texts[k : k + 8]) for k in range(0, len(texts), 8)]
    return "{" + ",\n    ".join(rows) + "}"


def _number(value: float) -> str:
    return f"{float(value)!r}"


_STANDARDISE = """    for (j = 0; j < FEATURES; j++) {{
        u[j] = (x[j] - mean[j]) / scale[j]{sign};
        du[j] = dx[j] / scale[j]{sign};
    }}
"""


def _plain() -> str:
    return f"{_STANDARDISE.format(sign='')}    value = forward(u, du, rate);\n    return value;\n"


def _odd() -> str:
    return (
        f"    double opposite;\n{_STANDARDISE.format(sign='')}    value = forward(u, du, rate);\n"
        f"{_STANDARDISE.format(sign=' * signs[j]')}    value -= forward(u, du, &opposite);\n"
        "    *rate = (*rate - opposite) / 2.0;\n    return value / 2.0;\n"
    )


def _force(portable: PortableModel) -> str:
    if portable.law is None:
        return f"    u = output(x, dx, &rate);\n    return {_number(portable.force_scale)} * u;"
    names = [name for name, _ in _fields(portable)]
    row = {name: f"row[{names.index(name)}]" for name in names}
    v, N = row["v_slip"], row["normal_force"]
    values = ", ".join(_number(portable.values[par.name]) for par in portable.law.parameters)
    lines = [f"    static const friction_law trained = {{{values}}}; /* with the network */"]
    lines += ["    const friction_law *p = &trained;", "    double z, z_rate;"]
    lines += ["    see(network, row, FRICTION_SIGNALS, dx);", "    u = output(x, dx, &rate);"]
    if portable.bristle == "free":
        lines += [f"    z = u * {_number(portable.z_scale)};", f"    z_rate = rate * {_number(portable.z_scale)};"]
    else:
        still = portable.bristle == "load"
        speed, speed_rate = ("0.0", "0.0") if still else (v, row["v_slip_rate"])
        lines += [
            f"    const double v_slip = {speed}, v_slip_rate = {speed_rate};",
            f"    const double N = {N}, N_rate = {row['normal_force_rate']};",
            "    const double share = tanh(u), g = friction_law_capacity(p, v_slip, N);",
            "    double g_rate;",
            c_statements({"g_rate": _with_struct(capacity_rate(portable.law)[0], portable.law)}),
            "    z = share * g / p->sigma_0;",
            "    z_rate = ((1.0 - share * share) * rate * g + share * g_rate) / p->sigma_0;",
        ]
    return "\n".join([*lines, f"    return friction_law_force(p, {v}, {N}, z, z_rate);"])
