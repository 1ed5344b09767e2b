"""A network with memory as C99: its table, its bristles and the step of a simulation."""

from __future__ import annotations

from pathlib import Path
from string import Template

import numpy as np

from .. import __version__
from ..models import StateModel
from ..physics import System

_TEMPLATES = Path(__file__).parent / "templates"


def write_state_c(folder: Path, model: StateModel, system: System) -> list[str]:
    """Write ``friction.h`` and ``friction.c``; of one of several contacts every name carries the contact's.

    Returns:
        Names of the files.
    """
    numbers = model.friction()
    K, velocities, loads = numbers.states, *numbers.tables.shape[1:]
    places = {
        "title": f"friction model {model.hparams['name']} with memory, trained on {system.title}",
        "version": __version__, "force": system.force_unit, "slip": system.slip_unit, "states": K,
        "velocities": velocities, "loads": loads, "grid": _list(numbers.grid),
        "tables": _list(numbers.tables.ravel()), "elements": _list(numbers.elements.ravel()),
    }  # fmt: skip
    files = {}
    for name in ("friction.h", "friction.c"):
        text = Template((_TEMPLATES / f"state_{name}").read_text(encoding="utf-8")).substitute(places)
        files[name] = text
        (folder / name).write_text(text, encoding="ascii", errors="replace")
    return list(files)


def _list(values: np.ndarray) -> str:
    texts = [repr(float(value)) for value in values]
    rows = [", ".join(texts[k : k + 6]) for k in range(0, len(texts), 6)]
    return "{" + ",\n    ".join(rows) + "}"
