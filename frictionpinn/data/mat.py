"""Reading of MAT files of every version."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

_MATRIX, _COMPRESSED = 14, 15
_TYPES = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18, _MATRIX})
_SPARSE, _CHAR, _NUMERIC = 5, 4, range(6, 16)


def load_mat(path: Path) -> dict[str, Any]:
    """The variables of a MAT file, of a struct its fields, ``"log.t"``; errors of many kinds where it is damaged."""
    import h5py

    if h5py.is_hdf5(path):
        with h5py.File(path) as file:
            variables: dict[str, Any] = {}

            def keep(name: str | bytes, item: Any) -> None:
                name = name if isinstance(name, str) else name.decode("latin-1")  # bytes: not of UTF-8, as HDF5 asks
                if isinstance(item, h5py.Dataset) and not name.startswith("#"):  # #refs# holds what cells point to
                    # MATLAB stores arrays column by column, so that they arrive transposed.
                    variables[name.replace("/", ".")] = np.asarray(item).T

            file.visititems(keep)
            return variables
    from scipy.io import loadmat

    raw = path.read_bytes()
    if raw[126:128] in (b"IM", b"MI"):
        _check_elements(raw, 128, len(raw), "<" if raw[126:128] == b"IM" else ">", frozenset({_MATRIX, _COMPRESSED}))
    return {name: value for key, item in loadmat(path).items() for name, value in _fields(key, item)}


def _fields(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """A variable by its name, or the fields of a struct, and of those within it."""
    if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
        for field in value.dtype.names:
            yield from _fields(f"{name}.{field}", value[field].item())
    else:
        yield name, value


def _check_elements(raw: bytes, start: int, end: int, order: str, types: frozenset[int] = _TYPES) -> int:
    """Walk the elements between two offsets and return their number.

    scipy indexes a table by an element's type without looking whether it exists, so that a damaged file ends the
    process instead of raising. Compressed elements carry a checksum of their own.
    """
    count = 0
    while start < end:
        if start + 8 > end:
            raise ValueError("truncated element")
        kind, size = struct.unpack_from(f"{order}II", raw, start)
        if kind >> 16:
            kind, size, begin, stop = kind & 0xFFFF, kind >> 16, start + 4, start + 8
            sound = size <= 4 and kind in types - {_MATRIX, _COMPRESSED}
        else:
            begin = start + 8
            stop = begin + (size if kind == _COMPRESSED else -(-size // 8) * 8)
            sound = begin + size <= end and kind in types
        if not sound:
            raise ValueError(f"element of type {kind} and {size} bytes at byte {start}")
        if kind == _MATRIX and size:
            _check_matrix(raw, begin, begin + size, order)
        start, count = stop, count + 1
    return count


def _check_matrix(raw: bytes, start: int, end: int, order: str) -> None:
    """Check that a matrix has as many parts as its class and its complex flag need."""
    parts = _check_elements(raw, start, end, order)
    (flags,) = struct.unpack_from(f"{order}I", raw, start + 8)
    array_class, complex_part = flags & 0xFF, bool(flags & 0x800)
    needed = {**dict.fromkeys(_NUMERIC, 4), _CHAR: 4, _SPARSE: 6}.get(array_class)
    if needed is not None and parts != needed + complex_part:
        raise ValueError(f"matrix of class {array_class} in {parts} parts at byte {start}")
