"""The parts of the reproduction: each writes its result file once; the document is made of the files alone."""

from __future__ import annotations

import logging
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import check_processes, choose
from ..progress import Steps
from ..workflow.build import Config
from ..workflow.manifest import write_json
from ..workflow.provenance import commit, versions
from . import ablation, equations, fidelity, identification, memory, transfer
from .document import document
from .runs import hushed, read

log = logging.getLogger(__name__)
Part = Callable[[Config, Path, Path, int], dict[str, Any]]
PARTS: dict[str, Part] = {
    "fidelity": fidelity.run,
    "memory": memory.run,
    "equations": equations.run,
    "transfer": transfer.run,
    "identification": identification.run,
    "ablation": ablation.run,
}


def reproduce(cfg: Config) -> Path:
    """Run the chosen parts that are not finished, then write the document from all results that are there.

    A part is finished where ``results`` holds its file, made with the same setting; results and figures are copied to
    ``pages``, whose files the document is made of.

    Args:
        cfg: resolved conf/reproduce.yaml.

    Returns:
        the document.
    """
    for name in cfg["parts"]:
        choose(name, PARTS, "parts")
    check_processes(cfg["jobs"], "jobs")
    results, pages, target = (Path(cfg[key]) for key in ("results", "pages", "document"))
    for folder in (results, pages):
        folder.mkdir(parents=True, exist_ok=True)
    with hushed():
        steps = Steps(len(cfg["parts"]))
        for name in cfg["parts"]:
            steps.finish(_run(name, cfg, results))
    for path in results.iterdir():
        shutil.copy(path, pages)
    target.write_text(document(pages), encoding="utf-8")
    log.info(f"the document is {target}")
    return target


def _run(name: str, cfg: Config, results: Path) -> str:
    """One part, unless it is finished; says what became of it."""
    path, setting = results / f"{name}.json", {"name": cfg["setting"]["name"], **cfg["setting"][name]}
    if path.is_file() and not cfg["again"] and read(path)["setting"] == setting:
        return f"{name}: finished before, {path}"
    begin = time.perf_counter()
    log.info(f"{name}: running")
    found = PARTS[name](cfg["setting"], Path(cfg["runs"]), results, int(cfg["jobs"]))
    seconds = round(time.perf_counter() - begin, 1)
    told = {"part": name, "setting": setting, "seconds": seconds, "versions": versions(), "commit": commit()}
    write_json(path, told | found)
    return f"{name}: {path} after {seconds:.0f} s"
