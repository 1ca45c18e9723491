"""Work on many items at once: on the cores of this machine, or on a Dask cluster."""

import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from palpate.errors import SettingError

Item = TypeVar("Item")
Result = TypeVar("Result")

_CONNECT = 10  # [s] in which a cluster must answer


def spread(
    function: Callable[[Item], Result], items: Iterable[Item], workers: int = 1, dask: str | None = None
) -> Generator[Result, None, None]:
    """Yield the results of a function for each item, as they come and in no order.

    The work goes to so many processes here, to none but this one if `workers` is 1, or to the cluster of the Dask
    scheduler at an address such as "tcp://host:8786". Linear algebra keeps to one thread in each process, so that
    they do not fight for cores. Closing the generator gives up the rest. Raises SettingError where joblib or the
    cluster cannot be had.
    """
    try:
        import joblib
    except ImportError as error:
        raise SettingError(
            "working in parallel needs joblib, which is not installed: pip install palpate[sim]"
        ) from error
    with _backend(joblib, workers, dask) as parallel:
        results = parallel(joblib.delayed(function)(item) for item in items)
        try:
            for result in results:  # noqa: UP028, for that would close it before the warning is silenced
                yield result
        finally:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", ".*cancelled", UserWarning)  # joblib's, where the rest is given up
                results.close()


@contextmanager
def _backend(joblib: Any, workers: int, dask: str | None) -> Iterator[Any]:
    if dask is None:
        with joblib.parallel_config(backend="loky", inner_max_num_threads=1):
            parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered")
        yield parallel
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise SettingError("--dask needs distributed, which is not installed: pip install palpate[sim]") from error
    try:
        client = Client(dask, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        found = " ".join(str(error).split())
        raise SettingError(f"no Dask scheduler answers at {dask!r} ({found}); allowed is tcp://HOST:PORT") from error
    with client:
        with joblib.parallel_config(backend="dask", client=client, wait_for_workers_timeout=_CONNECT):
            parallel = joblib.Parallel(return_as="generator_unordered")
        yield parallel
