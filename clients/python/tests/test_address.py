from __future__ import annotations

import pytest

from steadymesh import InvalidAddressError, ProblemError, streams, subscribe
from steadymesh._address import ServerAddress, StreamAddress


@pytest.mark.parametrize(
    "text",
    [
        "http://127.0.0.1:8080/v1/streams/demo",
        "http://127.0.0.1:8080/v1/streams/demo/",
        "http://127.0.0.1:8080/watch/demo?wireframe=1",
        "http://127.0.0.1:8080/demo",
        "ws://127.0.0.1:8080/demo#top",
    ],
)
def test_every_way_of_writing_a_streams_address_means_the_same(text: str) -> None:
    address = StreamAddress.parse(text)
    assert address == StreamAddress(ServerAddress("http", "127.0.0.1:8080"), "demo")
    assert address.path("frames") == "/v1/streams/demo/frames"
    assert address.websocket("subscribe") == "ws://127.0.0.1:8080/v1/streams/demo/subscribe"


def test_an_address_with_tls_stays_one() -> None:
    address = StreamAddress.parse("https://volumetric.example/watch/demo")
    expected = "wss://volumetric.example/v1/streams/demo/publish?session=s1"
    assert address.websocket("publish", session="s1") == expected


@pytest.mark.parametrize(
    "text",
    [
        "http://127.0.0.1:8080",
        "127.0.0.1:8080/demo",
        "http://h/v1/streams/A",
        "http://h/a/b",
        "ftp://h/demo",
        "http://h:port/demo",
        "http:///demo",
        "demo",
        "",
    ],
)
def test_an_address_without_a_stream_is_refused(text: str) -> None:
    with pytest.raises(InvalidAddressError):
        subscribe(text)


def test_a_password_does_not_belong_into_an_address() -> None:
    with pytest.raises(InvalidAddressError, match="token="):
        streams("http://user:secret@127.0.0.1:8080")


def test_an_answer_that_is_no_problem_document_is_told_all_the_same() -> None:
    error = ProblemError.from_response(502, "3", b"<h1>Bad gateway</h1>")
    assert (error.status, error.kind, error.retry_after) == (502, "", 3.0)
    assert "Bad gateway" in str(error)


def test_the_finer_hint_when_to_try_again_counts() -> None:
    document = b'{"type": "urn:steadymesh:problem:queue-full", "title": "Full", "status": 429,'
    document += b' "detail": "later", "retry_after_ms": 100}'
    error = ProblemError.from_response(429, "1", document)
    assert (error.kind, error.retry_after) == ("queue-full", 0.1)
    assert str(error) == "429 Full: later"
