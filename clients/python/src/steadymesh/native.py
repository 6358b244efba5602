"""The two binary messages: the native frame (rig to server) and the delivered one (to players).

Bytes to values and back, without IO: see proto/README.md for the layout. All sizes are checked
against the message before anything is made of it.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from ._arrays import color_rows, face_rows, float_rows, stamp
from .errors import InvalidMessageError

__all__ = [
    "CONTENT_TYPE",
    "SUBPROTOCOL",
    "NativeFrame",
    "decode",
    "decode_delivered",
    "encode",
    "encode_delivered",
    "restamp",
    "stamps",
]

CONTENT_TYPE = "application/vnd.steadymesh.frame"
"""The content type of a native frame."""
SUBPROTOCOL = "steadymesh.v1"
"""The WebSocket subprotocol."""

Buffer = Union[bytes, bytearray, memoryview]

_MAGIC = b"SMF1"
_DELIVERED_MAGIC = b"SMDF"
_HAS_IMAGE = 1
_VERSION = 1


@dataclass(frozen=True)
class NativeFrame:
    """One mesh with what is known about its capture.

    - ``vertices``: float32, shape (n, 3); ``faces``: uint32, shape (m, 3), indices from 0.
    - ``normals``: float32, shape (n, 3); ``colors``: uint8, shape (n, 4), red, green, blue, alpha;
      ``texture_coordinates``: float32, shape (n, 2). None where there are none.
    - ``seq``: its number; ``capture_time_us``: microseconds since 1970-01-01T00:00:00Z.
    """

    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.uint32]
    normals: npt.NDArray[np.float32] | None = None
    colors: npt.NDArray[np.uint8] | None = None
    texture_coordinates: npt.NDArray[np.float32] | None = None
    seq: int | None = None
    capture_time_us: int | None = None


@dataclass(frozen=True)
class _Envelope:
    seq: int | None
    capture_time_us: int | None
    vertex_count: int
    face_count: int
    has_normals: bool
    has_colors: bool
    has_texture_coordinates: bool

    def array_bytes(self) -> int:
        per_vertex = 12 + 12 * self.has_normals + 4 * self.has_colors
        per_vertex += 8 * self.has_texture_coordinates
        return self.vertex_count * per_vertex + self.face_count * 12

    def encode(self) -> bytes:
        body = struct.pack("<H", _VERSION)
        for value in (self.seq, self.capture_time_us):
            body += b"\0" if value is None else struct.pack("<BQ", 1, value)
        body += struct.pack(
            "<II???",
            self.vertex_count,
            self.face_count,
            self.has_normals,
            self.has_colors,
            self.has_texture_coordinates,
        )
        return _MAGIC + struct.pack("<I", len(body)) + body


def encode(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    *,
    normals: npt.ArrayLike | None = None,
    colors: npt.ArrayLike | None = None,
    texture_coordinates: npt.ArrayLike | None = None,
    seq: int | None = None,
    capture_time_us: int | None = None,
) -> bytes:
    """Writes a native frame.

    ``vertices`` are numbers of shape (n, 3) in any unit, sent as float32; ``faces`` are integers
    of shape (m, 3), from 0, counterclockwise seen from outside. ``normals`` have the shape (n, 3),
    ``colors`` are uint8 of shape (n, 3) or (n, 4), ``texture_coordinates`` have the shape (n, 2).

    Raises InvalidMeshError, which names the array and what is wrong with it.
    """
    positions = float_rows("vertices", vertices, 3, None)
    count = len(positions)
    triangles = face_rows(faces, count)
    parts = [positions]
    if normals is not None:
        parts.append(float_rows("normals", normals, 3, count))
    if colors is not None:
        parts.append(color_rows(colors, count))
    if texture_coordinates is not None:
        parts.append(float_rows("texture_coordinates", texture_coordinates, 2, count))
    envelope = _Envelope(
        seq=stamp("seq", seq),
        capture_time_us=stamp("capture_time_us", capture_time_us),
        vertex_count=count,
        face_count=len(triangles),
        has_normals=normals is not None,
        has_colors=colors is not None,
        has_texture_coordinates=texture_coordinates is not None,
    )
    return b"".join([envelope.encode(), *(part.tobytes() for part in parts), triangles.tobytes()])


def decode(message: Buffer) -> NativeFrame:
    """Reads a native frame. The arrays look into ``message`` and cannot be written to.

    Raises InvalidMessageError for anything else, faces that refer to no vertex included.
    """
    envelope, offset = _read_envelope(message)
    found = len(message) - offset
    if envelope.array_bytes() != found:
        raise InvalidMessageError(
            f"{envelope.vertex_count} vertices and {envelope.face_count} faces with these "
            f"attributes need {envelope.array_bytes()} bytes of arrays, but there are {found}"
        )
    view = memoryview(message).toreadonly()

    def take(kind: str, rows: int, columns: int) -> npt.NDArray[Any]:
        nonlocal offset
        array = np.frombuffer(view, kind, rows * columns, offset).reshape(rows, columns)
        offset += array.nbytes
        return array

    count = envelope.vertex_count
    vertices = take("<f4", count, 3)
    normals = take("<f4", count, 3) if envelope.has_normals else None
    colors = take("u1", count, 4) if envelope.has_colors else None
    coordinates = take("<f4", count, 2) if envelope.has_texture_coordinates else None
    faces = take("<u4", envelope.face_count, 3)
    if faces.size and count <= int(faces.max()):
        raise InvalidMessageError(f"a face refers to vertex {faces.max()}, but there are {count}")
    return NativeFrame(
        vertices=vertices,
        faces=faces,
        normals=normals,
        colors=colors,
        texture_coordinates=coordinates,
        seq=envelope.seq,
        capture_time_us=envelope.capture_time_us,
    )


def stamps(message: Buffer) -> tuple[int | None, int | None]:
    """The number and the time of capture (in microseconds since 1970) of a native frame.

    Raises InvalidMessageError if the envelope cannot be read; the arrays are not looked at.
    """
    envelope, _ = _read_envelope(message)
    return envelope.seq, envelope.capture_time_us


def restamp(
    message: Buffer, *, seq: int | None = None, capture_time_us: int | None = None
) -> bytes:
    """The same native frame with another number or time; None leaves its own.

    Raises InvalidMessageError if the envelope cannot be read.
    """
    old, offset = _read_envelope(message)
    number, time = stamp("seq", seq), stamp("capture_time_us", capture_time_us)
    new = _Envelope(
        seq=old.seq if number is None else number,
        capture_time_us=old.capture_time_us if time is None else time,
        vertex_count=old.vertex_count,
        face_count=old.face_count,
        has_normals=old.has_normals,
        has_colors=old.has_colors,
        has_texture_coordinates=old.has_texture_coordinates,
    )
    return b"".join([new.encode(), memoryview(message)[offset:]])


def _read_envelope(message: Buffer) -> tuple[_Envelope, int]:
    """The envelope, and where the arrays begin."""
    if bytes(message[:4]) != _MAGIC:
        raise InvalidMessageError('a native frame starts with the bytes "SMF1"')
    if len(message) < 8:
        raise InvalidMessageError(f"the frame ends after {len(message)} bytes, in its prefix")
    (length,) = struct.unpack_from("<I", message, 4)
    if len(message) < 8 + length:
        raise InvalidMessageError(f"the frame ends after {len(message)} bytes, in its envelope")
    reader = _EnvelopeReader(bytes(message[8 : 8 + length]))
    version = reader.number("<H")
    if version != _VERSION:
        raise InvalidMessageError(
            f"version {version} of the native frame, but only version {_VERSION} is known"
        )
    envelope = _Envelope(
        seq=reader.optional(),
        capture_time_us=reader.optional(),
        vertex_count=reader.number("<I"),
        face_count=reader.number("<I"),
        has_normals=reader.flag(),
        has_colors=reader.flag(),
        has_texture_coordinates=reader.flag(),
    )
    reader.finish()
    return envelope, 8 + length


class _EnvelopeReader:
    def __init__(self, body: bytes) -> None:
        self._body = body
        self._at = 0

    def number(self, kind: str) -> int:
        end = self._at + struct.calcsize(kind)
        if len(self._body) < end:
            raise InvalidMessageError(f"the envelope of {len(self._body)} bytes is too short")
        (value,) = struct.unpack_from(kind, self._body, self._at)
        self._at = end
        return int(value)

    def flag(self) -> bool:
        value = self.number("<B")
        if value not in (0, 1):
            raise InvalidMessageError(f"a flag of the envelope is {value}, not 0 or 1")
        return value == 1

    def optional(self) -> int | None:
        return self.number("<Q") if self.flag() else None

    def finish(self) -> None:
        left = len(self._body) - self._at
        if left:
            raise InvalidMessageError(f"the envelope is {left} bytes too long")


def decode_delivered(message: Buffer) -> tuple[dict[str, Any], bytes]:
    """Reads a delivered frame: its metrics, as they are in JSON, and its Draco bytes.

    An image behind them, which has to be asked for, is left out.

    Raises InvalidMessageError.
    """
    if len(message) < 16:
        raise InvalidMessageError(f"{len(message)} bytes are less than the header of 16")
    magic, version, flags, metrics_bytes, mesh_bytes = struct.unpack_from("<4sHHII", message)
    if magic != _DELIVERED_MAGIC:
        raise InvalidMessageError('a delivered frame starts with the bytes "SMDF"')
    if version != _VERSION:
        raise InvalidMessageError(
            f"version {version} of the delivered frame, but only version {_VERSION} is known"
        )
    end = 16 + metrics_bytes + mesh_bytes
    has_image = flags & _HAS_IMAGE != 0
    if len(message) < end or (not has_image and end < len(message)):
        raise InvalidMessageError(
            f"{metrics_bytes} bytes of metrics and {mesh_bytes} of mesh, but the message has "
            f"{len(message) - 16} for both"
        )
    try:
        metrics = json.loads(bytes(message[16 : 16 + metrics_bytes]))
    except ValueError as error:
        raise InvalidMessageError(f"the metrics cannot be read: {error}") from error
    if not isinstance(metrics, dict) or not isinstance(metrics.get("seq"), int):
        raise InvalidMessageError("the metrics are not an object with a seq")
    return metrics, bytes(message[16 + metrics_bytes : end])


def encode_delivered(metrics: Mapping[str, Any], drc: bytes) -> bytes:
    """Writes a delivered frame, as the server does: for tests and recordings."""
    text = json.dumps(metrics).encode()
    return struct.pack("<4sHHII", _DELIVERED_MAGIC, _VERSION, 0, len(text), len(drc)) + text + drc
