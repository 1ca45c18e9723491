"""Work on several processes and on a cluster, and workers that die."""

import os
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import psutil
import pytest

from palpate import SettingError
from palpate_lab.parallel import spread


def half_or_die(number: int) -> float:
    if number < 0:
        os._exit(9)
    return 0.5 * number


def finds(name: str) -> bool:
    return find_spec(name) is not None


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed", reason="no distributed: pip install 'palpate-lab[cluster]'")
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


@pytest.mark.parametrize("is_torch_loaded", [False, True])
def test_workers_take_no_modules_from_the_working_folder(is_torch_loaded, tmp_path, monkeypatch):
    """A file of a stranger beside recordings may have the name of a module."""
    monkeypatch.chdir(tmp_path)
    if is_torch_loaded:  # workers are not forked then
        monkeypatch.setitem(sys.modules, "torch", ModuleType("torch"))
    for name in ("stranger", "random", "socket", "numpy"):
        Path(f"{name}.py").write_text("open('RAN', 'w').close()\n")
    assert list(spread(finds, ["stranger"] * 3, workers=2)) == [False] * 3
    assert not Path("RAN").exists()


def test_workers_run_after_opencv_used_threads():
    """They do not outlive a fork, and a worker would wait for them."""
    used = "import cv2, numpy as np; cv2.setNumThreads(4); cv2.GaussianBlur(np.zeros((2000, 2000, 3)), (31, 31), 0)"
    said = "from palpate_lab.parallel import spread; print(sorted(spread(abs, [1, -2, 3], 2)))"
    done = subprocess.run([sys.executable, "-c", f"{used}; {said}"], capture_output=True, timeout=60, check=True)
    assert done.stdout == b"[1, 2, 3]\n"


def test_workers_end_with_a_process_that_is_killed():
    code = "import time; from palpate_lab.parallel import spread; list(spread(time.sleep, [60.0] * 2, workers=2))"
    process = subprocess.Popen([sys.executable, "-c", code])
    parent = psutil.Process(process.pid)
    workers: list[psutil.Process] = []
    while len(workers) < 2:
        time.sleep(0.05)
        workers = parent.children()
    time.sleep(0.5)  # until they have begun
    process.kill()
    process.wait()
    assert psutil.wait_procs(workers, timeout=20)[1] == []


def test_a_signal_stops_workers_at_once_and_their_files_are_in_order(tmp_path):
    """A scheduler's signal comes to the first process alone, and soon after it follows a kill."""
    part = tmp_path / "part"
    code = f"""
import signal, time
from pathlib import Path
from palpate_lab.parallel import spread

def write(_):
    part = Path({str(part)!r})
    try:
        part.touch()
        time.sleep(60.0)
    finally:
        part.unlink()

signal.signal(signal.SIGTERM, signal.default_int_handler)
list(spread(write, [0], workers=2))
"""
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.DEVNULL)
    while not part.exists():
        time.sleep(0.02)
    process.terminate()
    process.wait(20)
    assert not part.exists()


def test_workers_that_cannot_start_are_one_sentence(monkeypatch):
    def refuse() -> int:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.delitem(sys.modules, "torch", raising=False)  # workers are forked without it
    monkeypatch.setattr("os.fork", refuse)
    with pytest.raises(SettingError, match=r"worker processes cannot start .*temporarily unavailable"):
        list(spread(finds, ["stranger"], workers=2))
