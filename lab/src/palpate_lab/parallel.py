"""Parallel work on many items: on the cores of this machine, or on a Dask cluster."""

import logging
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from palpate.errors import FileError, SettingError
from palpate.parallel import Item, Result, check_workers, processes, results_in_any_order, worker_died
from palpate_lab import required


def spread(
    function: Callable[[Item], Result], items: Iterable[Item], workers: int = 1, dask: str | None = None
) -> Generator[Result, None, None]:
    """Yield the results of a function for each item, in no order.

    `workers` processes here do the work, this one alone if it is 1, or the cluster of the Dask scheduler at an address
    such as "tcp://host:8786". Closing the generator cancels the rest.
    Raises SettingError on fewer workers than one, where the cluster does not answer, and where a process dies.
    """
    check_workers(workers)
    if workers == 1 and dask is None:
        yield from map(function, items)
        return
    with processes(workers) if dask is None else _cluster(dask) as pool:
        yield from results_in_any_order(pool, function, items)


@contextmanager
def held_folder(folder: Path) -> Iterator[None]:
    """Keep others from writing into a folder while the block runs; it is made where it is missing. Raises FileError."""
    from filelock import FileLock, Timeout

    lock = folder / ".folder.lock"
    held = FileLock(lock, timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held.acquire()
    except Timeout as error:
        raise FileError(f"{folder}: another process is writing it; wait until it ends, or name another") from error
    except OSError as error:
        raise FileError(f"{folder}: cannot be written ({error})") from error
    try:
        for unfinished in folder.glob("**/.*.part"):  # of killed processes
            unfinished.unlink(missing_ok=True)
        yield
    finally:
        lock.unlink(missing_ok=True)
        held.release()
        with suppress(OSError):  # unless it stayed empty
            folder.rmdir()


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress the tracker's warnings while many recordings are tracked; the summary counts the statuses."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    dask = required("--dask", "cluster", "distributed")
    try:
        client: Any = dask.Client(address, timeout=10, set_as_default=False)
    except (OSError, ValueError) as error:
        found = " ".join(str(error).split())
        raise SettingError(f"no Dask scheduler answers at {address!r} ({found}); allowed is tcp://HOST:PORT") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=10)
            yield client.get_executor(pure=False)
        except TimeoutError as error:
            raise SettingError(f"the Dask scheduler at {address!r} has no workers; start some") from error
        except dask.KilledWorker as error:
            raise worker_died() from error
