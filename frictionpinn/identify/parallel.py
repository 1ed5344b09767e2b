"""Independent work on all cores, in threads: compiled code lets go of Python's lock."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
WORKERS = max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
_POOL = ThreadPoolExecutor(max_workers=WORKERS)
_INSIDE = threading.local()


def in_parallel(work: Callable[[int], T], loads: Sequence[float]) -> list[T]:
    """[work(0), work(1), ...] on all cores: one batch a core, of about equal load.

    Work that is parallel itself does its parts one after another: whole fits side by side wait less for one another
    than the parts of one fit.
    """
    batches: list[list[int]] = [[] for _ in range(min(WORKERS, len(loads)))]
    totals = [0.0] * len(batches)
    for k in sorted(range(len(loads)), key=lambda k: -loads[k]):
        lightest = totals.index(min(totals))
        batches[lightest].append(k)
        totals[lightest] += loads[k]
    if len(batches) < 2 or getattr(_INSIDE, "yes", False):
        return [work(k) for k in range(len(loads))]

    def run(batch: list[int]) -> list[T]:
        _INSIDE.yes = True
        try:
            return [work(k) for k in batch]
        finally:
            _INSIDE.yes = False

    results = list(_POOL.map(run, batches))
    found = {
        k: value for batch, values in zip(batches, results, strict=True) for k, value in zip(batch, values, strict=True)
    }
    return [found[k] for k in range(len(loads))]
