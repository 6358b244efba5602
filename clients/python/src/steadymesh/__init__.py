"""Publish mesh frames to a Steadymesh server, and receive them simplified.

- :class:`Publisher` sends frames, as arrays or files.
- :func:`subscribe` receives a stream's frames with their metrics.
- :func:`streams`, :func:`stream`, :func:`configure`, :func:`delete`, :func:`latest`,
  :func:`frame` and :func:`metrics` are one request each.
- :mod:`steadymesh.native` has the bytes of the messages.

Every error is a :class:`SteadymeshError`; what the server refuses is a :class:`ProblemError`.
"""

from . import native
from ._frame import Frame, Mesh, decode_draco
from ._handle import PublishedFrame
from ._metrics import (
    Consistency,
    DistancePair,
    FrameMetrics,
    Input,
    Output,
    Registration,
    Residual,
    StageTimes,
    Statistics,
    Texture,
)
from ._publisher import Publisher
from ._streams import StreamInfo, configure, delete, frame, latest, metrics, stream, streams
from ._subscription import Ended, Hello, Skipped, Subscription, subscribe
from .errors import (
    ConnectionEndedError,
    FrameDroppedError,
    InvalidAddressError,
    InvalidMeshError,
    InvalidMessageError,
    MissingDracoError,
    ProblemError,
    PublisherClosedError,
    PublishTimeoutError,
    ServerUnreachableError,
    SteadymeshError,
)

__all__ = [
    "ConnectionEndedError",
    "Consistency",
    "DistancePair",
    "Ended",
    "Frame",
    "FrameDroppedError",
    "FrameMetrics",
    "Hello",
    "Input",
    "InvalidAddressError",
    "InvalidMeshError",
    "InvalidMessageError",
    "Mesh",
    "MissingDracoError",
    "Output",
    "ProblemError",
    "PublishTimeoutError",
    "PublishedFrame",
    "Publisher",
    "PublisherClosedError",
    "Registration",
    "Residual",
    "ServerUnreachableError",
    "Skipped",
    "StageTimes",
    "Statistics",
    "SteadymeshError",
    "StreamInfo",
    "Subscription",
    "Texture",
    "configure",
    "decode_draco",
    "delete",
    "frame",
    "latest",
    "metrics",
    "native",
    "stream",
    "streams",
    "subscribe",
]
