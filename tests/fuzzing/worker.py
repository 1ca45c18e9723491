"""Tries changed files on a reader until one ends the process: python -m fuzzing.worker READER FIRST END FOLDER SECONDS.

Says what it found on standard output, a line of JSON each. In its folder `file`, with the suffix of its kind, is what
it tries, `at` is the number of that, and a file that was neither read nor refused has its number for a name. After so
many seconds it begins no other file.
"""

import json
import logging
import os
import random
import resource
import shutil
import signal
import sys
import time
import warnings
from collections import Counter
from pathlib import Path

from fuzzing.mutations import changed
from fuzzing.readers import READERS, Reader, outcome

MEMORY = 500 * 10**6
"""[bytes] that reading a file may take."""
SECONDS = 5.0
"""Of computing, that reading a file may take."""


def changed_file(name: str, seeds: list[bytes], number: int) -> bytes:
    """The changed file of a number, the same at any time."""
    rng = random.Random(f"{name} {number}")
    return changed(rng.choice(seeds), seeds, rng)


def seeds_of(reader: Reader, folder: Path) -> list[bytes]:
    """The real files that are changed. They are read once, too."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    found = [path.read_bytes() for path in reader.seeds(folder)]
    for data in found:
        path = folder / f"seed{reader.suffix}"
        path.write_bytes(data)
        assert outcome(reader, path) == "read", outcome(reader, path)
    return found


def work(name: str, first: int, end: int, folder: Path, seconds: float) -> None:
    """Try the files of these numbers, for so many seconds at most."""
    reader = READERS[name]
    seeds = seeds_of(reader, folder / "seeds")
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    path, at = folder / f"file{reader.suffix}", os.open(folder / "at", os.O_WRONLY | os.O_CREAT)
    found: Counter[str] = Counter()
    begin, slowest, done = time.monotonic(), 0.0, 0
    for number in range(first, end):
        if time.monotonic() - begin > seconds:
            break
        os.pwrite(at, number.to_bytes(8, "little"), 0)
        path.write_bytes(changed_file(name, seeds, number))
        signal.setitimer(signal.ITIMER_PROF, SECONDS)  # ends this process where nothing else can
        computed = time.process_time()
        try:
            found["read" if outcome(reader, path) == "read" else "refused"] += 1
        except Exception as error:
            signal.setitimer(signal.ITIMER_PROF, 0)
            found["faults"] += 1
            last = error.__traceback__
            while last and last.tb_next:
                last = last.tb_next
            where = f"{Path(last.tb_frame.f_code.co_filename).name}:{last.tb_lineno}" if last else ""
            (folder / str(number)).write_bytes(changed_file(name, seeds, number))
            said = {"number": number, "fault": f"{type(error).__name__} {where} {str(error)[:200]}"}
            print(json.dumps(said), flush=True)
        done, slowest = done + 1, max(slowest, time.process_time() - computed)
    signal.setitimer(signal.ITIMER_PROF, 0)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000
    said = {"done": done, "counts": found, "memory_mb": memory, "slowest_s": round(slowest, 3)}
    print(json.dumps(said), flush=True)


if __name__ == "__main__":
    logging.disable()
    warnings.simplefilter("error")
    work(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]), float(sys.argv[5]))
