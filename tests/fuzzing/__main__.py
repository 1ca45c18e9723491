"""`make fuzz`: each reader of files on changed files, in processes of their own with limits of time and memory.

    python -m fuzzing [--count 100000] [--first 0] [--readers tum ros1] [--seconds 60] [--found FOLDER] [--into FILE]

Prints a line for each reader, keeps it in FILE.json beside those of others, and writes each file that a reader failed
on into the folder of what was found. A reader is done after so many files, or so many seconds.
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

BATCH = 25_000
"""Files after which a process is replaced; to start one takes as long as thousands of files."""
WAIT = 3600.0
"""Seconds after which a batch that says nothing is given up."""


def fuzz(
    name: str, first: int, count: int, seconds: float, found: Path, folder: Path
) -> tuple[dict[str, float], dict[str, str]]:
    """Try a reader: how many files were read, refused and faults, the most of memory and time, and the faults."""
    counts: Counter[str] = Counter()
    faults: dict[str, str] = {}
    memory, slowest, at, end, stopped = 0, 0.0, first, first + count, time.monotonic() + seconds
    while at < end and (left := stopped - time.monotonic()) > 0.0:
        stop = min(at + BATCH, end)
        command = [sys.executable, "-m", "fuzzing.worker", name, str(at), str(stop), str(folder), str(left)]
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
                memory, slowest = max(memory, said["memory_mb"]), max(slowest, said["slowest_s"])
                at += said["done"]
        if done.returncode == 0:
            continue
        if done.returncode > 0:
            raise SystemExit(f"{name}: the worker failed: {done.stderr[-2000:]}")
        died = int.from_bytes((folder / "at").read_bytes(), "little")
        how = "took too long" if done.returncode == -signal.SIGPROF else signal.Signals(-done.returncode).name
        counts["faults"] += 1
        counts["not counted"] += died - at
        faults.setdefault(f"{how} at {died}", _kept(folder / f"file{READERS[name].suffix}", found / f"{name}-{died}"))
        at = died + 1
    numbers = {key: counts[key] for key in ("read", "refused", "faults", "not counted")}
    return {"files": at - first, **numbers, "memory_mb": memory, "slowest_s": slowest}, faults


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
    parser.add_argument("--seconds", type=float, default=float("inf"), help="that a reader is tried at most")
    parser.add_argument("--found", type=Path, default=Path("fuzz-found"))
    parser.add_argument("--into", type=Path, help="JSON to keep what was found in")
    asked = parser.parse_args()
    failed = False
    results = json.loads(asked.into.read_bytes()) if asked.into and asked.into.exists() else {}
    for name in asked.readers:
        begin = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            counts, faults = fuzz(name, asked.first, asked.count, asked.seconds, asked.found, Path(folder))
        results[name] = counts | {"seconds": round(time.perf_counter() - begin)}
        print(f"{name}: {', '.join(f'{number} {key}' for key, number in results[name].items())}", flush=True)
        if asked.into is not None:
            asked.into.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        for fault, path in faults.items():
            print(f"    {fault}\n        {path}", flush=True)
        failed |= bool(faults)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
