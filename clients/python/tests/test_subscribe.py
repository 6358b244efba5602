"""Subscribing, against a server that does what the contract says."""

from __future__ import annotations

import builtins
import threading
from typing import Any

import pytest
from fake_server import Peer, problem, websocket_server
from meshes import delivered

from steadymesh import (
    ConnectionEndedError,
    Ended,
    Frame,
    Hello,
    InvalidMessageError,
    MissingDracoError,
    ProblemError,
    ServerUnreachableError,
    Skipped,
    subscribe,
)

PATIENCE = 10.0


def hello(peer: Peer) -> None:
    peer.say("hello", protocol="steadymesh.v1", stream="demo", latest_seq=None, config={"a": 1})


def send(peer: Peer, *numbers: int) -> None:
    for seq in numbers:
        peer.connection.send(delivered(seq))


def end(peer: Peer, reason: str) -> None:
    peer.say("end", reason=reason)
    peer.connection.close(1001 if reason == "shutdown" else 1000)


def test_frames_come_until_the_stream_is_deleted() -> None:
    def server(peer: Peer) -> None:
        assert peer.headers["Authorization"] == "Bearer secret"
        assert peer.connection.subprotocol == "steadymesh.v1"
        hello(peer)
        send(peer, 0, 1)
        end(peer, "deleted")

    with websocket_server(server) as fake, subscribe(fake.url, token="secret") as frames:
        assert [frame.seq for frame in frames] == [0, 1]
        assert frames.end_reason == "deleted"
        assert list(frames) == []


def test_what_happens_between_frames_is_told_and_what_is_unknown_is_not() -> None:
    def server(peer: Peer) -> None:
        hello(peer)
        peer.say("a-message-of-a-later-version", field=1)
        send(peer, 3)
        peer.say("skipped", missed=4)
        send(peer, 8)
        end(peer, "deleted")

    with websocket_server(server) as fake, subscribe(fake.url) as frames:
        events = list(frames.events())
        assert frames.missed == 4
    told = [event.seq if isinstance(event, Frame) else event for event in events]
    assert told == [Hello("demo", None, {"a": 1}), 3, Skipped(4), 8, Ended("deleted")]


@pytest.mark.parametrize("how", ["shutdown", "idle", "break"])
def test_it_comes_back_and_does_not_give_a_frame_twice(how: str) -> None:
    def ends(peer: Peer) -> None:
        hello(peer)
        send(peer, 0, 1)
        # Not while the stream is absent, either.
        fake.refusals.append((404, problem(404, "no-stream")))
        if how == "break":
            peer.break_off()
        else:
            end(peer, how)

    def goes_on(peer: Peer) -> None:
        hello(peer)
        send(peer, 1, 2)
        end(peer, "deleted")

    with websocket_server(ends, goes_on) as fake, subscribe(fake.url) as frames:
        assert [frame.seq for frame in frames] == [0, 1, 2]
        assert fake.refusals == []


def test_a_new_stream_of_the_same_name_may_count_from_zero() -> None:
    def ends(peer: Peer) -> None:
        hello(peer)
        send(peer, 7)
        end(peer, "shutdown")

    def anew(peer: Peer) -> None:
        hello(peer)
        send(peer, 0)
        end(peer, "deleted")

    with websocket_server(ends, anew) as fake:
        assert [frame.seq for frame in subscribe(fake.url)] == [7, 0]


def test_it_takes_leave_after_as_many_frames_as_asked_for() -> None:
    farewells = []

    def server(peer: Peer) -> None:
        hello(peer)
        send(peer, *range(5))
        farewells.append(peer.wait_for_farewell())

    with websocket_server(server) as fake, subscribe(fake.url, max_frames=2) as frames:
        assert [frame.seq for frame in frames] == [0, 1]
    assert farewells == [1000]


def test_another_thread_may_close_it() -> None:
    def server(peer: Peer) -> None:
        hello(peer)
        send(peer, 0)
        peer.wait_for_farewell()

    with websocket_server(server) as fake:
        frames = subscribe(fake.url)
        assert next(frames).seq == 0
        closing = threading.Timer(0.05, frames.close)
        closing.start()
        assert list(frames) == []
        closing.join()


def test_a_frame_that_does_not_come_is_not_waited_for_longer_than_asked() -> None:
    def server(peer: Peer) -> None:
        hello(peer)
        peer.wait_for_farewell()

    with websocket_server(server) as fake, subscribe(fake.url, timeout=0.05) as frames:
        with pytest.raises(TimeoutError, match=r"0\.05 seconds"):
            next(frames)


def test_a_stream_that_is_not_there_is_a_problem_or_waited_for() -> None:
    def server(peer: Peer) -> None:
        hello(peer)
        send(peer, 0)
        end(peer, "deleted")

    absent = 404, problem(404, "no-stream")
    with websocket_server(server) as fake:
        fake.refusals.append(absent)
        with pytest.raises(ProblemError) as refusal:
            subscribe(fake.url)
        assert (refusal.value.status, refusal.value.kind) == (404, "no-stream")
        fake.refusals.append(absent)
        assert [frame.seq for frame in subscribe(fake.url, wait_for_stream=True)] == [0]


def test_a_server_that_is_not_there_is_an_error_or_waited_for() -> None:
    with websocket_server(Peer.accept_all) as fake:
        gone = fake.url
    with pytest.raises(ServerUnreachableError):
        subscribe(gone)
    with pytest.raises(TimeoutError):
        next(subscribe(gone, wait_for_stream=True, timeout=0.3))


@pytest.mark.parametrize(
    ("options", "code"), [({"reconnect": False}, 1011), ({"token": "expired"}, 4401)]
)
def test_an_end_that_it_may_or_can_not_come_back_from_is_an_error(
    options: dict[str, Any], code: int
) -> None:
    def server(peer: Peer) -> None:
        hello(peer)
        peer.connection.close(code)

    with websocket_server(server) as fake, subscribe(fake.url, **options) as frames:
        with pytest.raises(ConnectionEndedError) as ended:
            next(frames)
        assert ended.value.code == code


def test_without_reconnecting_every_end_is_the_last() -> None:
    def server(peer: Peer) -> None:
        hello(peer)
        end(peer, "shutdown")

    with websocket_server(server) as fake, subscribe(fake.url, reconnect=False) as frames:
        assert list(frames) == []
        assert frames.end_reason == "shutdown"


def test_a_message_that_is_no_frame_is_an_error() -> None:
    def server(peer: Peer) -> None:
        hello(peer)
        peer.connection.send(b"SMDF and nonsense")

    with websocket_server(server) as fake, subscribe(fake.url) as frames:
        with pytest.raises(InvalidMessageError):
            next(frames)


def test_bytes_that_are_no_draco_are_not_decoded() -> None:
    pytest.importorskip("DracoPy")
    with pytest.raises(InvalidMessageError, match="not a Draco mesh"):
        Frame.from_message(delivered(0, b"DRACO and nonsense")).mesh()


def test_without_the_extra_a_mesh_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.__import__

    def without(name: str, *arguments: Any) -> Any:
        if name == "DracoPy":
            raise ImportError(name)
        return original(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", without)
    frame = Frame.from_message(delivered(0))
    assert frame.drc == b"DRACO"
    with pytest.raises(MissingDracoError, match=r"pip install 'steadymesh\[draco\]'"):
        frame.mesh()
