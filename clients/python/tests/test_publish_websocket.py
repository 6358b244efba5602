"""Publishing by WebSocket, against a server that does what the contract says."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_server import Peer, problem, websocket_server
from meshes import FACE, TRIANGLE, ply

from steadymesh import (
    ConnectionEndedError,
    FrameDroppedError,
    ProblemError,
    PublishedFrame,
    Publisher,
    PublisherClosedError,
    PublishTimeoutError,
    ServerUnreachableError,
    native,
)

PATIENCE = 10.0
"""Seconds that nothing here comes close to."""


def publish(publisher: Publisher, **options: Any) -> PublishedFrame:
    return publisher.publish(TRIANGLE, FACE, **options)


def test_frames_are_counted_on_from_the_streams_newest() -> None:
    seen: list[int | None] = []

    def server(peer: Peer) -> None:
        peer.welcome(latest_seq=41)
        for message in range(3):
            seq, _ = peer.frame()
            seen.append(seq)
            peer.ack(message, "accepted", seq=seq)

    with websocket_server(server) as fake, Publisher(fake.url) as publisher:
        frames = [publish(publisher), publish(publisher, seq=50), publish(publisher)]
        publisher.flush()
    assert seen == [42, 50, 51]
    assert [frame.seq for frame in frames] == seen
    assert publisher.counts == {"accepted": 3}


def test_publishing_waits_for_credit() -> None:
    first_came, grant = threading.Event(), threading.Event()

    def server(peer: Peer) -> None:
        peer.welcome(credit=1)
        peer.ack(0, "accepted", seq=peer.frame()[0])
        first_came.set()
        assert grant.wait(PATIENCE)
        peer.say("credit", credit=2)
        peer.ack(1, "accepted", seq=peer.frame()[0])

    with websocket_server(server) as fake, Publisher(fake.url) as publisher:
        publish(publisher)
        assert first_came.wait(PATIENCE)
        with pytest.raises(PublishTimeoutError, match="no credit"):
            publish(publisher, timeout=0.05)
        grant.set()
        assert publish(publisher).wait(PATIENCE).state == "accepted"


def test_every_end_of_a_frame_is_told() -> None:
    def server(peer: Peer) -> None:
        peer.welcome()
        for _ in range(4):
            peer.frame()
        peer.ack(0, "accepted", seq=0)
        peer.ack(1, "duplicate", seq=1)
        peer.ack(2, "rejected", problem=problem(422, "unusable-mesh"))
        peer.ack(3, "accepted", seq=3)
        peer.ack(0, "published", seq=0)
        peer.ack(3, "dropped", seq=3, reason="overload")
        peer.wait_for_farewell()

    updates: list[tuple[int | None, str]] = []
    with (
        websocket_server(server) as fake,
        Publisher(
            fake.url, on_update=lambda frame: updates.append((frame.seq, frame.state))
        ) as publisher,
    ):
        published, duplicate, rejected, dropped = (publish(publisher) for _ in range(4))
        assert published.wait_published(PATIENCE).state == "published"
        assert duplicate.wait(PATIENCE).state == "duplicate"
        with pytest.raises(ProblemError) as refusal:
            rejected.wait(PATIENCE)
        assert (refusal.value.status, refusal.value.kind) == (422, "unusable-mesh")
        with pytest.raises(FrameDroppedError, match="overload"):
            dropped.wait_published(PATIENCE)
    assert sorted(updates) == [
        (0, "accepted"),
        (0, "published"),
        (1, "duplicate"),
        (2, "rejected"),
        (3, "accepted"),
        (3, "dropped"),
    ]


def test_after_a_break_only_what_has_not_arrived_is_sent_again() -> None:
    again: list[int | None] = []
    sessions: list[str | None] = []

    def breaks(peer: Peer) -> None:
        peer.welcome(session="s7")
        for _ in range(4):
            peer.frame()
        peer.ack(0, "accepted", seq=0)
        peer.break_off()

    def goes_on(peer: Peer) -> None:
        sessions.append(peer.query.get("session"))
        # Frame 1 had come through as well.
        peer.welcome(session="s7", latest_seq=1)
        for message in range(2):
            seq, _ = peer.frame()
            again.append(seq)
            peer.ack(message, "accepted", seq=seq)
            peer.ack(message, "published", seq=seq)
        peer.wait_for_farewell()

    with websocket_server(breaks, goes_on) as fake, Publisher(fake.url) as publisher:
        frames = [publish(publisher) for _ in range(4)]
        publisher.flush()
        assert frames[3].wait_published(PATIENCE).seq == 3
        # What became of the others, only a question by HTTP can tell.
        fake.pages["/v1/streams/demo/frames/0/metrics"] = {"seq": 0, "latency_us": 5}
        fake.pages["/v1/streams/demo"] = {"stream": "demo", "latest_seq": 3, "queued": 0}
        assert frames[0].metrics(PATIENCE).latency_us == 5
        with pytest.raises(FrameDroppedError, match="unknown"):
            frames[1].wait_published(PATIENCE)
    assert sessions == ["s7"]
    assert again == [2, 3]


def test_a_server_that_has_forgotten_the_session_gets_everything_again() -> None:
    again: list[int | None] = []

    def breaks(peer: Peer) -> None:
        peer.welcome(session="before")
        peer.frame()
        peer.frame()
        peer.break_off()

    def fresh(peer: Peer) -> None:
        peer.welcome(session="after", latest_seq=1)
        for message in range(2):
            seq, _ = peer.frame()
            again.append(seq)
            peer.ack(message, "duplicate", seq=seq)

    with websocket_server(breaks, fresh) as fake, Publisher(fake.url) as publisher:
        frames = [publish(publisher) for _ in range(2)]
        publisher.flush()
    assert again == [0, 1]
    assert [frame.state for frame in frames] == ["duplicate", "duplicate"]


def test_frames_refused_for_the_moment_are_sent_again_in_order() -> None:
    came: list[int | None] = []

    def server(peer: Peer) -> None:
        peer.welcome()
        for _ in range(3):
            came.append(peer.frame()[0])
        for message in range(3):
            stopping = problem(503, "stopping", retry_after_ms=30)
            peer.ack(message, "rejected", problem=stopping)
        for message in range(3, 6):
            seq, _ = peer.frame()
            came.append(seq)
            peer.ack(message, "accepted", seq=seq)

    with websocket_server(server) as fake, Publisher(fake.url) as publisher:
        frames = [publish(publisher) for _ in range(3)]
        publisher.flush()
    assert came == [0, 1, 2, 0, 1, 2]
    assert {frame.state for frame in frames} == {"accepted"}


def test_a_message_over_the_limit_is_given_up_and_the_others_are_not() -> None:
    again: list[int | None] = []

    def strict(peer: Peer) -> None:
        peer.welcome(session="s")
        peer.frame()
        peer.frame()
        peer.connection.close(1009)

    def goes_on(peer: Peer) -> None:
        peer.welcome(session="s")
        seq, _ = peer.frame()
        again.append(seq)
        peer.ack(0, "accepted", seq=seq)

    with websocket_server(strict, goes_on) as fake, Publisher(fake.url) as publisher:
        small = publish(publisher)
        large = publisher.publish([[0, 0, 0]] * 1000, FACE)
        assert small.wait(PATIENCE).state == "accepted"
        with pytest.raises(ProblemError, match="over the server's limit") as refusal:
            large.wait(PATIENCE)
    assert refusal.value.status == 413
    assert again == [0]


@pytest.mark.parametrize(
    ("code", "meaning"), [(1000, "deleted"), (4409, "taken over"), (4401, "token")]
)
def test_an_end_for_good_reaches_the_publisher(code: int, meaning: str) -> None:
    def server(peer: Peer) -> None:
        peer.welcome()
        peer.frame()
        peer.connection.close(code, "go away")

    with websocket_server(server) as fake:
        publisher = Publisher(fake.url)
        frame = publish(publisher)
        with pytest.raises(ConnectionEndedError, match=meaning) as end:
            frame.wait(PATIENCE)
        assert (end.value.code, end.value.reason) == (code, "go away")
        with pytest.raises(ConnectionEndedError):
            publish(publisher)
        with pytest.raises(ConnectionEndedError):
            publisher.close()


def test_a_token_that_has_expired_is_replaced_by_a_fresh_one() -> None:
    tokens = iter(["old", "new"])
    sent: list[str] = []

    def expires(peer: Peer) -> None:
        sent.append(peer.headers["Authorization"])
        peer.welcome()
        peer.frame()
        peer.connection.close(4401)

    def accepts(peer: Peer) -> None:
        sent.append(peer.headers["Authorization"])
        peer.welcome()
        peer.accept_all()

    with (
        websocket_server(expires, accepts) as fake,
        Publisher(fake.url, token=lambda: next(tokens)) as publisher,
    ):
        publish(publisher).wait(PATIENCE)
    assert sent == ["Bearer old", "Bearer new"]


def test_another_publisher_is_a_problem_unless_it_is_taken_over() -> None:
    takeovers: list[str | None] = []

    def server(peer: Peer) -> None:
        takeovers.append(peer.query.get("takeover"))
        peer.welcome()
        peer.accept_all()

    with websocket_server(server) as fake:
        fake.refusals.append((409, problem(409, "other-publisher")))
        with pytest.raises(ProblemError) as refusal:
            Publisher(fake.url)
        assert (refusal.value.status, refusal.value.kind) == (409, "other-publisher")
        Publisher(fake.url, takeover=True).close()
    assert takeovers == ["true"]


def test_a_server_that_is_busy_is_asked_again_after_a_break() -> None:
    came = threading.Event()

    def breaks(peer: Peer) -> None:
        peer.welcome()
        peer.frame()
        fake.refusals.append((503, problem(503, "stopping", retry_after_ms=10)))
        peer.break_off()

    def accepts(peer: Peer) -> None:
        came.set()
        peer.welcome()
        peer.accept_all()

    with websocket_server(breaks, accepts) as fake, Publisher(fake.url) as publisher:
        publish(publisher).wait(PATIENCE)
    assert came.is_set()
    assert fake.refusals == []


def test_files_are_sent_as_they_are_and_announced(tmp_path: Path) -> None:
    came: list[tuple[int | None, bytes]] = []

    def server(peer: Peer) -> None:
        peer.welcome()
        for message in range(3):
            came.append(peer.frame())
            peer.ack(message, "accepted", seq=came[-1][0])

    text = ply(TRIANGLE, FACE)
    (tmp_path / "a.ply").write_bytes(text)
    (tmp_path / "b.SMF").write_bytes(native.encode(TRIANGLE, FACE, seq=7))
    with websocket_server(server) as fake, Publisher(fake.url) as publisher:
        publisher.publish_file(tmp_path / "a.ply", capture_time_us=5)
        publisher.publish_file(tmp_path / "b.SMF")
        publisher.publish_file(str(tmp_path / "b.SMF"), seq=9, capture_time_us=6)
        publisher.flush()
    assert came == [
        (0, text),
        (7, native.encode(TRIANGLE, FACE, seq=7)),
        (9, native.encode(TRIANGLE, FACE, seq=9, capture_time_us=6)),
    ]


def test_the_end_of_the_block_waits_for_the_last_acknowledgement_and_says_goodbye() -> None:
    farewells: list[int] = []

    def server(peer: Peer) -> None:
        peer.welcome()
        peer.frame()
        # While this one is not acknowledged, the publisher does not leave.
        with pytest.raises(TimeoutError):
            peer.connection.recv(timeout=0.1)
        peer.ack(0, "accepted", seq=0)
        farewells.append(peer.wait_for_farewell())

    with websocket_server(server) as fake:
        with Publisher(fake.url) as publisher:
            frame = publish(publisher)
        assert frame.state == "accepted"
        with pytest.raises(PublisherClosedError):
            publish(publisher)
    assert farewells == [1000]


def test_an_error_in_the_block_is_not_held_up_by_frames_on_their_way() -> None:
    def server(peer: Peer) -> None:
        peer.welcome()
        peer.wait_for_farewell()

    with websocket_server(server) as fake:
        with pytest.raises(ZeroDivisionError), Publisher(fake.url) as publisher:
            frame = publish(publisher)
            raise ZeroDivisionError
        with pytest.raises(PublisherClosedError):
            frame.wait(PATIENCE)


def test_a_server_that_stops_reading_is_given_up_in_time() -> None:
    release = threading.Event()

    def stuck(peer: Peer) -> None:
        peer.welcome()
        # Until then nobody reads, and what the operating system holds is soon full.
        assert release.wait(PATIENCE)

    def works(peer: Peer) -> None:
        peer.welcome()
        peer.accept_all()

    with websocket_server(stuck, works) as fake, Publisher(fake.url) as publisher:
        large = np.zeros((1_000_000, 3), dtype=np.float32)
        with pytest.raises(PublishTimeoutError, match="does not read"):
            for _ in range(64):
                publisher.publish(large, FACE, timeout=0.5)
        release.set()
        publisher.flush()


def test_an_address_where_nobody_listens_is_an_error_at_once() -> None:
    with websocket_server(Peer.accept_all) as fake:
        gone = fake.url
    with pytest.raises(ServerUnreachableError):
        Publisher(gone)
