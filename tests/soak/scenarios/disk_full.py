"""The disk is full. A server whose log cannot be written goes on serving; commands that write
files end with exit code 1 and an error that names the file, and leave none that is cut short."""

import os
import subprocess

from support import Player, Rig, check, ply, rig_frames, wait_until

FULL = "/dev/full"
SETTINGS = {
    "log.level": "debug",
    "streams.defaults.tracking": "off",
    "streams.defaults.metrics": "sampled",
    "streams.defaults.target_faces": 4000,
}


def run(workshop):
    server = workshop.server(settings=SETTINGS, stderr=FULL)
    rig = Rig(server, rig_frames(rings=40, segments=60))
    wait_until(lambda: rig.count("published"), 10, "a frame is out")
    player = Player(server)
    wait_until(lambda: len(player.seqs) >= 10, 20, "frames flow although nothing can be logged")

    frames = workshop.folder / "frames"
    frames.mkdir()
    for index in range(3):
        (frames / f"{index}.ply").write_bytes(ply(rings=40, segments=60, phase=index))
    disk, said = None, {}
    if os.geteuid() == 0:
        disk = workshop.small_disk(64)
        (disk / "ballast").write_bytes(bytes(40 << 10))
    url = server.url("/v1/streams/demo")
    simplify = ("simplify", frames, "--target-faces", 4000)
    evaluate = ("evaluate", frames, "--target-faces", 1000)
    spare = workshop.folder / "spare"
    commands = {
        "simplify --metrics": (*simplify, "--output", spare, "--metrics", FULL),
        "evaluate --json": (*evaluate, "--json", FULL),
    }
    if disk:
        commands |= {
            "simplify --output": (*simplify, "--output", disk / "out", "--format", "ply"),
            "simplify --keep-registered": (
                *(*simplify, "--output", spare, "--keep-registered", disk / "registered"),
            ),
            "evaluate --report": (*evaluate, "--report", disk / "report"),
            "subscribe --output": ("subscribe", url, "--output", disk / "received"),
        }
    for name, arguments in commands.items():
        code, error = workshop.run(*arguments)
        place = str(disk) if disk and str(disk) in " ".join(map(str, arguments)) else FULL
        check(code == 1, f"{name} on a full disk ended with {code}: {error}")
        check("panicked" not in error, f"{name} panicked: {error}")
        check(place in error, f"{name} does not name the file: {error}")
        said[name] = "exit 1"
        for path in sorted(disk.rglob("*")) if disk else []:
            if path.is_file() and path.name != "ballast":
                check_whole(workshop, path, name)
                path.unlink()
    closed = subprocess.run(
        [workshop.binary, "publish", url, frames], stderr=open(FULL, "w"), check=False
    )
    check(closed.returncode in (0, 1), f"publish that cannot say anything: {closed.returncode}")
    rig.stop()
    check(player.is_there and player.lost == 0, f"{player.lost} frames were lost")
    return {"frames": len(player.seqs), **said}


def check_whole(workshop, path, name):
    """A file that is there is one that can be read to its end."""
    if path.suffix in (".drc", ".ply", ".glb"):
        output = workshop.folder / "again"
        code, error = workshop.run(
            "simplify", path, "--target-faces", 100, "--output", output, "--tracking", "off"
        )
        check(code == 0, f"{name} leaves {path.name} of {path.stat().st_size} bytes: {error}")
