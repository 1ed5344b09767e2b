"""Recordings off the beaten path, drawn by seed."""

from wide_draw import Case, draw

__all__ = ["Case", "draw"]
