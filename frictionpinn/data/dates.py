"""Dates and durations, as loggers write times, in seconds."""

from __future__ import annotations

import re

import numpy as np

_DATE = re.compile(r"\d{4}-\d\d")


def since_first(values: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Dates, or durations, in seconds from the earliest, and when that was, s since 1970 (of durations 0).

    None where they are neither, numbers or text that is no date of ISO 8601. A missing one is NaN.
    """
    import pandas as pd

    if values.dtype.kind == "m":
        return pd.to_timedelta(values).total_seconds().to_numpy(float), 0.0
    first = str(next((value for value in values if not pd.isna(value)), ""))
    if values.dtype.kind not in "MOU" or not _DATE.match(first):
        return None
    try:
        dates = pd.to_datetime(values, format="ISO8601", utc=True)
    except (ValueError, TypeError, OverflowError):
        return None
    # Counted from 1970, doubles would tell them to 0.2 us.
    return (dates - dates.min()).total_seconds().to_numpy(float), dates.min().timestamp()
