"""How long to wait before the next attempt."""

from __future__ import annotations

import random

FIRST_SECONDS = 0.2
MAX_SECONDS = 5.0


class Backoff:
    """Twice as long with every attempt, up to five seconds.

    A part is left to chance, so that many clients do not come back to a server all at once.
    """

    def __init__(self) -> None:
        self._seconds = FIRST_SECONDS

    def next(self, asked: float | None = None) -> float:
        """The seconds to wait now: those that the server ``asked`` for, if it did."""
        if asked is not None:
            return asked
        seconds = self._seconds * random.uniform(0.5, 1.0)
        self._seconds = min(2.0 * self._seconds, MAX_SECONDS)
        return seconds

    def reset(self) -> None:
        """An attempt has succeeded."""
        self._seconds = FIRST_SECONDS
