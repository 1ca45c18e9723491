"""Handing over from one thread to another where only the newest counts."""

import threading
from typing import Generic, TypeVar

T = TypeVar("T")


class Newest(Generic[T]):
    """Holds one thing; a newer one replaces it, and what nobody has taken by then is dropped and counted."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._waiting: T | None = None
        self._over = False
        self.dropped = 0
        """How many were replaced before they were taken."""

    @property
    def over(self) -> bool:
        """Whether nothing waits and nothing more will come."""
        with self._changed:
            return self._over and self._waiting is None

    def put(self, thing: T) -> None:
        """Hold this one from now on."""
        with self._changed:
            self.dropped += self._waiting is not None
            self._waiting = thing
            self._changed.notify()

    def end(self) -> None:
        """Say that nothing more will come."""
        with self._changed:
            self._over = True
            self._changed.notify()

    def take(self, patience: float) -> T | None:
        """Return what is held; None if nothing comes for a while [s], or nothing more will come."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is not None or self._over, patience)
            taken, self._waiting = self._waiting, None
            return taken
