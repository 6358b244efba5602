"""How scenarios say what is wrong."""

import time


class Failed(Exception):
    """The server did not do what the scenario asserts."""


class Skipped(Exception):
    """The scenario cannot run on this machine."""


def check(holds, message):
    if not holds:
        raise Failed(message)


def skip(message):
    raise Skipped(message)


def wait_until(holds, seconds, message):
    """Waits until a condition holds; gives how long it took."""
    begun = time.monotonic()
    while not holds():
        if seconds < time.monotonic() - begun:
            raise Failed(f"not within {seconds} s: {message}")
        time.sleep(0.05)
    return time.monotonic() - begun
