"""The one error that users see: a line that says what, where, received, allowed and what to do next."""

from __future__ import annotations

import difflib
import errno
from collections.abc import Iterable, Mapping


class UserError(ValueError):
    """A mistake in a file, a configuration or a command that its author can mend.

    Args:
        what: what is wrong, in a few words.
        where: the file, column, row or configuration key.
        received: the value found there (omitted where there is none).
        allowed: the values that would be right.
        fix: what to do next.

    The message is a single line, so that a terminal shows it whole::

        negative mass: system.parameters.m_b is -0.5 kg; allowed: above 0 kg; set it to the box's mass
    """

    def __init__(self, what: str, *, where: str = "", received: object = None, allowed: str = "", fix: str = ""):
        self.what, self.where, self.received, self.allowed, self.fix = what, where, received, allowed, fix
        place = f"{where} is {received}" if where and received is not None else where or ""
        if not where and received is not None:
            place = f"received {received}"
        head = f"{what}: {place}" if place else what
        tail = [f"allowed: {allowed}" if allowed else "", fix]
        super().__init__(" ".join("; ".join([head, *filter(None, tail)]).split()))


class Interrupted(BaseException):
    """Ctrl-C, with a line on what was kept and how to go on.

    No KeyboardInterrupt, which some libraries take for themselves.
    """


# Errors of a disk, which the user can mend; others of the system are shown whole.
DISK = (errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS, errno.EFBIG, errno.EIO, errno.ENOTDIR,
        errno.EISDIR, errno.EEXIST)  # fmt: skip


def unwritable(error: OSError, place: object, fix: str) -> UserError:
    """The user's error behind an error of the disk.

    Raises:
        OSError: the error itself, where it is none of the disk.
    """
    if error.errno not in DISK:
        raise error
    return unwritten(error, place, fix)


def unwritten(error: OSError, place: object, fix: str) -> UserError:
    """The user's error where a file or folder of a given name cannot be written, whatever the system says of it."""
    where = str(error.filename or place)
    return UserError("cannot write", where=where, received=error.strerror or str(error), fix=fix)


def nearest(name: object, valid: Iterable[str]) -> str:
    """Return ``did you mean 'x'?`` for the valid name closest to ``name``, or an empty string."""
    return nearest_of(name, {each: each for each in valid})


def nearest_of(name: object, told: Mapping[str, str], cutoff: float = 0.5) -> str:
    """As :func:`nearest`, among names that are told otherwise than they are compared, ``told[x]``; the less alike they
    may be, the lower ``cutoff``."""
    close = difflib.get_close_matches(str(name), list(told), n=1, cutoff=cutoff)
    return f"did you mean '{told[close[0]]}'?" if close else ""


def choose(name: str, table: Mapping, where: str, fix: str = "use one of the allowed names"):
    """Look ``name`` up in ``table``; raise :class:`UserError` with the nearest valid name, or ``fix``, otherwise."""
    if name in table:
        return table[name]
    raise UserError(
        "unknown option",
        where=where,
        received=repr(name),
        allowed=", ".join(sorted(table)),
        fix=nearest(name, table) or fix,
    )


def check_processes(number: object, where: str) -> int:
    """Return a number of processes; raise :class:`UserError` for one that is no whole number from 1."""
    if isinstance(number, bool) or not isinstance(number, int) or number < 1:
        raise UserError("impossible number of processes", where=where, received=repr(number),
                        allowed="a whole number from 1", fix="take the number of cores at most")  # fmt: skip
    return number
