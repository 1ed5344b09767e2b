"""What is under way, and how long it may still take: a line that moves on a terminal or in a notebook, lines in a log
elsewhere."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")

log = logging.getLogger(__name__)
CLEAR = "\r\x1b[K"  # the line of a terminal
SHORT = 5.0  # s: what takes less needs no word on the rest; words in a log are as far apart at least
LONG = 180.0  # s: whoever must wait for longer is told why, and what makes it shorter
MANY = 10  # steps: the first is then less than a tenth of the whole
WIDTH = 100  # of the moving line: longer ones would break and not be cleared


class Steps:
    """Steps of a known number and about the same size: how many are done, how long the rest may take at that pace.

    Of many the first does not count: what is done once for all is done with it, and the largest is begun first.

    Args:
        total: how many there are; with ``most`` how many at most.
        what: they are, for :meth:`step`.
        most: fewer may do.
    """

    def __init__(self, total: int, what: str = "", *, most: bool = False):
        self.total, self.what, self.most = total, what, most
        self.done, self.began = 0, time.perf_counter()
        self.told = self.first = self.began

    def finish(self, what: str, done: int | None = None) -> None:
        """Tell that one more is done; ``done``: how many are, where what was done can be undone."""
        rest = self._rest()
        if done is not None:
            rest = rest * max(self.total - done, 0) / max(self.total - self.done, 1)
        at_most = "at most " if self.most else ""
        left = f", {at_most}about {in_words(rest)} left" if rest > SHORT else ""
        log.info(f"{what} ({self.done if done is None else done} of {at_most}{self.total}{left})")
        self._why(rest)

    def step(self) -> None:
        """The same in the moving line, or where there is none in the log where nothing was said for a while."""
        rest, now = self._rest(), time.perf_counter()
        text = f"{self.what}: {self.done} of {self.total}"
        if _shown.line is not None:
            _shown.line.show(text, rest)
        elif now - self.told > SHORT and self.done < self.total:
            self.told = now
            log.info(f"{text}, about {in_words(rest)} left" if rest > SHORT else text)
        if now - self.began > SHORT:
            self._why(rest)

    def _rest(self) -> float:
        """One more is done: how long the others may take, s; 0 where that cannot be told yet."""
        self.done, now = self.done + 1, time.perf_counter()
        if self.done == 1:
            self.first = now
        began, done = (self.first, self.done - 1) if self.total > MANY else (self.began, self.done)
        return (now - began) / max(done, 1) * max(self.total - self.done, 0)

    def _why(self, rest: float) -> None:
        if rest > LONG and _shown.shorter:
            told, _shown.shorter = _shown.shorter, ""
            log.info(f"this goes on for about {in_words(rest)} more: {told}")


def counted(items: Sequence[T], what: str) -> Iterator[T]:
    """The items, each a step that is done when the next is asked for."""
    steps = Steps(len(items), what)
    for item in items:
        yield item
        steps.step()


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
        self.until: float | None = None  # the end of what is shown, as far as can be told

    def emit(self, record: logging.LogRecord) -> None:
        self.told, self.until = record.getMessage().partition("\n")[0], None
        sys.stderr.write(CLEAR)
        sys.stderr.flush()

    def show(self, text: str, rest: float) -> None:
        """Of a step: its place among the others, and how long these may take, s."""
        self.told, self.until = text, time.perf_counter() + rest

    def run(self) -> None:
        while not self.ended.wait(1.0):
            now = time.perf_counter()
            minutes, seconds = divmod(int(now - self.began), 60)
            rest = 0.0 if self.until is None else self.until - now
            left = f", about {in_words(rest)} left" if rest > SHORT else ""
            line = f"{minutes}:{seconds:02d}  {self.told[: WIDTH - len(left)]}{left}"
            with self.lock or threading.Lock():
                sys.stderr.write(CLEAR + line)
                sys.stderr.flush()


class _Shown:
    """What this process shows: the moving line, and what would make a long run shorter, until it was said."""

    def __init__(self) -> None:
        self.line: _Line | None = None
        self.shorter = ""


_shown = _Shown()


def shorter(why: str) -> None:
    """What :class:`Steps` tell once where they go on for more than some minutes: why, and what makes it shorter."""
    _shown.shorter = why


@contextmanager
def clock() -> Iterator[None]:
    """Within, a terminal or a notebook shows the time since the start, what was told last and how long it may take."""
    if _shown.line is not None or not (sys.stderr.isatty() or "ipykernel" in sys.modules):
        yield
        return
    line, root = _Line(), logging.getLogger()
    root.handlers.insert(0, line)
    _shown.line = line
    thread = threading.Thread(target=line.run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        _shown.line = None
        line.ended.set()
        thread.join()
        root.removeHandler(line)
        sys.stderr.write(CLEAR)
        sys.stderr.flush()
