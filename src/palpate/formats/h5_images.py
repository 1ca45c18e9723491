"""The images of an HDF5 file, read as they are asked for."""

import threading
import weakref
from pathlib import Path
from typing import Any

from palpate.errors import FileError
from palpate.recording.stored_images import StoredImages

_DAMAGED = (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError)


class H5Images(StoredImages):
    """The rows of a dataset of variable-length bytes; the file stays open from the first one on."""

    def __init__(self, path: Path, dataset: str, count: int) -> None:
        """Take the file, the name of the dataset in it and how many rows it has."""
        self._given = path.absolute(), dataset, count
        self._lock = threading.Lock()
        self._rows: Any = None

    def __len__(self) -> int:
        return self._given[2]

    def read(self, index: int) -> bytes:
        """The bytes of one image. Raises FileError where the file is damaged there."""
        path, dataset, _ = self._given
        try:
            with self._lock:
                self._rows = self._opened(path, dataset) if self._rows is None else self._rows
                return self._rows[index].tobytes()
        except _DAMAGED as error:
            said = " ".join(str(error).split())
            raise FileError(f"{path}: image of frame {index}: is truncated or damaged ({said})") from error

    def __reduce__(self) -> tuple[Any, ...]:
        return H5Images, self._given

    def _opened(self, path: Path, dataset: str) -> Any:
        import h5py

        file = h5py.File(path, "r")
        weakref.finalize(self, file.close)
        return file[dataset]
