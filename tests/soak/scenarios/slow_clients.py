"""200 clients that send their request's head byte by byte and 200 that do so with its body, at
once: all are closed in time, those with half a body are told 408, and a healthy rig and player
lose nothing."""

from support import Player, Rig, Slow, check, rig_frames, wait_until

COUNT = 200
HEAD, BODY = 3, 4
SETTINGS = {
    "limits.header_timeout_secs": HEAD,
    "limits.body_timeout_secs": BODY,
    "streams.defaults.tracking": "off",
    "streams.defaults.metrics": "sampled",
    "streams.defaults.target_faces": 400,
}
POST = b"POST /v1/streams/other/frames HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999\r\n\r\n"


def run(workshop):
    server = workshop.server(settings=SETTINGS)
    rig = Rig(server, rig_frames(), fps=20)
    wait_until(lambda: rig.count("published"), 10, "a frame is out")
    player = Player(server)
    before = server.metric("steadymesh_connections")
    heads = Slow(server, COUNT, b"GET / HTTP/1.1\r\nHost: localh", b"o")
    bodies = Slow(server, COUNT, POST, b"x")
    first, last = heads.wait(HEAD + 5)
    check(HEAD - 1 < first and last < HEAD + 4, f"heads: {first:.1f} to {last:.1f} s")
    # A body that is refused is read on for a moment, so that the client sees why.
    body_first, body_last = bodies.wait(BODY + 10)
    check(BODY - 1 < body_first and body_last < BODY + 9, f"{body_first:.1f} to {body_last:.1f} s")
    told = sum(b"HTTP/1.1 408" in answer for answer in bodies.answers.values())
    check(told > 0.9 * COUNT, f"{told} of {COUNT} were told 408")
    wait_until(
        lambda: server.metric("steadymesh_connections") <= before, 10, "all places are given back"
    )
    rig.stop()
    check(player.is_there and player.lost == 0, f"{player.lost} frames were lost")
    check(player.p99() < 0.5, f"p99 is {player.p99():.3f} s")
    return {
        "heads closed after": f"{first:.1f} to {last:.1f} s",
        "bodies": f"{body_first:.1f} to {body_last:.1f} s",
        "frames": len(player.seqs),
        "lost": player.lost,
        "p99": f"{1000 * player.p99():.0f} ms",
    }
