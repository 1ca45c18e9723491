"""Work on several processes and on a cluster, and workers that die."""

import os
from typing import Any

import pytest

from palpate import SettingError
from palpate.lab.parallel import spread


def half_or_die(number: int) -> float:
    if number < 0:
        os._exit(9)
    return 0.5 * number


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed", reason="no distributed: pip install palpate[cluster]")
    import dask.config

    options = {"n_workers": 1, "threads_per_worker": 1, "processes": True, "dashboard_address": "127.0.0.1:0"}
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(**options, silence_logs="CRITICAL") as found,
    ):
        yield found.scheduler_address


def test_processes_and_a_cluster_find_the_same(cluster):
    ways: list[dict[str, Any]] = [{}, {"workers": 2}, {"dask": cluster}]
    for way in ways:
        assert sorted(spread(half_or_die, range(9), **way)) == [0.5 * number for number in range(9)]


@pytest.mark.parametrize("place", ["here", "on a cluster"])
def test_a_worker_that_dies_is_one_sentence(cluster, place):
    way: dict[str, Any] = {"workers": 2} if place == "here" else {"dask": cluster}
    with pytest.raises(SettingError, match="a process of the workers died, perhaps for lack of memory"):
        list(spread(half_or_die, [1, -1], **way))
