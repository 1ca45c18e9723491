"""Encoded images that stay on disk until they are asked for, so that a recording may be larger than memory."""

import operator
import tempfile
import threading
import weakref
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, SupportsIndex, overload

IN_MEMORY = 64_000_000
"""Bytes of images that are kept in memory; beyond, they go to a temporary file."""


class StoredImages(Sequence[bytes]):
    """Images one after the other, each read when it is asked for; equal to any sequence of the same bytes."""

    @abstractmethod
    def read(self, index: int) -> bytes:
        """The bytes of one image; 0 <= index < len."""

    @overload
    def __getitem__(self, index: SupportsIndex) -> bytes: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[bytes, ...]: ...
    def __getitem__(self, index: SupportsIndex | slice) -> bytes | tuple[bytes, ...]:
        """One image, or some as a tuple of bytes."""
        if isinstance(index, slice):
            return tuple(self.read(each) for each in range(*index.indices(len(self))))
        index = operator.index(index)  # of NumPy's integers, which JSON does not take
        if not -len(self) <= index < len(self):
            raise IndexError(f"image {index} of {len(self)}")
        return self.read(index % len(self))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and len(self) == len(other) and all(map(bytes.__eq__, self, other))

    __hash__ = None  # pyright: ignore[reportAssignmentType]


class ImageSpool:
    """Takes images as they are read from somewhere; many of them go to a temporary file."""

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(IN_MEMORY)  # noqa: SIM115 closed with the spool
        self._lock = threading.Lock()
        weakref.finalize(self, self._file.close)

    def add(self, data: bytes) -> tuple[int, int]:
        """Take an image; returns where it is: offset and length."""
        with self._lock:
            offset = self._file.seek(0, 2)
            self._file.write(data)
            return offset, len(data)

    def read(self, offset: int, length: int) -> bytes:
        """The bytes at a place."""
        with self._lock:
            self._file.seek(offset)
            return self._file.read(length)


class SpooledImages(StoredImages):
    """Images at their places in a spool."""

    def __init__(self, spool: ImageSpool, places: Iterable[tuple[int, int]]) -> None:
        """Take the spool, and offset and length of each image."""
        self._spool, self._places = spool, tuple(places)

    def __len__(self) -> int:
        return len(self._places)

    def read(self, index: int) -> bytes:
        """The bytes of one image."""
        return self._spool.read(*self._places[index])

    def first(self, count: int) -> "SpooledImages":
        """The first of them."""
        return SpooledImages(self._spool, self._places[:count])

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (list(self),)
