"""The parts of the reproduction: each writes its result file once; the document is made of the files alone."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import choose
from ..workflow.build import Config
from ..workflow.result import commit, versions, write_json
from . import ablation, equations, fidelity, identification, transfer
from .document import document
from .runs import hush, read

log = logging.getLogger(__name__)
Part = Callable[[Config, Path, Path, int], dict[str, Any]]
PARTS: dict[str, Part] = {
    "fidelity": fidelity.run,
    "equations": equations.run,
    "transfer": transfer.run,
    "identification": identification.run,
    "ablation": ablation.run,
}


def reproduce(cfg: Config) -> Path:
    """Run the chosen parts that have no result file yet, then write the document from all that is there.

    Args:
        cfg: resolved conf/reproduce.yaml.

    Returns:
        the document.
    """
    for name in cfg["parts"]:
        choose(name, PARTS, "parts")
    results = Path(cfg["results"])
    results.mkdir(parents=True, exist_ok=True)
    hush()
    for name in cfg["parts"]:
        path = results / f"{name}.json"
        if path.is_file() and not cfg["again"] and read(path)["setting"]["name"] == cfg["setting"]["name"]:
            log.info(f"{name}: finished before, {path}")
            continue
        begin = time.perf_counter()
        log.info(f"{name}: running")
        found = PARTS[name](cfg["setting"], Path(cfg["runs"]), results, int(cfg["jobs"]))
        seconds = round(time.perf_counter() - begin, 1)
        told = {"part": name, "setting": {"name": cfg["setting"]["name"], **cfg["setting"][name]}}
        write_json(path, told | {"seconds": seconds, "versions": versions(), "commit": commit(), **found})
        log.info(f"{name}: {path} after {seconds:.0f} s")
    target = Path(cfg["document"])
    target.write_text(document(results), encoding="utf-8")
    log.info(f"the document is {target}")
    return target
