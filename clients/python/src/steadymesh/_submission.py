"""A frame to be sent, whatever it was made from."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import native
from ._arrays import stamp
from ._handle import PublishedFrame
from .errors import InvalidMeshError, InvalidMessageError

_CONTENT_TYPES = {
    ".obj": "model/obj",
    ".ply": "model/ply",
    ".glb": "model/gltf-binary",
    ".gltf": "model/gltf+json",
    ".drc": "application/vnd.draco",
    ".smf": native.CONTENT_TYPE,
}


@dataclass(frozen=True)
class Payload:
    """The bytes of a frame, and what the rig says about it."""

    body: bytes
    content_type: str
    seq: int | None = None
    capture_time_us: int | None = None

    @classmethod
    def from_file(
        cls, path: str | os.PathLike[str], seq: int | None, capture_time_us: int | None
    ) -> Payload:
        """Reads a frame file. Raises OSError, InvalidMeshError, InvalidMessageError."""
        path = Path(path)
        content_type = _CONTENT_TYPES.get(path.suffix.lower())
        if content_type is None:
            raise InvalidMeshError(f"{path} is none of {', '.join(sorted(_CONTENT_TYPES))}")
        body = path.read_bytes()
        number, time = stamp("seq", seq), stamp("capture_time_us", capture_time_us)
        if content_type == native.CONTENT_TYPE:
            try:
                own_number, own_time = native.stamps(body)
            except InvalidMessageError as error:
                raise InvalidMessageError(f"{path}: {error}") from error
            number = own_number if number is None else number
            time = own_time if time is None else time
        return cls(body, content_type, number, time)

    @property
    def is_native(self) -> bool:
        """Whether the body says its number itself."""
        return self.content_type == native.CONTENT_TYPE


class Submission:
    """A payload with its number and its handle, until the server has acknowledged it."""

    def __init__(self, payload: Payload, seq: int, handle: PublishedFrame) -> None:
        self.payload = payload
        self.seq = seq
        self.handle = handle
        # Set once a connection has begun with it, and once one has all of it.
        self.attempted = False
        self.sent = False
        # Set if the one who published it does not wait any more.
        self.abandoned = False

    def messages(self) -> list[bytes | str]:
        """What goes over a WebSocket for it."""
        body, time = self.payload.body, self.payload.capture_time_us
        if self.payload.is_native:
            return [native.restamp(body, seq=self.seq, capture_time_us=time)]
        announcement: dict[str, Any] = {"type": "frame", "seq": self.seq}
        if time is not None:
            announcement["capture_time_us"] = time
        return [json.dumps(announcement), body]
