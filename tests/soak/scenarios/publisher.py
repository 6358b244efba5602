"""A publisher is killed in the middle of a frame. Back within linger_secs with its session it goes
on, and players see a gap only, while others are refused; after linger_secs anybody may have the
place, and players are still there."""

import time

from support import Player, Rig, check, rig_frames, wait_until
from support.clients import Refused

LINGER = 4
SETTINGS = {
    "streams.linger_secs": LINGER,
    "streams.defaults.tracking": "off",
    "streams.defaults.metrics": "sampled",
    "streams.defaults.target_faces": 400,
}


def run(workshop):
    server = workshop.server(settings=SETTINGS)
    frames = rig_frames()
    session = die(workshop, server, "/v1/streams/demo/publish")
    player = Player(server)
    wait_until(lambda: player.seqs, 5, "the player has the newest frame")
    refused = False
    try:
        Rig(server, frames)
    except Refused as answer:
        refused = answer.status == 409
    check(refused, "another publisher is refused with 409 while the first one may come back")
    back = time.monotonic()
    rig = Rig(server, frames, query=f"?session={session}")
    wait_until(lambda: rig.count("published") >= 20, 20, "the rig goes on")
    rig.stop()
    gap = player.gap(back)
    check_player(player)

    die(workshop, server, "/v1/streams/demo/publish")
    time.sleep(LINGER + 1)
    before = len(player.seqs)
    rig = Rig(server, frames)
    wait_until(lambda: len(player.seqs) >= before + 20, 20, "the stream goes on")
    rig.stop()
    check_player(player)
    return {"frames": len(player.seqs), "lost": player.lost, "gap": f"{gap:.1f} s"}


def die(workshop, server, path):
    """Publishes ten frames and half of one more; gives the session."""
    child, session = workshop.half("publish", server, path)
    child.kill()
    child.wait()
    return session


def check_player(player):
    check(player.is_there, f"the player is still there ({player.code}, {player.error})")
    check(player.lost == 0, f"{player.lost} frames were lost")
    others = [control for control in player.controls if control["type"] != "hello"]
    check(not others, f"the player was told {others}")
