"""Threads of processes that compute side by side."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

THREADS = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"  # that set the number of threads


def silent() -> None:
    """Let Ctrl-C end this process without a traceback: the one that started it says what became of the work."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def one_thread() -> Iterator[None]:
    """Processes that start meanwhile compute with one thread: the waiting threads of two take each other's cores."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
