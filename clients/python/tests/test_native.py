from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import FACE, TRIANGLE

from steadymesh import Frame, InvalidMeshError, InvalidMessageError, native

VECTORS = Path(__file__).parents[3] / "proto" / "vectors"


def golden(name: str) -> bytes:
    if not VECTORS.is_dir():
        pytest.skip(f"the golden messages are not at {VECTORS}")
    return (VECTORS / name).read_bytes()


def test_the_golden_native_frame_is_read_as_documented() -> None:
    frame = native.decode(golden("native_frame.bin"))
    assert (frame.seq, frame.capture_time_us) == (7, 1_700_000_000_000_000)
    np.testing.assert_array_equal(frame.vertices, TRIANGLE)
    np.testing.assert_array_equal(frame.faces, FACE)
    assert frame.colors is not None
    assert frame.colors.tolist() == [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]]
    assert frame.normals is None
    assert frame.texture_coordinates is None


def test_the_golden_native_frame_is_written_to_the_byte() -> None:
    colors = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255]], dtype=np.uint8)
    frame = native.encode(
        TRIANGLE, FACE, colors=colors, seq=7, capture_time_us=1_700_000_000_000_000
    )
    assert frame == golden("native_frame.bin")


def test_the_golden_delivered_frame_is_read_as_documented() -> None:
    frame = Frame.from_message(golden("delivered_frame.bin"))
    assert (frame.seq, frame.drc) == (41, b"DRACO")
    metrics = frame.metrics
    assert (metrics.reference_seq, metrics.input.vertices, metrics.output.faces) == (
        40,
        20672,
        4000,
    )
    assert (metrics.registration, metrics.surface_distance) == (None, None)
    assert (metrics.bbox_diagonal, metrics.stage_us.encode, metrics.latency_us) == (21.25, 6, 21)
    assert metrics.raw["a_field_of_a_later_version"] is True


@pytest.mark.parametrize("name", ["native_frame.bin", "delivered_frame.bin"])
def test_a_message_cut_short_or_with_more_behind_it_is_refused(name: str) -> None:
    message = golden(name)
    decode = native.decode if name.startswith("native") else native.decode_delivered
    for length in range(len(message)):
        with pytest.raises(InvalidMessageError):
            decode(message[:length])
    with pytest.raises(InvalidMessageError):
        decode(message + b"\0")


@pytest.mark.parametrize("seed", range(20))
def test_whatever_is_written_is_read_again(seed: int) -> None:
    random = np.random.default_rng(seed)
    count, face_count = int(random.integers(1, 200)), int(random.integers(0, 300))
    vertices = random.normal(size=(count, 3)).astype(np.float32)
    faces = random.integers(0, count, size=(face_count, 3))
    normals = random.normal(size=(count, 3)).astype(np.float32) if seed & 1 else None
    colors = random.integers(0, 256, size=(count, 4), dtype=np.uint8) if seed & 2 else None
    coordinates = random.random(size=(count, 2), dtype=np.float32) if seed & 4 else None
    seq = int(random.integers(0, 2**64, dtype=np.uint64)) if seed & 8 else None

    frame = native.decode(
        native.encode(
            vertices,
            faces,
            normals=normals,
            colors=colors,
            texture_coordinates=coordinates,
            seq=seq,
        )
    )

    np.testing.assert_array_equal(frame.vertices, vertices)
    np.testing.assert_array_equal(frame.faces, faces)
    pairs: list[tuple[Any, Any]] = [
        (frame.normals, normals),
        (frame.colors, colors),
        (frame.texture_coordinates, coordinates),
    ]
    for found, expected in pairs:
        assert (found is None) == (expected is None)
        if expected is not None:
            np.testing.assert_array_equal(found, expected)
    assert (frame.seq, frame.capture_time_us) == (seq, None)


