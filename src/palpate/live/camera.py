"""Images of a camera: its exposure settled, its rate measured, opened again when it is lost."""

import threading
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from palpate.errors import SettingError
from palpate.live.clock import Clock
from palpate.live.devices import Device
from palpate.live.images import Image, TouchImage

SETTLED, ALIKE = 15, 0.5
"""So many images in turn whose mean differs by no more than this [grey levels] have settled."""
LONGEST_SETTLING = 5.0
"""[s] after which images are taken as they are."""

_AGAIN = 0.5  # [s] between attempts to open a camera that is lost
_STALE = 5  # images that drivers keep, and that are old when reading begins

_DAMAGED = 10  # images in turn after which a camera is lost


class Camera:
    """A camera that goes on when it is unplugged and comes back."""

    def __init__(self, open_device: Callable[[], Device], clock: Clock) -> None:
        """Open it, let its exposure settle and measure its rate. Raises SettingError where there are no images."""
        self._open, self._clock = open_device, clock
        self._device: Device | None = open_device()
        count, begin, last = 0, 0.0, None
        for last in self._settling(threading.Event()):
            begin = begin if count else last.time
            count += 1
        if last is None or count < 2:
            self.close()
            raise SettingError("the camera is open, but gives no images")
        assert not isinstance(last.data, bytes)
        self.size: tuple[int, int] = last.data.shape[:2]
        """Rows and columns of its images."""
        self.rate: float = (count - 1) / (last.time - begin)
        """Images per second, as measured [Hz]."""

    def images(self, stop: threading.Event) -> Iterator[TouchImage | str]:
        """Yield each image with the time at which it was there, and what is to be said; ends at the event."""
        try:
            for _ in range(_STALE):
                self._read()
            while not stop.is_set():
                image = self._read()
                if image is not None and _pixels(image).shape[:2] == self.size:
                    yield image
                    continue
                if image is not None:
                    yield f"the camera gives images of {_pixels(image).shape[:2]} rows and columns, not {self.size}"
                yield from self._opened_again(stop)
        finally:
            self.close()

    def close(self) -> None:
        """Let go of it."""
        if self._device is not None:
            self._device.close()
        self._device = None

    def _opened_again(self, stop: threading.Event) -> Iterator[str]:
        lost = self._clock.now()
        yield "the camera is lost, and is opened again as soon as it is there"
        self.close()
        while self._device is None:
            if stop.wait(_AGAIN):
                return
            with suppress(SettingError):
                self._device = self._open()
            if self._device is not None and not sum(1 for _ in self._settling(stop)):
                self.close()
        yield f"the camera is back after {self._clock.now() - lost:.1f} s"

    def _settling(self, stop: threading.Event) -> Iterator[TouchImage]:
        """Yield images until their exposure has settled, or for long enough."""
        means: list[float] = []
        begin = self._clock.now()
        while not stop.is_set() and self._clock.now() - begin < LONGEST_SETTLING:
            image = self._read()
            if image is None:
                return
            yield image
            means.append(float(_pixels(image).mean()))
            if len(means) >= SETTLED and np.ptp(means[-SETTLED:]) <= ALIKE:
                return

    def _read(self) -> TouchImage | None:
        """The next image; None where the camera gives none. Its time is that at which it was there."""
        for _ in range(_DAMAGED):
            if self._device is None or not self._device.grab():
                return None
            time = self._clock.now()
            pixels = self._device.image()
            if pixels is not None:
                return TouchImage(time, pixels)
        return None


def _pixels(image: TouchImage) -> Image:
    assert not isinstance(image.data, bytes)
    return image.data
