"""Handing a model on: ONNX, C99 without dependencies, friction for MuJoCo."""

import sys

from .. import Function

sys.modules[__name__].__class__ = Function  # called, this is frictionpinn.export(...)
