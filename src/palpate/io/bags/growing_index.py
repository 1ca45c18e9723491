"""The index of an MCAP that grows: `mcap` keeps it in memory, some 10 MB a minute where each message is flushed."""

import tempfile
import weakref
from collections.abc import Iterator
from typing import Any

_INDEX = (
    "_Writer__chunk_indices"  # a list of the writer's own, to which it appends and through which it goes at the end
)


class _Encoded:
    """Records of an index as bytes, which are written like one."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def write(self, builder: Any) -> None:
        builder.write(self._data)


class GrowingIndex:
    """Takes the place of the writer's list: records go to a temporary file until the end."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 closed with the index
        weakref.finalize(self, self._file.close)

    def append(self, record: Any) -> None:
        """Take the record of a chunk."""
        from mcap.data_stream import RecordBuilder

        builder = RecordBuilder()
        record.write(builder)
        self._file.write(builder.end())

    def __iter__(self) -> Iterator[_Encoded]:
        self._file.seek(0)
        yield _Encoded(self._file.read())


def keep_index_on_disk(writer: Any) -> None:
    """Let an `mcap` writer keep the index of its chunks in a temporary file."""
    assert getattr(writer, _INDEX) == []
    setattr(writer, _INDEX, GrowingIndex())
