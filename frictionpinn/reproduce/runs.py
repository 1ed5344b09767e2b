"""Trainings and evaluations of a reproduction, each done once: a finished one is read from its folder."""

from __future__ import annotations

import hashlib
import json
import logging
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

from ..progress import Steps
from ..workflow.build import Config
from ..workflow.estimate import default_config
from ..workflow.evaluate import evaluate
from ..workflow.members import as_one, train_seeds
from ..workflow.result import write_json
from ..workflow.threads import one_thread, silent
from ..workflow.train import train

T = TypeVar("T")
R = TypeVar("R")
QUIET = ("trainer.threads=1", "trainer.progress_bar=false", "trainer.accelerator=cpu")
TRAININGS = logging.getLogger("frictionpinn.workflow")


@dataclass(frozen=True)
class Run:
    """One training and its evaluations.

    Attributes:
        folder: of the training; finished where it holds a ``result.json``.
        overrides: of conf/train.yaml.
        evaluations: overrides of conf/evaluate.yaml, a tuple for each evaluation.
    """

    folder: Path
    overrides: tuple[str, ...]
    evaluations: tuple[tuple[str, ...], ...] = ()


def training(cfg: Config, model: str, seed: int) -> tuple[str, ...]:
    """Overrides of a part's training; ``rollout`` names the models whose friction in motion is fitted too."""
    in_motion = ("rollout=true",) if model in cfg.get("rollout", ()) else ()
    return (f"model={model}", f"seed={seed}", *in_motion, *cfg["train"])


def finish_all(runs: Iterable[Run], jobs: int) -> list[tuple[Config, list[Config]]]:
    """:func:`finish` of every run; trainings that differ by their seed alone run as one program, which is quicker."""
    items = list(runs)
    each(_train_together, _groups(items), jobs, "trainings, several seeds together")
    return each(finish, items, jobs, "trainings and evaluations")


def _groups(runs: Iterable[Run]) -> list[list[tuple[Path, Config]]]:
    """What is not trained yet, as lists of folder and configuration whose seeds follow on one another.

    Parameter estimators come first: they take longest, and so no core waits for them at the end.
    """
    wanted = {run.folder: default_config([*run.overrides, *QUIET]) for run in runs}
    missing = [item for item in wanted.items() if finished(item[0] / "result.json", item[1]) is None]
    shapes: dict[str, list[tuple[Path, Config]]] = {}
    for folder, cfg in sorted(missing, key=lambda item: item[1]["seed"]):
        shape = json.dumps({key: value for key, value in cfg.items() if key != "seed"}, sort_keys=True)
        if as_one(cfg):
            shapes.setdefault(shape, []).append((folder, cfg))
    groups: dict[tuple[str, int], list[tuple[Path, Config]]] = {}
    for shape, items in shapes.items():
        for place, item in enumerate(items):
            groups.setdefault((shape, item[1]["seed"] - place), []).append(item)
    together = [group for group in groups.values() if len(group) > 1]
    return sorted(together, key=lambda group: not group[0][1]["model"]["name"].startswith("pe"))


def _train_together(group: list[tuple[Path, Config]]) -> None:
    train_seeds(group[0][1], [folder for folder, _ in group])


def finish(run: Run) -> tuple[Config, list[Config]]:
    """Train and evaluate what is not finished; return the result of the training and those of the evaluations.

    A result counts as finished where its configuration is still the one that is wanted.
    """
    cfg = default_config([*run.overrides, *QUIET])
    trained = finished(run.folder / "result.json", cfg)
    if trained is None:
        shutil.rmtree(run.folder, ignore_errors=True)
        run.folder.mkdir(parents=True)
        train(cfg, run.folder)
        trained = read(run.folder / "result.json")
    return trained, [_evaluation(run, overrides) for overrides in run.evaluations]


def _evaluation(run: Run, overrides: Sequence[str]) -> Config:
    """Kept in a file of its own, since the folder of an evaluation holds the last one on that system alone."""
    cfg = default_config([f"run={run.folder}", *overrides], "evaluate")
    digest = hashlib.sha256(json.dumps(cfg, sort_keys=True).encode()).hexdigest()[:12]
    path = run.folder / f"evaluated_{digest}.json"
    found = finished(path, cfg)
    if found is None:
        found = evaluate(cfg)
        write_json(path, found)
    return found


def finished(path: Path, cfg: Config) -> Config | None:
    """The result in a file; None where there is none, or where it was made with another configuration."""
    found = read(path) if path.is_file() else None
    return found if found is not None and found["config"] == json.loads(json.dumps(cfg)) else None


def read(path: Path) -> Config:
    """A result file as plain values."""
    return json.loads(path.read_text(encoding="utf-8"))


def each(work: Callable[[T], R], items: Iterable[T], jobs: int, what: str = "estimations") -> list[R]:
    """[work(item), ...] in processes of their own, one thread each, where there is more than one job; ``what`` they
    are tells those who wait."""
    tasks, found = list(items), []
    steps = Steps(len(tasks), what)
    if jobs < 2 or len(tasks) < 2:
        for result in map(work, tasks):
            found.append(result)
            steps.step()
        return found
    with one_thread(), ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=hush) as pool:
        for result in pool.map(work, tasks):
            found.append(result)
            steps.step()
    return found


def hush() -> None:
    """In a process of its own neither messages of single trainings nor their tracebacks after Ctrl-C are of use."""
    silent()
    TRAININGS.setLevel(logging.WARNING)


@contextmanager
def hushed() -> Iterator[None]:
    """Without messages of single trainings, which are of no use where dozens run."""
    before = TRAININGS.level
    TRAININGS.setLevel(logging.WARNING)
    try:
        yield
    finally:
        TRAININGS.setLevel(before)


def by_seed(values: dict[int, float | None]) -> dict[str, Any]:
    """Median over seeds and the values it comes from; ``failed`` counts the seeds without one."""
    known = sorted(value for value in values.values() if value is not None)
    middle = len(known) // 2
    median = None if not known else known[middle] if len(known) % 2 else (known[middle - 1] + known[middle]) / 2
    table = {str(seed): value for seed, value in values.items()}
    return {"value": median, "by_seed": table, "failed": len(values) - len(known)}
