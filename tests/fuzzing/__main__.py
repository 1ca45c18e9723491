"""`make fuzz`: each reader of files on changed files, in processes of their own with limits of time and memory.

    python -m fuzzing [--count 100000] [--first 0] [--readers tum ros1] [--found FOLDER]

Prints a line for each reader and writes each file that a reader failed on into the folder of what was found.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from fuzzing.readers import READERS

BATCH = 2000
"""Files after which a process is replaced."""
WAIT = 600.0
"""Seconds after which a batch that says nothing is given up."""


def fuzz(name: str, first: int, count: int, found: Path, folder: Path) -> tuple[Counter[str], int, dict[str, str]]:
    """Try a reader: how many files were read, refused and faults, the most memory [MB], and what each fault was."""
    counts: Counter[str] = Counter()
    faults: dict[str, str] = {}
    memory, at, end = 0, first, first + count
    while at < end:
        stop = min(at + BATCH, end)
        command = [sys.executable, "-m", "fuzzing.worker", name, str(at), str(stop), str(folder)]
        env = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT, env=env, check=False)
        # Libraries say things, too.
        for line in (each for each in done.stdout.splitlines() if each.startswith('{"')):
            said = json.loads(line)
            if "fault" in said:
                faults.setdefault(
                    said["fault"], _kept(folder / str(said["number"]), found / f"{name}-{said['number']}")
                )
            else:
                counts += Counter(said["counts"])
                memory = max(memory, said["memory_mb"])
        if done.returncode == 0:
            at = stop
            continue
        if done.returncode > 0:
            raise SystemExit(f"{name}: the worker failed: {done.stderr[-2000:]}")
        died = int.from_bytes((folder / "at").read_bytes(), "little")
        how = "took too long" if done.returncode == -signal.SIGPROF else signal.Signals(-done.returncode).name
        counts["faults"] += 1
        counts["not counted"] += died - at
        faults.setdefault(f"{how} at {died}", _kept(folder / f"file{READERS[name].suffix}", found / f"{name}-{died}"))
        at = died + 1
    return counts, memory, faults


def _kept(file: Path, path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(file, path)
    return str(path)


def main() -> int:
    """Try all readers, or those that are named."""
    parser = argparse.ArgumentParser(prog="fuzzing", description="Tries readers of files on changed files.")
    parser.add_argument("--count", type=int, default=100_000, help="changed files a reader")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--readers", nargs="*", default=list(READERS), choices=list(READERS))
    parser.add_argument("--found", type=Path, default=Path("fuzz-found"))
    asked = parser.parse_args()
    failed = False
    for name in asked.readers:
        begin = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            counts, memory, faults = fuzz(name, asked.first, asked.count, asked.found, Path(folder))
        said = ", ".join(f"{counts[key]} {key}" for key in ("read", "refused", "faults", "not counted"))
        print(f"{name}: {asked.count} files: {said}; {memory} MB, {time.perf_counter() - begin:.0f} s", flush=True)
        for fault, path in faults.items():
            print(f"    {fault}\n        {path}", flush=True)
        failed |= bool(faults)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
