"""Independent work on all cores, in threads: compiled code lets go of Python's lock."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from ..progress import Steps

T = TypeVar("T")
WORKERS = max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
_POOL = ThreadPoolExecutor(max_workers=max(1, WORKERS - 1))  # beside the thread that asks
_LOCK = threading.Lock()
_helping = 0


def in_parallel(work: Callable[[int], T], loads: Sequence[float], what: str = "") -> list[T]:
    """[work(0), work(1), ...] on all cores, the largest load first, whoever is free takes the next.

    Work may be parallel itself: its parts are shared only with cores that have nothing else to do, since whole fits
    side by side wait less for one another than the parts of one fit. ``what`` the work is tells those who wait.
    """
    steps = Steps(len(loads), what) if what else None
    waiting = deque(sorted(range(len(loads)), key=lambda k: -loads[k]))
    found: dict[int, T] = {}

    def run() -> None:
        try:
            while waiting:
                try:
                    k = waiting.popleft()
                except IndexError:  # another was quicker
                    return
                found[k] = work(k)
                if steps is not None:
                    steps.step()
        except BaseException:
            waiting.clear()
            raise

    helpers = [_POOL.submit(_counted, run) for _ in range(_reserve(len(loads) - 1))]
    try:
        run()
    finally:
        late = [helper for helper in helpers if not helper.cancel()]
        _release(len(helpers) - len(late))
        errors = [helper.exception() for helper in late]  # waits
    for error in errors:
        if error is not None:
            raise error
    return [found[k] for k in range(len(loads))]


def _reserve(wanted: int) -> int:
    """How many cores of those wanted are free to help; they count as taken from now on."""
    global _helping
    with _LOCK:
        count = max(0, min(wanted, WORKERS - 1 - _helping))
        _helping += count
    return count


def _release(count: int) -> None:
    global _helping
    with _LOCK:
        _helping -= count


def _counted(run: Callable[[], None]) -> None:
    try:
        run()
    finally:
        _release(1)
