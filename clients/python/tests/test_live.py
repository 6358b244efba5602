"""Against a real server."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from meshes import FACE, TRIANGLE, ply, sphere

import steadymesh
from steadymesh import Ended, Frame, ProblemError, Publisher

PATIENCE = 60.0
"""Seconds; a debug build on a busy machine takes its time."""

_names = (f"python-{number}" for number in itertools.count())


@pytest.fixture
def url(server: str) -> Iterator[str]:
    """A stream of our own, small and fast, that is deleted afterwards."""
    url = f"{server}/v1/streams/{next(_names)}"
    steadymesh.configure(url, target_faces=300, position_bits=14)
    yield url
    # A test may have done so itself.
    with suppress(ProblemError):
        steadymesh.delete(url)


@pytest.fixture
def websocket_url(url: str) -> str:
    """The same, of a server that can be published to by WebSocket."""
    try:
        Publisher(url).close()
    except ProblemError as problem:
        if problem.kind == "not-found":
            pytest.skip("this server has no route for publishing by WebSocket")
        raise
    return url


@pytest.fixture(params=["http", "ws"])
def transport(request: pytest.FixtureRequest) -> str:
    """Every way of publishing that the server has."""
    if request.param == "ws":
        request.getfixturevalue("websocket_url")
    return str(request.param)


def test_a_published_frame_comes_back_simplified_and_in_place(url: str, transport: str) -> None:
    pytest.importorskip("DracoPy")
    vertices, faces = sphere(radius=2.0)
    with Publisher(url, transport, timeout=PATIENCE) as publisher:
        published = publisher.publish(
            vertices, faces, capture_time_us=1_700_000_000_000_000, wait=True
        )
    metrics = published.metrics()
    assert (published.state, metrics.seq, metrics.tracking) == ("published", 0, "off")
    assert metrics.capture_time_us == 1_700_000_000_000_000
    assert metrics.input.faces == len(faces)
    assert metrics.surface_distance is not None
    assert metrics.surface_distance.previous is None

    with steadymesh.subscribe(url, max_frames=1, timeout=PATIENCE) as frames:
        (frame,) = frames
    assert frame.metrics == metrics
    mesh = frame.mesh()
    assert [array.dtype.name for array in mesh] == ["float32", "uint32"]
    assert mesh.faces.shape == (300, 3)
    assert len(mesh.vertices) == metrics.output.vertices
    # The sphere's sagitta at this number of faces is far below this, its radius is 2.
    distances = np.linalg.norm(mesh.vertices, axis=1)
    assert np.abs(distances - 2.0).max() < 0.1


def test_a_sequence_is_received_in_order_with_its_distances(url: str, transport: str) -> None:
    received: list[Frame] = []

    def receive() -> None:
        with steadymesh.subscribe(url, max_frames=4, timeout=PATIENCE) as frames:
            connected.set()
            received.extend(frames)

    connected = threading.Event()
    player = threading.Thread(target=receive)
    player.start()
    assert connected.wait(PATIENCE)
    vertices, faces = sphere()
    with Publisher(url, transport, timeout=PATIENCE) as publisher:
        sent = [publisher.publish(vertices * (1 + 0.01 * step), faces) for step in range(4)]
        assert [frame.wait_published(PATIENCE).seq for frame in sent] == [0, 1, 2, 3]
    player.join(PATIENCE)
    assert [frame.seq for frame in received] == [0, 1, 2, 3]
    for frame in received[1:]:
        distance = frame.metrics.surface_distance
        assert frame.metrics.reference_seq == frame.seq - 1
        assert distance is not None
        assert distance.previous is not None
        assert 0 <= distance.previous.mean < 0.1 * frame.metrics.bbox_diagonal
    assert [one.seq for one in steadymesh.metrics(url, last=2)] == [2, 3]


def test_files_of_every_kind_are_taken(url: str, transport: str, tmp_path: Path) -> None:
    vertices, faces = sphere(rings=10)
    (tmp_path / "0.ply").write_bytes(ply(vertices, faces))
    (tmp_path / "1.smf").write_bytes(steadymesh.native.encode(vertices, faces))
    rows = [f"v {x} {y} {z}" for x, y, z in vertices.tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    (tmp_path / "2.obj").write_text("\n".join(rows))
    with Publisher(url, transport, timeout=PATIENCE) as publisher:
        for path in sorted(tmp_path.iterdir()):
            frame = publisher.publish_file(path, wait=True)
            assert frame.metrics().input.faces == len(faces), path
        # What comes out can go in.
        for kind in ("drc", "glb", "ply"):
            path = tmp_path / f"latest.{kind}"
            path.write_bytes(steadymesh.latest(url, kind))
            assert publisher.publish_file(path, wait=True).state == "published", path


def test_a_frame_that_is_no_mesh_is_rejected_and_the_next_one_is_not(
    url: str, transport: str
) -> None:
    with Publisher(url, transport, timeout=PATIENCE) as publisher:
        flat = publisher.publish(np.zeros((3, 3)), FACE)
        good = publisher.publish(*sphere(rings=6))
        with pytest.raises(ProblemError) as refusal:
            flat.wait(PATIENCE)
        assert good.wait(PATIENCE).state == "accepted" or good.state == "published"
    assert (refusal.value.status, refusal.value.kind) == (422, "unusable-mesh")


def test_a_number_sent_twice_does_nothing_the_second_time(url: str, transport: str) -> None:
    vertices, faces = sphere(rings=6)
    with Publisher(url, transport, timeout=PATIENCE) as publisher:
        publisher.publish(vertices, faces, seq=5, wait=True)
        again = publisher.publish(vertices, faces, seq=5).wait(PATIENCE)
        back = publisher.publish(vertices, faces, seq=4)
        with pytest.raises(ProblemError) as refusal:
            back.wait(PATIENCE)
    assert again.state == "duplicate"
    assert refusal.value.kind == "seq-goes-back"
    assert steadymesh.stream(url).counters["received"] == 1


def test_deleting_a_stream_ends_its_subscriptions(url: str) -> None:
    with Publisher(url, "http", timeout=PATIENCE) as publisher:
        publisher.publish(*sphere(rings=6), wait=True)
    with steadymesh.subscribe(url, timeout=PATIENCE) as frames:
        assert next(frames).seq == 0
        steadymesh.delete(url)
        assert list(frames.events()) == [Ended("deleted")]


def test_a_second_publisher_has_to_take_over(websocket_url: str) -> None:
    url = websocket_url
    mesh = sphere(rings=6)
    with Publisher(url, timeout=PATIENCE) as first:
        first.publish(*mesh, wait=True)
        with pytest.raises(ProblemError) as refusal:
            Publisher(url)
        assert refusal.value.status == 409
        with Publisher(url, "http") as poster, pytest.raises(ProblemError) as refusal:
            poster.publish(*mesh)
        assert refusal.value.status == 409
        with Publisher(url, takeover=True, timeout=PATIENCE) as second:
            assert second.publish(*mesh, wait=True).seq == 1


def test_a_publisher_whose_connection_breaks_goes_on_without_a_gap(websocket_url: str) -> None:
    url = websocket_url
    mesh = sphere(rings=6)
    with Publisher(url, timeout=PATIENCE) as publisher:
        frames = []
        for number in range(6):
            frames.append(publisher.publish(*mesh))
            if number in (1, 3):
                # Whatever is on its way now, nobody knows whether it arrives.
                link = publisher._transport._link  # type: ignore[union-attr]
                if link is not None:
                    link.websocket.abort()
        assert [frame.wait_published(PATIENCE).seq for frame in frames] == list(range(6))
    assert steadymesh.stream(url).counters["published"] == 6


def test_streams_are_configured_and_listed(server: str, url: str) -> None:
    info = steadymesh.configure(
        url,
        target_ratio=0.5,
        tracking="off",
        tracking_strength=0.25,
        attribute_weight=0.01,
        position_bits=10,
        draco_speed=0,
        metrics="off",
        overload="live",
    )
    assert info.config == {
        "target_ratio": 0.5,
        "tracking": "off",
        "tracking_strength": 0.25,
        "attribute_weight": 0.01,
        "draco": {
            "position_bits": 10,
            "speed": 0,
            "texture_coordinate_bits": 12,
            "normal_bits": 8,
        },
        "texture": {"format": "original", "quality": 85},
        "metrics": "off",
        "overload": "live",
        "record": "off",
    }
    assert info == steadymesh.stream(url)
    assert info.name in [one.name for one in steadymesh.streams(server)]
    with Publisher(url, "http", timeout=PATIENCE) as publisher:
        metrics = publisher.publish(*sphere(rings=6), wait=True).metrics()
    assert metrics.surface_distance is None
    assert len(steadymesh.frame(url, 0)) == metrics.output.bytes


def test_a_field_that_the_server_does_not_know_is_named(url: str) -> None:
    with pytest.raises(ProblemError, match="traking") as refusal:
        steadymesh.configure(url, extra={"traking": "off"})
    assert refusal.value.status == 400


def test_what_is_not_there_is_a_problem(server: str) -> None:
    absent = f"{server}/absent"
    for ask in (
        steadymesh.stream,
        steadymesh.latest,
        steadymesh.metrics,
        steadymesh.delete,
        steadymesh.subscribe,
    ):
        with pytest.raises(ProblemError) as refusal:
            ask(absent)
        assert (refusal.value.status, refusal.value.kind) == (404, "no-stream")


def test_a_stream_begins_with_its_first_frame(server: str) -> None:
    url = f"{server}/watch/{next(_names)}"
    with Publisher(url, "http", timeout=PATIENCE) as publisher:
        # A triangle is as simple as it gets.
        frame = publisher.publish(TRIANGLE, FACE)
    if frame.state != "rejected":
        frame.wait_published(PATIENCE)
    assert steadymesh.stream(url).counters
    steadymesh.delete(url)
