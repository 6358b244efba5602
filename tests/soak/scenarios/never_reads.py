"""200 clients ask for a large frame and never read their answer, 100 do nothing at all, and one
publisher says nothing after its welcome: all are closed in time, their memory comes back when
the stream ends, and a healthy rig and player lose nothing."""

import time

from support import Player, Rig, Slow, check, ply, request, rig_frames, wait_until
from support.clients import CLOSE, WebSocket, close_code

COUNT = 200
SEND, HEAD, SILENCE = 3, 5, 50
SETTINGS = {
    "limits.send_timeout_secs": SEND,
    "limits.header_timeout_secs": HEAD,
    "streams.defaults.tracking": "off",
    "streams.defaults.metrics": "sampled",
    "streams.defaults.target_faces": 400,
}
GET = b"GET /v1/streams/large/frames/latest.ply HTTP/1.1\r\nHost: localhost\r\n\r\n"


def run(workshop):
    server = workshop.server(settings=SETTINGS)
    large = server.url("/v1/streams/large")
    config = b'{"target_faces": 400000, "metrics": "off"}'
    check(request(large, "PUT", config)[0] == 201, "the large stream is made")
    body = ply(rings=300, segments=300)
    answer = request(large + "/frames", "POST", body, {"Prefer": "wait"}, seconds=60)
    check(answer[0] == 200, f"the large frame is out: {answer}")
    rig = Rig(server, rig_frames(), fps=20)
    wait_until(lambda: rig.count("published"), 10, "a frame is out")
    player = Player(server)
    silent = WebSocket(server, "/v1/streams/silent/publish")
    silent_since = time.monotonic()
    open_before = server.metric("steadymesh_connections")
    memory_before = server.resident_mib()
    deaf = Slow(server, COUNT, GET, reads=False)
    idle = Slow(server, COUNT // 2, b"")
    wait_until(
        lambda: server.metric("steadymesh_connections") >= open_before + COUNT, 10, "all are open"
    )
    begun, peak = time.monotonic(), 0.0
    while server.metric("steadymesh_connections") > open_before:
        peak = max(peak, server.resident_mib())
        check(time.monotonic() - begun < 60, "the connections are kept")
        time.sleep(0.2)
    closed = time.monotonic() - begun
    deaf.read_all()
    deaf.wait(20)
    first, last = idle.wait(HEAD + 5)
    check(HEAD - 1 < first and last < HEAD + 4, f"idle ones: {first:.1f} to {last:.1f} s")
    cut = sum(len(answer) < 1_000_000 for answer in deaf.answers.values())
    check(cut == COUNT, f"{cut} answers were cut short")
    code = None
    while code is None:
        opcode, payload = silent.message(answers_pings=False)
        code = close_code(payload) if opcode == CLOSE else None
    silence = time.monotonic() - silent_since
    check(code == 4408, f"the silent publisher was closed with {code}")
    check(SILENCE - 2 < silence < SILENCE + 10, f"after {silence:.1f} s")
    rig.stop()
    check(player.is_there and player.lost == 0, f"{player.lost} frames were lost")
    kept = server.resident_mib()
    check(request(large, "DELETE")[0] == 204, "the large stream is deleted")
    wait_until(
        lambda: server.resident_mib() < memory_before + 50, 10, f"{kept:.0f} MiB are given back"
    )
    return {
        "closed within": f"{closed:.1f} s",
        "of them cut short": cut,
        "idle closed after": f"{first:.1f} to {last:.1f} s",
        "silent publisher": f"{code} after {silence:.0f} s",
        "resident": f"{memory_before:.0f} MiB before, {peak:.0f} at most, "
        f"{kept:.0f} after, {server.resident_mib():.0f} without the stream",
        "frames": len(player.seqs),
        "p99": f"{1000 * player.p99():.0f} ms",
    }
