"""Players are killed in the middle of a frame: the server's gauges return to what they were, and
a healthy player loses nothing."""

from support import Player, Rig, check, rig_frames, wait_until

COUNT = 20
PLAYERS = "steadymesh_subscriber_connections"
SETTINGS = {
    "streams.defaults.tracking": "off",
    "streams.defaults.metrics": "sampled",
    "streams.defaults.target_faces": 100000,
}


def run(workshop):
    server = workshop.server(settings=SETTINGS)
    rig = Rig(server, rig_frames(rings=60, segments=60), fps=5)
    wait_until(lambda: rig.count("published"), 10, "a frame is out")
    healthy = Player(server)
    wait_until(lambda: server.metric(PLAYERS) == 1, 5, "the healthy player is counted")
    before = server.metric("steadymesh_connections")
    path = "/v1/streams/demo/subscribe"
    children = [workshop.half("subscribe", server, path)[0] for _ in range(COUNT)]
    wait_until(lambda: server.metric(PLAYERS) == 1 + COUNT, 5, "all players are counted")
    for child in children:
        child.kill()
        child.wait()
    seconds = wait_until(
        lambda: server.metric(PLAYERS) == 1
        and server.metric("steadymesh_connections") <= before,
        10,
        f"{COUNT} killed players are no longer counted",
    )
    seen = len(healthy.seqs)
    wait_until(lambda: len(healthy.seqs) >= seen + 10, 20, "the stream goes on")
    rig.stop()
    check(healthy.is_there and healthy.lost == 0, f"{healthy.lost} frames were lost")
    return {"killed": COUNT, "forgotten after": f"{seconds:.1f} s", "lost": healthy.lost}
