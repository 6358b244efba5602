"""A simplified frame, as a player receives it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from . import native
from ._metrics import FrameMetrics
from .errors import InvalidMessageError, MissingDracoError

__all__ = ["Frame", "Mesh", "decode_draco"]


class Mesh(NamedTuple):
    """A triangle mesh.

    ``vertices`` are float32 of shape (n, 3) in the unit of what was published; ``faces`` are
    uint32 of shape (m, 3), indices from 0, counterclockwise seen from outside.
    """

    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.uint32]


@dataclass(frozen=True)
class Frame:
    """A simplified frame: its figures and its mesh in Draco."""

    metrics: FrameMetrics
    drc: bytes = field(repr=False)

    @property
    def seq(self) -> int:
        """Its number in the stream."""
        return self.metrics.seq

    def mesh(self) -> Mesh:
        """Decodes the mesh.

        Raises MissingDracoError without the extra ``draco``, and InvalidMessageError if the bytes
        are not a Draco mesh.
        """
        return decode_draco(self.drc)

    @classmethod
    def from_message(cls, message: native.Buffer) -> Frame:
        """Reads a delivered frame. Raises InvalidMessageError."""
        metrics, drc = native.decode_delivered(message)
        return cls(FrameMetrics.from_json(metrics), drc)


def decode_draco(drc: bytes) -> Mesh:
    """Decodes a Draco mesh.

    Raises MissingDracoError without the extra ``draco``, and InvalidMessageError if the bytes
    are not a Draco mesh.
    """
    try:
        import DracoPy  # noqa: PLC0415 # an optional dependency
    except ImportError as error:
        raise MissingDracoError(
            "decoding a mesh needs DracoPy: pip install 'steadymesh[draco]' (the bytes themselves "
            "are in Frame.drc)"
        ) from error
    try:
        decoded = DracoPy.decode(drc)
        faces = decoded.faces
    except Exception as error:  # DracoPy raises several kinds, Exception itself among them.
        raise InvalidMessageError(f"these bytes are not a Draco mesh: {error}") from error
    vertices = np.asarray(decoded.points, dtype=np.float32).reshape(-1, 3)
    return Mesh(vertices, np.asarray(faces, dtype=np.uint32).reshape(-1, 3))
