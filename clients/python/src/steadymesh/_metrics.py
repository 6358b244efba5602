"""The figures that come with every frame.

Distances are in the mesh's own unit, times in microseconds. What a server does not send has its
default, and what this version does not know is in :attr:`FrameMetrics.raw`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

__all__ = [
    "Consistency",
    "DistancePair",
    "FrameMetrics",
    "Input",
    "Output",
    "Registration",
    "Residual",
    "StageTimes",
    "Statistics",
]

_Flat = TypeVar("_Flat")


def _flat(kind: type[_Flat], document: Any) -> _Flat:
    """An object of ``kind`` from the fields of the same name."""
    if not isinstance(document, Mapping):
        return kind()
    names = (one.name for one in fields(kind))  # type: ignore[arg-type]
    return kind(**{name: document[name] for name in names if name in document})


@dataclass(frozen=True)
class Statistics:
    """Summary of ``count`` distances d: ``mean`` is (1/n) Σ d and ``mse`` is (1/n) Σ d²."""

    mean: float = 0.0
    variance: float = 0.0
    std: float = 0.0
    mse: float = 0.0
    rmse: float = 0.0
    max: float = 0.0
    count: int = 0


@dataclass(frozen=True)
class DistancePair:
    """Distances of the simplified mesh to the frames.

    ``previous`` is to the registered frame k-1, None without one; ``current`` is to frame k.
    """

    previous: Statistics | None
    current: Statistics


@dataclass(frozen=True)
class Input:
    """What came in, and what repair did to it."""

    vertices: int = 0
    faces: int = 0
    bytes: int = 0
    welded_vertices: int = 0
    removed_faces: int = 0
    non_manifold_edges: int = 0
    unreferenced_vertices: int = 0


@dataclass(frozen=True)
class Output:
    """What went out; ``bytes`` is its length in Draco.

    ``points`` is how many points the mesh is delivered with: where a texture has a seam, a vertex
    has one for each side of it.
    """

    vertices: int = 0
    faces: int = 0
    bytes: int = 0
    target_reached: bool = False
    points: int = 0


@dataclass(frozen=True)
class Texture:
    """The image on a frame: its name, format and size; ``encoded`` if the server made it."""

    id: str = ""
    media_type: str = ""
    bytes: int = 0
    width: int = 0
    height: int = 0
    encoded: bool = False


@dataclass(frozen=True)
class Residual:
    """Distances of the registered vertices to the frame's surface."""

    mean: float = 0.0
    rms: float = 0.0
    p95: float = 0.0
    max: float = 0.0


@dataclass(frozen=True)
class Registration:
    """How well the previous frame was registered onto this one."""

    rigid_rmse: float = 0.0
    residual: Residual = field(default_factory=Residual)
    nodes: int = 0
    iterations: int = 0


@dataclass(frozen=True)
class Consistency:
    """What has come back of the previous result, carried along by the registration.

    ``vertex_persistence`` and ``edge_persistence`` are shares, 0 to 1, of the vertices and of the
    edges; ``flicker`` is the mean distance of the carried surface and the new one.
    """

    vertex_persistence: float = 0.0
    edge_persistence: float = 0.0
    flicker: float = 0.0


@dataclass(frozen=True)
class StageTimes:
    """How long each stage took, in microseconds."""

    parse: int = 0
    repair: int = 0
    register: int = 0
    simplify: int = 0
    measure: int = 0
    encode: int = 0


@dataclass(frozen=True)
class FrameMetrics:
    """One frame's metrics.

    - ``seq``: its number; ``capture_time_us``: microseconds since 1970, if the rig said so.
    - ``tracking``: how it was simplified: ``off`` for a first frame and after a reset.
    - ``quality``: ``full``, or what a live stream under load left out: ``sampled`` (some
      distances), ``quick`` (a coarser registration, no fit), ``untracked`` (no registration).
    - ``reference_seq``: the frame that was registered onto it; None for a first frame and after a
      reset.
    - ``reset``: why it was treated as a first frame although there is one before; None if not.
    - ``surface_distance``, ``vertex_distance``: from each vertex of the simplified mesh to the
      surface and to the nearest vertex of the frames; ``current_to_output``: from each vertex of
      the frame to the simplified surface. None where the stream's ``metrics`` are ``off``.
    - ``consistency``: what has come back of the previous result; None without a registration.
    - ``texture``: the image on it; None without one. ``texture_error``: why one that came with
      it is not delivered.
    - ``bbox_diagonal``: of the frame's bounding box.
    - ``latency_us``: from the arrival of the whole frame to its delivery, in microseconds.
    - ``raw``: all of it, as the server sent it.
    """

    seq: int
    capture_time_us: int | None
    tracking: str
    reference_seq: int | None
    input: Input
    output: Output
    registration: Registration | None
    surface_distance: DistancePair | None
    vertex_distance: DistancePair | None
    current_to_output: Statistics | None
    bbox_diagonal: float
    stage_us: StageTimes
    latency_us: int
    registration_error: str | None = None
    reset: str | None = None
    quality: str = "full"
    consistency: Consistency | None = None
    texture: Texture | None = None
    texture_error: str | None = None
    raw: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> FrameMetrics:
        """Reads what the server sends. Raises KeyError without a ``seq``."""
        return cls(
            seq=document["seq"],
            capture_time_us=document.get("capture_time_us"),
            tracking=document.get("tracking", "off"),
            reference_seq=document.get("reference_seq"),
            input=_flat(Input, document.get("input")),
            output=_flat(Output, document.get("output")),
            registration=_registration(document.get("registration")),
            surface_distance=_pair(document.get("surface_distance")),
            vertex_distance=_pair(document.get("vertex_distance")),
            current_to_output=_statistics(document.get("current_to_output")),
            bbox_diagonal=document.get("bbox_diagonal", 0.0),
            stage_us=_flat(StageTimes, document.get("stage_us")),
            latency_us=document.get("latency_us", 0),
            registration_error=document.get("registration_error"),
            reset=document.get("reset"),
            quality=document.get("quality", "full"),
            consistency=_consistency(document.get("consistency")),
            texture=_texture(document.get("texture")),
            texture_error=document.get("texture_error"),
            raw=document,
        )


def _texture(document: Any) -> Texture | None:
    return None if document is None else _flat(Texture, document)


def _consistency(document: Any) -> Consistency | None:
    return None if document is None else _flat(Consistency, document)


def _statistics(document: Any) -> Statistics | None:
    return None if document is None else _flat(Statistics, document)


def _pair(document: Any) -> DistancePair | None:
    if not isinstance(document, Mapping):
        return None
    current = _flat(Statistics, document.get("current"))
    return DistancePair(previous=_statistics(document.get("previous")), current=current)


def _registration(document: Any) -> Registration | None:
    if not isinstance(document, Mapping):
        return None
    flat = _flat(Registration, document)
    residual = _flat(Residual, document.get("residual"))
    return Registration(flat.rigid_rmse, residual, flat.nodes, flat.iterations)
