"""A client in a process of its own, to be killed in the middle of a frame.

half.py publish|subscribe PORT PATH: does half of it, says "half" and the session, and waits.
"""

import json
import pathlib
import sys
import time
import types

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.dont_write_bytecode = True

from support.clients import BINARY, WebSocket  # noqa: E402
from support.frames import ply  # noqa: E402

FRAMES = 10


def main():
    kind, port, path = sys.argv[1:]
    server = types.SimpleNamespace(port=int(port))
    if kind == "publish":
        # Kept until the end: a socket that nobody has is closed.
        socket = WebSocket(server, path)
        session = publish(socket)
    else:
        socket = WebSocket(server, path, receive_buffer=4096)
        session = subscribe(socket)
    print("half", session, flush=True)
    time.sleep(3600)


def publish(socket):
    welcome = json.loads(socket.message()[1])
    for index in range(FRAMES):
        socket.send(BINARY, ply(phase=index))
        state = None
        while state != "published":
            state = json.loads(socket.message()[1]).get("state")
    socket.send(BINARY, ply(rings=100, segments=100), share=0.5)
    return welcome["session"]


def subscribe(socket):
    socket.message()
    # The head of the first frame, and a little of what follows.
    socket.take(200)
    return "-"


if __name__ == "__main__":
    main()
