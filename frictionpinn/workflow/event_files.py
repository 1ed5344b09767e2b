"""TensorBoard's event files without torch, whose import takes as long as all figures of a diagnosis."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from PIL import Image
from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.compat.proto.tensor_pb2 import TensorProto
from tensorboard.compat.proto.tensor_shape_pb2 import TensorShapeProto
from tensorboard.compat.proto.types_pb2 import DT_STRING
from tensorboard.plugins.text.metadata import create_summary_metadata
from tensorboard.summary.writer.event_file_writer import EventFileWriter


def write_events(
    folder: Path, scalars: Mapping[str, Sequence[float]], images: Mapping[str, Path], texts: Mapping[str, str]
) -> None:
    """Write an event file that ``tensorboard --logdir`` shows.

    Args:
        folder: made if it is not there.
        scalars: tag -> values at the steps 0, 1, ...
        images: tag -> PNG file.
        texts: tag -> Markdown.
    """
    writer = EventFileWriter(str(folder))
    try:
        for tag, values in scalars.items():
            for step, value in enumerate(values):
                _add(writer, Summary.Value(tag=tag, simple_value=float(value)), step)
        for tag, path in images.items():
            _add(writer, Summary.Value(tag=tag, image=_image(path)))
        for tag, text in texts.items():
            _add(writer, _text(tag, text))
    finally:
        writer.close()


def _add(writer: EventFileWriter, value: Any, step: int = 0) -> None:
    writer.add_event(Event(wall_time=time.time(), step=step, summary=Summary(value=[value])))


def _image(path: Path) -> Any:
    with Image.open(path) as picture:
        width, height = picture.size
        return Summary.Image(
            height=height, width=width, colorspace=len(picture.getbands()), encoded_image_string=path.read_bytes()
        )


def _text(tag: str, text: str) -> Any:
    tensor = TensorProto(
        dtype=DT_STRING,
        string_val=[text.encode()],
        tensor_shape=TensorShapeProto(dim=[TensorShapeProto.Dim(size=1)]),
    )
    return Summary.Value(
        tag=f"{tag}/text_summary", metadata=create_summary_metadata(display_name=tag, description=""), tensor=tensor
    )
