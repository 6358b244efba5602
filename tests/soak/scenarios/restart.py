"""The server is killed and started again on the same port: `publish` by WebSocket and by HTTP goes
on by itself or ends with a message that names the trouble, and so does `subscribe`."""

import subprocess
import time

from support import check, wait_until

SETTINGS = {
    "streams.defaults.tracking": "off",
    "streams.defaults.metrics": "sampled",
    "streams.defaults.target_faces": 400,
}


def run(workshop):
    server = workshop.server(settings=SETTINGS)
    rig = ("--synthetic", "--vertices", 1000, "--fps", 10, "--loop")
    clients = {
        "publish ws": start(workshop, "publish", server.url("/v1/streams/ws"), *rig, "--transport", "ws"),
        "publish http": start(workshop, "publish", server.url("/v1/streams/http"), *rig),
    }
    for stream in ("ws", "http"):
        wait_until(lambda name=stream: received(server, name) > 5, 20, f"{stream} frames come in")
    folder = workshop.folder / "received"
    clients["subscribe"] = start(
        workshop, "subscribe", server.url("/v1/streams/ws"), "--output", folder
    )
    wait_until(lambda: len(list(folder.glob("*.drc"))) > 5, 10, "frames are received")
    server.kill()
    time.sleep(1)
    server.start()
    wait_until(lambda: received(server, "ws") > 20, 30, "the rig by WebSocket comes back")
    wait_until(
        lambda: clients["publish http"].poll() is not None or received(server, "http") > 20,
        30,
        "the rig by HTTP goes on or ends",
    )
    newest = max(folder.glob("*.drc"), key=lambda path: path.stat().st_mtime_ns)
    began = time.time_ns()
    wait_until(
        lambda: clients["subscribe"].poll() is not None
        or any(path.stat().st_mtime_ns > began for path in folder.glob("*.drc")),
        30,
        f"the player goes on after {newest.name} or ends",
    )
    return {name: outcome(name, client) for name, client in clients.items()}


def start(workshop, *arguments):
    return workshop.start(arguments, stderr=subprocess.PIPE)


def received(server, stream):
    return server.metric(f'steadymesh_frames_received_total{{stream="{stream}"}}')


def outcome(name, client):
    """What became of a client: it goes on, or has ended with a message."""
    if client.poll() is None:
        client.kill()
        return "goes on"
    said = client.stderr.read().decode(errors="replace").strip().splitlines()
    check(client.returncode == 1, f"{name} ended with {client.returncode}: {said}")
    errors = [line for line in said if line.startswith("error: ")]
    check(errors and "panic" not in " ".join(said), f"{name} ended without a message: {said}")
    return f"ends ({errors[-1]})"
