"""What is under way, and how long it may still take: a line that moves on a terminal, lines in a log elsewhere."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

log = logging.getLogger(__name__)
CLEAR = "\r\x1b[K"  # the line of a terminal
SHORT = 5.0  # s: what takes less needs no word on the rest


class Steps:
    """Steps of a known number; after each, how many are done and how long the rest may take at that pace."""

    def __init__(self, total: int):
        self.total, self.done, self.began = total, 0, time.perf_counter()

    def finish(self, what: str) -> None:
        """Tell that one more is done."""
        self.done += 1
        spent = time.perf_counter() - self.began
        rest = spent / self.done * (self.total - self.done)
        left = f", about {in_words(rest)} left" if rest > SHORT else ""
        log.info(f"{what} ({self.done} of {self.total}{left})")


def in_words(seconds: float) -> str:
    """A time that needs no more than one figure: "40 s", "3 min", "2 h"."""
    for size, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


class _Line(logging.Handler):
    """Called before the handlers that print: clears the moving line, and keeps the message for it."""

    def __init__(self) -> None:
        super().__init__()
        self.told, self.began, self.ended = "", time.perf_counter(), threading.Event()

    def emit(self, record: logging.LogRecord) -> None:
        self.told = record.getMessage().partition("\n")[0]
        sys.stderr.write(CLEAR)
        sys.stderr.flush()

    def run(self) -> None:
        while not self.ended.wait(1.0):
            minutes, seconds = divmod(int(time.perf_counter() - self.began), 60)
            with self.lock or threading.Lock():
                sys.stderr.write(f"{CLEAR}{minutes}:{seconds:02d}  {self.told[:70]}")
                sys.stderr.flush()


@contextmanager
def clock() -> Iterator[None]:
    """Within, a terminal shows the time that has passed since the start and what was told last."""
    if not sys.stderr.isatty():
        yield
        return
    line, root = _Line(), logging.getLogger()
    root.handlers.insert(0, line)
    thread = threading.Thread(target=line.run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        line.ended.set()
        thread.join()
        root.removeHandler(line)
        sys.stderr.write(CLEAR)
        sys.stderr.flush()
