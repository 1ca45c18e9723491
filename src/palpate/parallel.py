"""Work on many items by several processes of this machine, which end with the block that started them."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import connection
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from palpate.errors import SettingError

Item = TypeVar("Item")
Result = TypeVar("Result")

STOPS = (signal.SIGINT, signal.SIGTERM)
"""Signals that stop a process in good order."""


def check_workers(workers: int) -> None:
    """Raise SettingError on fewer workers than one."""
    if workers < 1:
        raise SettingError(f"workers is {workers}; allowed is 1 or more")


def results_in_any_order(pool: Executor, function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Yield the results of a function for each item from the processes of a pool, in no order."""
    for task in as_completed({pool.submit(_alone, function, item) for item in items}):
        yield task.result()


@contextmanager
def processes(workers: int) -> Iterator[Executor]:
    """Yield a pool of processes; those that have not begun an item are cancelled when the block ends.

    An error in the block, as by Ctrl-C, stops them all. Raises SettingError where processes cannot start, and where one
    dies.
    """
    # A forked worker takes no modules from the working folder. Torch's threads do not outlive a fork.
    method = "fork" if sys.platform == "linux" and "torch" not in sys.modules else "spawn"
    os.environ.setdefault("PYTHONSAFEPATH", "1")  # for those that are not forked
    _keep_opencv_to_one_thread()  # a forked worker would wait for its threads for ever
    context = multiprocessing.get_context(method)
    stopped, stop = context.Pipe(duplex=False)
    try:
        with stopped, stop, ProcessPoolExecutor(workers, context, _begin_worker, (stopped,)) as pool:
            try:
                yield pool
            except BaseException:
                stop.send(None)  # nobody takes it, so that all workers see it
                raise
            finally:
                pool.shutdown(cancel_futures=True)
    except BrokenExecutor as error:
        raise worker_died() from error
    except (BlockingIOError, NotImplementedError) as error:
        raise SettingError(f"worker processes cannot start ({error}); with workers 1 none are needed") from error


def worker_died() -> SettingError:
    """Return the error of a process that has died."""
    return SettingError("a process of the workers died, perhaps for lack of memory; fewer workers need less")


def _alone(function: Callable[[Item], Result], item: Item) -> Result:
    """Do an item in a worker; a signal ends both once the function has put its files in order."""
    _keep_opencv_to_one_thread()  # many processes would fight for cores
    _handle_stops(signal.default_int_handler)
    try:
        return function(item)
    except KeyboardInterrupt:
        os._exit(1)
    finally:
        _handle_stops(signal.SIG_DFL)


def _keep_opencv_to_one_thread() -> None:
    """Keep OpenCV, where it is loaded, to one thread."""
    library = sys.modules.get("cv2")
    if library is not None:
        library.setNumThreads(1)


def _begin_worker(stopped: Connection) -> None:
    """Make this process die silently: by signals, with its parent, and once there is something to read."""
    _handle_stops(signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, args=(stopped,), daemon=True).start()


def _end_with_parent(stopped: Connection) -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel, stopped])
        os.kill(os.getpid(), signal.SIGTERM)


def _handle_stops(handler: Any) -> None:
    """Set what signals that stop this process do, where it may: a worker of Dask does its items in other threads."""
    if threading.current_thread() is threading.main_thread():
        for number in STOPS:
            signal.signal(number, handler)