@pytest.mark.parametrize("seed", range(200))
def test_damaged_messages_are_refused_and_never_anything_else(seed: int) -> None:
    random = np.random.default_rng(seed)
    message = bytearray(native.encode(TRIANGLE, FACE, seq=3))
    for at in random.integers(0, len(message), size=3):
        message[at] = int(random.integers(0, 256))
    try:
        frame = native.decode(message)
    except InvalidMessageError:
        return
    assert frame.vertices.shape[1] == 3


def test_arrays_of_any_layout_and_type_are_taken() -> None:
    expected = native.encode(TRIANGLE, FACE)
    assert native.encode(TRIANGLE.tolist(), FACE.tolist()) == expected
    assert native.encode(TRIANGLE.astype(">f8"), FACE.astype(np.int64)) == expected
    assert native.encode(np.asfortranarray(TRIANGLE), FACE[:, :]) == expected
    wide = np.zeros((3, 6))
    wide[:, ::2] = TRIANGLE
    assert native.encode(wide[:, ::2], FACE) == expected


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"vertices": TRIANGLE[:, :2]}, r"vertices must have the shape \(n, 3\), not \(3, 2\)"),
        ({"vertices": TRIANGLE * 1j}, "vertices must be numbers, not complex64"),
        ({"vertices": [[0, 0, np.nan]] * 3}, r"vertices\[0\] is .*nan"),
        ({"vertices": [[0, 0, 0], [0, 1e39, 0], [1, 0, 0]]}, r"vertices\[1\] .* float32"),
        ({"vertices": [[0, 0, 0], [0, 1]]}, "vertices"),
        ({"faces": [[0, 1, 2, 0]]}, r"faces must have the shape \(n, 3\), not \(1, 4\)"),
        ({"faces": [[0.0, 1.0, 2.0]]}, "faces must be integers, not float64"),
        ({"faces": [[0, 1, 2], [1, 2, 3]]}, r"faces\[1\] is \[1, 2, 3\], but .* there are 3"),
        ({"faces": [[0, 1, -1]]}, r"faces\[0\] is \[0, 1, -1\]"),
        ({"normals": TRIANGLE[:2]}, "2 normals for 3 vertices"),
        ({"colors": np.ones((3, 3))}, "colors must be uint8 .* multiply by 255"),
        ({"colors": np.ones((3, 2), np.uint8)}, r"colors must have the shape \(3, 3 or 4\)"),
        ({"texture_coordinates": TRIANGLE}, r"texture_coordinates must have the shape \(3, 2\)"),
        ({"seq": -1}, "seq is -1"),
        ({"seq": 1.5}, "seq must be an integer"),
        ({"capture_time_us": 2**64}, "capture_time_us is"),
    ],
)
def test_arrays_that_are_no_mesh_are_refused_by_name(
    arguments: dict[str, object], complaint: str
) -> None:
    everything: dict[str, object] = {"vertices": TRIANGLE, "faces": FACE, **arguments}
    with pytest.raises(InvalidMeshError, match=complaint):
        native.encode(**everything)  # type: ignore[arg-type]


def test_a_frame_without_faces_can_be_written() -> None:
    frame = native.decode(native.encode(TRIANGLE, []))
    assert frame.faces.shape == (0, 3)


def test_a_face_that_refers_to_no_vertex_is_not_read() -> None:
    message = bytearray(native.encode(TRIANGLE, FACE))
    message[-4:] = struct.pack("<I", 3)
    with pytest.raises(InvalidMessageError, match="refers to vertex 3"):
        native.decode(message)


def test_a_frame_can_be_numbered_anew() -> None:
    frame = native.encode(TRIANGLE, FACE, capture_time_us=5)
    assert native.restamp(frame, seq=9) == native.encode(TRIANGLE, FACE, seq=9, capture_time_us=5)
    assert native.stamps(native.restamp(frame, capture_time_us=6)) == (None, 6)


def test_a_version_that_is_not_known_is_named() -> None:
    message = bytearray(native.encode(TRIANGLE, FACE))
    message[8] = 2
    with pytest.raises(InvalidMessageError, match="version 2"):
        native.decode(message)
