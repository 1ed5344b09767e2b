"""Text files of any encoding, compression and line end as a stream of plain lines, a piece at a time."""

from __future__ import annotations

import codecs
import gzip
import io
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from frictionpinn.errors import UserError

_PIECE = 1 << 20
_BLANK = re.compile(r"(?m)^[^\S\n]*\n")


class Lines(io.TextIOBase):
    """The lines of a text without its blank ones.

    A file of ten million rows is larger than the memory that its numbers need, so it is never held whole.
    """

    def __init__(self, text: IO[str]):
        self._text, self._ready = text, ""

    def head(self, count: int) -> list[str]:
        """The first lines that are not blank, as many as there are; they are still to be read."""
        lines: list[str] = []
        while len(lines) < count and (line := self._text.readline()):
            if line.strip():
                lines.append(line.removesuffix("\n"))
        self._ready = "".join(f"{line}\n" for line in lines)
        return lines

    def skip(self, count: int) -> None:
        """Leave out the first lines of :meth:`head`."""
        self._ready = self._ready.split("\n", count)[count]

    def readable(self) -> bool:
        return True

    def read(self, size: int | None = -1) -> str:
        """At least some characters of the rest, all of it for a negative size; an empty text at the end."""
        pieces: list[str] = []
        while piece := self._piece():
            pieces.append(piece)
            if size is not None and size >= 0:
                break
        whole = "".join(pieces)
        if size is None or size < 0 or len(whole) <= size:
            return whole
        self._ready = whole[size:]
        return whole[:size]

    def _piece(self) -> str:
        ready, self._ready = self._ready, ""
        while not ready:
            raw = self._text.read(_PIECE)
            if not raw:
                return ""
            whole = raw + self._text.readline()
            ready = _BLANK.sub("", whole if whole.endswith("\n") else f"{whole}\n")
        return ready


@contextmanager
def open_text(path: Path) -> Iterator[Lines]:
    """Open a text file, gzipped or not, UTF-8, UTF-16 or Latin-1, with any line ends.

    Raises:
        UserError: damaged compression, zero bytes or another sign of a file that is no text.
    """
    try:
        encoding = _encoding(path)
        with _open(path) as raw, io.TextIOWrapper(raw, encoding=encoding, newline=None) as text:  # type: ignore[arg-type]
            yield Lines(text)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise UserError("cannot decompress", where=str(path), received=str(error), fix="compress it again") from error


def _open(path: Path) -> IO[bytes]:
    return gzip.open(path) if path.name.lower().endswith(".gz") else path.open("rb")  # type: ignore[return-value]


def _encoding(path: Path) -> str:
    """The encoding of a file, by its first bytes and by reading all of it once."""
    with _open(path) as file:
        start = file.read(3)
        wide = start[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        decoder = codecs.getincrementaldecoder("utf-16" if wide else "utf-8")()
        piece, sound, reason = start, True, "zero bytes"
        while piece:
            try:
                text = decoder.decode(piece) if sound else ""
            except UnicodeDecodeError as error:
                # Latin-1 is what older programs write; only names and units can hold such letters.
                sound, text, reason = False, "", str(error)
            if "\x00" in text or (not wide and b"\x00" in piece):
                raise _no_text(path, reason)
            piece = file.read(_PIECE)
        try:
            decoder.decode(b"", final=sound)
        except UnicodeDecodeError as error:
            sound, reason = False, str(error)
    if wide and not sound:
        raise _no_text(path, reason)
    return "utf-16" if wide else "utf-8-sig" if sound else "latin-1"


def _no_text(path: Path, reason: str) -> UserError:
    return UserError("not a text file", where=str(path), received=reason, fix="save it as UTF-8")
