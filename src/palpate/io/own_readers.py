"""Readers of formats of one's own, by entry points of the group `palpate.io`.

An entry point is a module, or an object with the same: DESCRIPTION, a line for people; `detect(path)`, whether a file
is one of these; and `read(path)`, which returns a Recording or a Trajectory. `examples/own_package` has one.
"""

from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

from palpate.errors import FileError, PalpateError, SettingError
from palpate.own_code import called, loaded, own_code, words_of
from palpate.types.recording import Recording
from palpate.types.trajectory import Trajectory

GROUP = "palpate.io"


@dataclass(frozen=True)
class OwnReader:
    """A reader of somebody's own, which is used as the module of a format is."""

    entry: EntryPoint
    """Where it is from."""
    code: Any
    """What that stands for."""

    @property
    def DESCRIPTION(self) -> str:
        """What its files are, in words."""
        return str(getattr(self.code, "DESCRIPTION", called(self.entry)))

    def detect(self, path: Path) -> bool:
        """Whether the file is one of its own. Raises FileError where it cannot tell."""
        return bool(self._ask("detect", path))

    def read(self, path: Path) -> Recording | Trajectory:
        """What it makes of a file. Raises FileError where that is nothing, or nothing that is known."""
        found = self._ask("read", path)
        if not isinstance(found, Recording | Trajectory):
            kind = type(found).__name__
            raise FileError(
                f"{path}: {called(self.entry)} read a {kind}, expected a palpate.Recording or a palpate.Trajectory"
            )
        return replace(found, file=path) if isinstance(found, Recording) and found.file is None else found

    def _ask(self, what: str, path: Path) -> Any:
        try:
            return getattr(self.code, what)(path)
        except PalpateError as error:  # of a recording that it made, perhaps, which does not know of the file
            said = str(error)
            raise FileError(said if said.startswith(str(path)) else f"{path}: {said}") from error
        except Exception as error:  # whatever a user's code raises
            raise FileError(f"{path}: {called(self.entry)} ended with {words_of(error)}") from error


def own_reader(name: str) -> OwnReader:
    """Return the reader of this name. Raises SettingError where it cannot be loaded or lacks something."""
    entry = own_code(GROUP)[name]
    code = loaded(entry)
    if missing := [name for name in ("detect", "read") if not callable(getattr(code, name, None))]:
        raise SettingError(f"{called(entry)} lacks {' and '.join(missing)}; it needs detect(path) and read(path)")
    return OwnReader(entry, code)


def own_format(path: Path) -> str | None:
    """Return the name of the reader that takes a file, None if none does. Raises FileError and SettingError."""
    return next((name for name in own_code(GROUP) if own_reader(name).detect(path)), None)
