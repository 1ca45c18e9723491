"""Locks on files and folders that end with the process that holds them, however it ends.

What is being written has a hidden name beside its own, `.NAME.part`, and is locked while its writer lives. So what a
killed process left is told from what a living one writes, and the next writer of the same takes it over. On Windows,
and on file systems without such locks, nothing is locked, and nothing of others is removed.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

from palpate.errors import FileError
from palpate.shards import Shard

try:
    import fcntl
except ImportError:
    fcntl = None


def part_of(path: Path) -> Path:
    """Return the hidden name beside `path` that it has while it is written."""
    return path.with_name(f".{path.name}.part")


@contextmanager
def held(path: Path, target: Path, folder: bool = False) -> Iterator[None]:
    """Hold a file or folder while the block runs; it is made where it is not there, and a file is emptied.

    Raises FileError, which names `target`, where another process holds it or it cannot be made.
    """
    try:
        handle = _hold(path, target, folder)
    except OSError as error:
        raise FileError(f"{target}: cannot be written ({error})") from error
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


@contextmanager
def held_folder(folder: Path, what: str, shard: Shard | None = None) -> Iterator[None]:
    """Hold a folder that grows while the block runs, and make it where it is not there.

    Processes that hold shards of it hold it together, each shard by one of them. A folder that was made is removed
    again where the block fails before anything is in it. Raises FileError where another process holds it, and where it
    cannot be made, saying `what` it cannot be.
    """
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    try:
        handle = _hold(folder, folder, folder=True, together=shard is not None)
    except OSError as error:
        raise FileError(f"{folder}: cannot be {what} ({error.strerror})") from error
    try:
        if shard is None:
            remove_parts(folder, ".shard-*.lock")
        with only_writer(folder / str(shard)) if shard else nullcontext():
            yield
    except BaseException:
        remove_empty(made)
        raise
    finally:
        if handle is not None:
            os.close(handle)


@contextmanager
def only_writer(path: Path) -> Iterator[None]:
    """Keep others from writing a file that the block writes again and again; FileError where one does already."""
    lock = path.with_name(f".{path.name}.lock")
    with held(lock, path):
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)


def remove_parts(folder: Path, pattern: str) -> None:
    """Remove the files of a pattern that dead processes left unfinished; those of living ones stay."""
    for part in folder.glob(pattern):
        with suppress(OSError), part.open("rb") as file:
            if _lock(file.fileno()) and _is_at(file.fileno(), part):
                part.unlink()


def remove_empty(folders: list[Path]) -> None:
    """Remove folders, the inner first, as far as they are empty."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


def _hold(path: Path, target: Path, folder: bool, together: bool = False) -> int | None:
    """Make and lock it; returns the descriptor that holds it, None on a system without locks.

    Several processes can hold it `together`, and then no other.
    """
    flags = os.O_RDONLY if folder else os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
    while True:
        if folder:
            path.mkdir(parents=True, exist_ok=True)
        if fcntl is None:
            return None
        handle = os.open(path, flags, 0o666)
        try:
            if _lock(handle, together) is False:
                raise FileError(f"{target}: another process is writing it; wait until it ends, or name another")
            if _is_at(handle, path):
                if not folder:
                    os.ftruncate(handle, 0)
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # its holder moved or removed it after it was opened here: once more


def _lock(handle: int, together: bool = False) -> bool | None:
    """Whether the lock was to be had; None where there are none."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if together else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return None
    return True


def _is_at(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False
