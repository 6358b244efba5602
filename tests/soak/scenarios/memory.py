"""Frames at 30 a second with one player, for --minutes (20 if it is not given): resident memory at
the end is within 5 % of what it was after the second minute, and no frame is lost."""

import time

from support import Player, Rig, check, rig_frames

FPS = 30
SETTINGS = {
    "streams.defaults.tracking": "off",
    "streams.defaults.metrics": "sampled",
    "streams.defaults.target_faces": 1000,
}


def run(workshop):
    minutes = workshop.minutes or 20.0
    server = workshop.server(settings=SETTINGS)
    rig = Rig(server, rig_frames(count=60, rings=50, segments=50), fps=FPS)
    time.sleep(0.5)
    player = Player(server)
    settled, end = min(120.0, 60 * minutes / 2), 60 * minutes
    begun = time.monotonic()
    memory = []
    while time.monotonic() - begun < end:
        time.sleep(5)
        elapsed = time.monotonic() - begun
        memory.append((elapsed, server.resident_mib()))
        check(player.is_there, f"the player is there ({player.code}, {player.error})")
        if len(memory) % 12 == 0:
            print(f"  {elapsed / 60:.0f} min: {memory[-1][1]:.1f} MiB", flush=True)
    rig.stop()
    # The median of a quarter of a minute, so that one allocation more or less does not count.
    at_first = middle(mib for moment, mib in memory if settled <= moment < settled + 20)
    at_last = middle(mib for _, mib in memory[-3:])
    growth = 100 * (at_last / at_first - 1)
    fps = len(player.seqs) / (player.arrivals[-1] - player.arrivals[0])
    check(growth <= 5, f"{at_first:.1f} MiB have become {at_last:.1f} ({growth:+.1f} %)")
    check(player.lost == 0, f"{player.lost} frames were lost")
    return {
        f"after {settled / 60:.0f} min": f"{at_first:.1f} MiB",
        f"after {minutes:.0f} min": f"{at_last:.1f} MiB ({growth:+.1f} %)",
        "frames": len(player.seqs),
        "fps": f"{fps:.1f}",
        "lost": player.lost,
        "p99": f"{1000 * player.p99():.0f} ms",
    }


def middle(values):
    ordered = sorted(values)
    check(ordered, "there are measurements")
    return ordered[len(ordered) // 2]
