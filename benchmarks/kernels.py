"""What a mechanism's kernels take: to differentiate, and to compile as straight-line arithmetic.

    python benchmarks/kernels.py

Of mechanisms with every effect at once, as a diagnosis tests them, beside functions whose types numba finds: seconds of
processor time for the derivatives by all parameters, microseconds of a call, and whether both give the same bits at
random arguments. Of the same with every force that depends on one variable in any way, beside sympy: seconds to
differentiate by every symbol, and whether both give the same expressions. Writes benchmarks/results/kernels.txt.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import tempfile
import time
import timeit
from pathlib import Path
from types import ModuleType

import numpy as np
import sympy as sp
from sympy.core.cache import clear_cache

RESULT = Path(__file__).resolve().parent / "results" / "kernels.txt"
CASES = {"drive": "lugre", "pob": "lugre", "pob_hinge": {"box": "lugre", "hinge": "coulomb_viscous"}}
FUNCTIONS = ("parameters", "output_derivatives")
DRAWS = 20


def loaded(path: Path, name: str) -> tuple[ModuleType, float]:
    """A generated module, compiled, and the seconds of processor time that took."""
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    begin = time.process_time()
    spec.loader.exec_module(module)
    return module, time.process_time() - begin


def microseconds(function, arguments: list[np.ndarray]) -> float:
    return min(timeit.repeat(lambda: function(*arguments), number=500, repeat=5)) / 500 * 1e6


def timed(derivatives, rows: list[sp.Expr], symbols: list[sp.Symbol]) -> tuple[list[list[sp.Expr]], float]:
    """Derivatives of all rows by every symbol, and the seconds of processor time that took."""
    clear_cache()
    begin = time.process_time()
    made = [derivatives(rows, symbol) for symbol in symbols]
    return made, time.process_time() - begin


def main() -> None:
    os.environ["FRICTIONPINN_CACHE"] = tempfile.mkdtemp()
    from frictionpinn.numerics.codegen import Kernels, cache_folder
    from frictionpinn.numerics.partial import Partials
    from frictionpinn.physics import SYSTEMS
    from frictionpinn.physics.contacts import law_named
    from frictionpinn.physics.effects import effects_for
    from frictionpinn.physics.mechanism import Mechanism
    from frictionpinn.physics.remainder import remainders

    lines = ["python benchmarks/kernels.py: a mechanism with all its effects, derivatives by every parameter", ""]
    lines.append(
        f"{'':12s}{'lines':>8s}{'compiled, s':>16s}{'types found, s':>16s}{'ratio':>8s}{'a call, us':>20s}  bits"
    )
    rng = np.random.default_rng(0)
    for system, law in CASES.items():
        plain = Mechanism(SYSTEMS[system](), law_named(law, "law"))
        kernels = Kernels(Mechanism(plain.system, plain.law, tuple(effects_for(plain.system, plain.law))))
        _ = kernels.sensitivity  # derives and writes the source
        path = cache_folder() / f"{kernels.key}_sensitivity.py"
        text = path.read_text()
        count = len(text.splitlines())
        typed = text.replace("@straight_line\n", '@njit(SIGNATURE, error_model="numpy", nogil=True)\n')
        modules = []
        for name, source in (("straight", text), ("typed", typed)):
            place = Path(tempfile.mkdtemp()) / f"{system}_{name}.py"
            place.write_text(source)
            modules.append(loaded(place, place.stem))
        (straight, fast), (by_type, slow) = modules
        same, times = True, []
        for function in FUNCTIONS:
            for _ in range(DRAWS):
                s, w, u, p = rng.normal(size=(4, 500))
                found, wanted = np.zeros((2, 50000))
                getattr(straight, function)(s, w, u, np.abs(p), found)
                getattr(by_type, function)(s, w, u, np.abs(p), wanted)
                same &= np.array_equal(found, wanted, equal_nan=True)
            times.append([microseconds(getattr(m, function), [s, w, u, np.abs(p), found]) for m in (straight, by_type)])
        call, bits = " and ".join(f"{a:.1f}/{b:.1f}" for a, b in times), "same" if same else "differ"
        lines.append(f"{system:12s}{count:8d}{fast:16.1f}{slow:16.1f}{slow / fast:8.1f}{call:>20s}  {bits}")
        print(lines[-1], flush=True)
    lines += ["", f"{'':12s}{'symbols':>8s}{'shared once, s':>16s}{'sympy, s':>16s}{'ratio':>8s}  expressions"]
    for system, law in CASES.items():
        plain = Mechanism(SYSTEMS[system](), law_named(law, "law"))
        every = (*effects_for(plain.system, plain.law), *remainders(plain.system))
        rows = list(Mechanism(plain.system, plain.law, every).residuals)
        symbols = sorted(set().union(*(row.free_symbols for row in rows)), key=str)
        ours, fast = timed(Partials(), rows, symbols)
        theirs, slow = timed(lambda rows, symbol: [sp.diff(row, symbol) for row in rows], rows, symbols)
        equal = "same" if ours == theirs else "differ"
        lines.append(f"{system:12s}{len(symbols):8d}{fast:16.2f}{slow:16.2f}{slow / fast:8.1f}  {equal}")
        print(lines[-1], flush=True)
    RESULT.write_text("\n".join(lines) + "\n")
    print(RESULT.read_text())


if __name__ == "__main__":
    main()
