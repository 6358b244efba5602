"""What all scenarios use: a server, clients for it, frames, and ways to say what is wrong."""

from .checks import Failed, Skipped, check, skip, wait_until
from .clients import Player, Rig, Slow, raise_file_limit, request
from .frames import ply, rig_frames
from .nats import Nats
from .recordings import track
from .server import Server, Workshop

__all__ = [
    "Failed",
    "Nats",
    "Player",
    "Rig",
    "Server",
    "Skipped",
    "Slow",
    "Workshop",
    "check",
    "ply",
    "raise_file_limit",
    "request",
    "rig_frames",
    "skip",
    "track",
    "wait_until",
]
