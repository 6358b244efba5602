"""Publishing by POST, against a server that does what the contract says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from fake_server import http_server, problem
from meshes import FACE, TRIANGLE, ply

from steadymesh import (
    FrameDroppedError,
    ProblemError,
    PublishedFrame,
    Publisher,
    PublisherClosedError,
    PublishTimeoutError,
    ServerUnreachableError,
    native,
)


def accepted(seq: int, **more: Any) -> tuple[int, dict[str, Any]]:
    return 202, {"seq": seq, "queued": 1, **more}


def publish(publisher: Publisher, **options: Any) -> PublishedFrame:
    return publisher.publish(TRIANGLE, FACE, **options)


def test_the_server_counts_the_first_frame_and_the_publisher_goes_on() -> None:
    with (
        http_server(accepted(41), accepted(42), accepted(50)) as fake,
        Publisher(fake.url, "http") as publisher,
    ):
        frames = [publish(publisher), publish(publisher), publish(publisher, seq=50)]
    assert [one.query.get("seq") for one in fake.posted] == [None, "42", "50"]
    assert [frame.seq for frame in frames] == [41, 42, 50]
    first = fake.posted[0]
    assert first.path == "/v1/streams/demo/frames"
    assert first.headers["content-type"] == "application/vnd.steadymesh.frame"
    assert first.body == native.encode(TRIANGLE, FACE)


def test_a_full_queue_is_waited_for() -> None:
    full = 429, problem(429, "queue-full", retry_after_ms=5)
    with (
        http_server(accepted(0), full, full, accepted(1)) as fake,
        Publisher(fake.url, "http") as publisher,
    ):
        publish(publisher)
        assert publish(publisher).state == "accepted"
    assert [one.query.get("seq") for one in fake.posted] == [None, "1", "1", "1"]


def test_a_queue_that_stays_full_is_not_waited_for_longer_than_asked() -> None:
    full = 429, problem(429, "queue-full", retry_after_ms=60_000)
    with http_server(full) as fake, Publisher(fake.url, "http") as publisher:
        with pytest.raises(PublishTimeoutError, match="429"):
            publish(publisher, timeout=0.5)


def test_a_frame_whose_answer_was_lost_is_sent_again_under_its_number() -> None:
    with (
        http_server(accepted(0), None, None, accepted(1, duplicate=True)) as fake,
        Publisher(fake.url, "http") as publisher,
    ):
        publish(publisher)
        assert publish(publisher).state == "duplicate"
    assert [one.query.get("seq") for one in fake.posted] == [None, "1", "1", "1"]


def test_a_frame_without_a_number_is_not_sent_twice() -> None:
    with http_server(None) as fake, Publisher(fake.url, "http") as publisher:
        with pytest.raises(ServerUnreachableError):
            publish(publisher)
    assert len(fake.posted) == 1


@pytest.mark.parametrize(
    "taken", [accepted(1, duplicate=True), (409, problem(409, "seq-goes-back"))]
)
def test_a_number_that_somebody_else_has_taken_is_left_to_the_server(taken: Any) -> None:
    with (
        http_server(accepted(0), taken, accepted(6), accepted(7)) as fake,
        Publisher(fake.url, "http") as publisher,
    ):
        frames = [publish(publisher) for _ in range(3)]
    assert [one.query.get("seq") for one in fake.posted] == [None, "1", None, "7"]
    assert [(frame.seq, frame.state) for frame in frames] == [
        (0, "accepted"),
        (6, "accepted"),
        (7, "accepted"),
    ]


def test_a_bad_frame_is_rejected_alone() -> None:
    bad = 422, problem(422, "unusable-mesh")
    with (
        http_server(bad, accepted(0), bad) as fake,
        Publisher(fake.url, "http") as publisher,
    ):
        rejected = publish(publisher)
        assert publish(publisher).state == "accepted"
        with pytest.raises(ProblemError):
            publish(publisher, wait=True)
    assert rejected.state == "rejected"
    assert rejected.problem is not None
    assert rejected.problem.kind == "unusable-mesh"
    assert publisher.counts == {"rejected": 2, "accepted": 1}


@pytest.mark.parametrize("status", [400, 401, 403, 404, 500])
def test_what_the_next_frame_would_meet_too_is_an_error(status: int) -> None:
    with (
        http_server((status, problem(status, "whatever"))) as fake,
        Publisher(fake.url, "http") as publisher,
        pytest.raises(ProblemError) as refusal,
    ):
        publish(publisher)
    assert refusal.value.status == status


def test_waiting_gives_the_metrics() -> None:
    answer = 200, {"seq": 3, "output": {"faces": 4000, "bytes": 5}, "latency_us": 21}
    with http_server(answer) as fake, Publisher(fake.url, "http") as publisher:
        frame = publish(publisher, wait=True, timeout=4.0)
    assert fake.posted[0].headers["prefer"] == "wait=4"
    assert (frame.state, frame.seq) == ("published", 3)
    assert (frame.metrics().output.faces, frame.metrics().latency_us) == (4000, 21)


def test_a_frame_that_is_lost_after_it_was_accepted_is_not_sent_again() -> None:
    lost = 503, problem(503, "frame-lost", retry_after_ms=1)
    with (
        http_server(lost) as fake,
        Publisher(fake.url, "http") as publisher,
        pytest.raises(FrameDroppedError, match="because"),
    ):
        publish(publisher, wait=True)
    assert len(fake.posted) == 1


def test_token_takeover_and_time_are_sent(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(ply(TRIANGLE, FACE))
    with (
        http_server(accepted(0)) as fake,
        Publisher(fake.url, "http", token="secret", takeover=True) as publisher,
    ):
        publisher.publish_file(tmp_path / "a.ply", capture_time_us=5)
    posted = fake.posted[0]
    assert posted.query == {"capture_time_us": "5", "takeover": "true"}
    assert posted.headers["authorization"] == "Bearer secret"
    assert posted.headers["content-type"] == "model/ply"


def test_an_update_that_fails_does_not_end_the_publisher() -> None:
    def fail(frame: PublishedFrame) -> None:
        raise ZeroDivisionError

    with (
        http_server(accepted(0), accepted(1)) as fake,
        Publisher(fake.url, "http", on_update=fail) as publisher,
    ):
        assert [publish(publisher).seq for _ in range(2)] == [0, 1]


def test_a_closed_publisher_says_so() -> None:
    with http_server() as fake:
        publisher = Publisher(fake.url, "http")
        publisher.close()
        publisher.close()
        with pytest.raises(PublisherClosedError):
            publish(publisher)


def test_a_file_of_another_kind_is_refused_by_name(tmp_path: Path) -> None:
    with http_server() as fake, Publisher(fake.url, "http") as publisher:
        with pytest.raises(ValueError, match=r"frame\.txt is none of \.drc, \.glb, \.gltf, \.obj"):
            publisher.publish_file(tmp_path / "frame.txt")
        (tmp_path / "frame.smf").write_bytes(b"SMF2")
        with pytest.raises(ValueError, match=r"frame\.smf: a native frame starts"):
            publisher.publish_file(tmp_path / "frame.smf")
        with pytest.raises(FileNotFoundError):
            publisher.publish_file(tmp_path / "absent.ply")


def test_an_unknown_transport_is_refused() -> None:
    with pytest.raises(ValueError, match="neither 'ws' nor 'http'"):
        Publisher("http://127.0.0.1:1/demo", "udp")
