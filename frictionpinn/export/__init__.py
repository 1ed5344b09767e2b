"""Handing a model on: ONNX, C99 without dependencies, friction for MuJoCo."""

from .portable import PortableModel

__all__ = ["PortableModel"]
