"""A figure drawn once, as pixels and as a PNG file: ``savefig`` draws it twice, the first time for its layout alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

DPI = 120


def save_png(figure: Figure, path: Path, dpi: int = DPI) -> np.ndarray:
    """Write a figure as PNG; return its pixels, shape (height, width, 4), 8 bits each."""
    figure.set_dpi(dpi)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    imsave(path, pixels, dpi=dpi)
    return pixels
