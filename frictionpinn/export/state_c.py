"""A network with memory as C99: its table, its bristles and the step of a simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .. import __version__
from .c_code import at_contact, fill, write_files
from .portable_state import PortableState


def write_state_c(folder: Path, portable: PortableState) -> list[str]:
    """Write ``friction.h`` and ``friction.c``; of one of several contacts names begin with the contact's.

    Returns:
        Names of the files.
    """
    numbers, system = portable.numbers, portable.system
    K, velocities, loads = numbers.states, *numbers.tables.shape[1:]
    places = {
        "title": portable.title, "version": __version__, "force": system.force_unit, "slip": system.slip_unit,
        "states": K, "velocities": velocities, "loads": loads, "grid": _list(numbers.grid),
        "tables": _list(numbers.tables.ravel()), "elements": _list(numbers.elements.ravel()),
    }  # fmt: skip
    files = {name: fill(f"state_{name}", **places) for name in ("friction.h", "friction.c")}
    return write_files(folder, at_contact(files, portable.contact) if portable.contact else files)


def _list(values: np.ndarray) -> str:
    texts = [repr(float(value)) for value in values]
    rows = [", ".join(texts[k : k + 6]) for k in range(0, len(texts), 6)]
    return "{" + ",\n    ".join(rows) + "}"
