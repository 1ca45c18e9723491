"""Kills every command that works for long at random times, looks at what it leaves and lets it go on.

    python scripts/kill_commands.py [simulate evaluate tune train track] [--kills 50] [--seed 0]

Each command runs on small recordings, as a process of its own, forked so that imports do not take most of its time.
After SIGKILL every file that shows is whole; the next start ends with what a run ends with that was left alone, to the
last digit where times do not enter, and no hidden file is left. Now and then a neighbour begins in the same folder
while the command is at it, and is told.
"""

import csv
import dataclasses
import hashlib
import io
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import h5py
import numpy as np
import torch
import tyro
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import onnxscript  # noqa: F401
from recording_samples import pushed
from training_samples import write_pushes

from palpate.cli import main
from palpate.estimation.warm_up import warm_up
from palpate.formats.palpate_h5 import checksum, write_recording
from palpate.simulation.scene import load_mujoco
from palpate.study import report  # noqa: F401
from palpate.training import features, heads, learn, results, train
from palpate.training.fit import FitSettings
from palpate.tuning import tuning  # noqa: F401

NEIGHBOUR = 5
"""A neighbour comes with every fifth kill."""
TOLD = ("another process is writing it", "already exists", "holds", "is not empty")
"""What a second run into a folder may be told."""
FAST = ("--tactile", "none", "oracle")

Name = Literal["simulate", "evaluate", "tune", "train", "track"]


@dataclasses.dataclass(frozen=True)
class Command:
    """A command to be killed."""

    words: tuple[str, ...]
    """How it begins."""
    again: tuple[str, ...]
    """What is said beside that to go on."""
    out: str
    """What it writes."""


COMMANDS: dict[Name, Command] = {
    "simulate": Command(("simulate", "out", "--shape", "disc", "--count", "3", "--seconds", "3"), ("--resume",), "out"),
    "evaluate": Command(("evaluate", "pushes", "--out", "out", *FAST), ("--resume",), "out"),
    "tune": Command(
        ("tune", "pushes", "--out", "out.json", "--tactile", "oracle", "--evaluations", "12"),
        ("--start", "out.json"),
        "out.json",
    ),
    "train": Command(("train", "touches", "--out", "out"), ("--resume",), "out"),
    "track": Command(("track", "pushes/push-0.h5", "--tactile", "oracle", "--out", "out"), ("--force",), "out"),
}


def prepare(folder: Path) -> None:
    """Make recordings, shrink trainings, and load what commands need, here and once for all processes."""
    load_mujoco()
    warm_up()
    (folder / "pushes").mkdir()
    for index in range(3):
        given = pushed(90)
        bent = given.sensor_pose + np.array([0.0, 1e-4 * index, 0.0])
        write_recording(dataclasses.replace(given, sensor_pose=bent), folder / "pushes" / f"push-{index}.h5")
    (folder / "touches").mkdir()
    write_pushes(folder / "touches")
    (folder / "touches" / "bare.h5").unlink()  # has no images and is there for another test
    short = FitSettings(steps=12, check=2)
    small = {learn: ("_GROUPS", 4), heads: ("_STEPS", 20), features: ("PAIRS", 4000), results: ("PAIRS", 4000)}
    for module, (name, value) in small.items():
        setattr(module, name, value)
    learn._IMAGES, learn._HELD_OUT = 16, 1
    train.TrainSettings = partial(train.TrainSettings, keypoint=short, touch=short)  # type: ignore[misc]


def begin(words: tuple[str, ...], folder: Path) -> int:
    """Fork a process that runs a command in a folder; its output goes to the file `said`."""
    process = os.fork()
    if process:
        return process
    code = 70
    try:
        os.chdir(folder)
        said = os.open(folder / "said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        os.dup2(said, 1)
        os.dup2(said, 2)
        code = main.main(words)
    except SystemExit as stop:
        code = int(stop.code or 0)
    finally:
        sys.stderr.flush()
        os._exit(code)


def end(process: int) -> int:
    """Wait for a process and return its exit code, negative where a signal ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def kill_after(process: int, seconds: float, folder: Path, words: tuple[str, ...], neighbour: bool) -> str:
    """Kill a process after a time; says "killed", or "ended" where it was done before, and what became of a neighbour.

    It is stopped while its neighbour runs, so that it is killed where it was.
    """
    time.sleep(seconds)
    os.kill(process, signal.SIGSTOP)
    told = ""
    if neighbour:
        code = end(begin(words, folder))
        said = (folder / "said").read_text()
        told = " before it began" if code == 0 else " told" if any(each in said for each in TOLD) else said
    os.kill(process, signal.SIGKILL)
    return ("killed" if end(process) == -signal.SIGKILL else "ended") + told


def check_whole(path: Path) -> None:
    """Raise an error unless a file is whole."""
    data = path.read_bytes()
    if path.suffix == ".h5":
        with h5py.File(path) as file:
            assert file.attrs["checksum"] == checksum(file), path
    elif path.suffix == ".json":
        json.loads(data)
    elif path.suffix == ".npz":
        with np.load(path) as arrays:
            assert all(arrays[name] is not None for name in arrays)
    elif path.suffix == ".png":
        Image.open(io.BytesIO(data)).load()
    elif path.suffix == ".pt":
        torch.load(path, weights_only=True)
    elif path.suffix in (".csv", ".tum"):
        assert not data or data.endswith(b"\n"), path
    elif path.suffix == ".html":
        assert data.rstrip().endswith(b"</html>"), path


def files(path: Path) -> list[Path]:
    """All files of an output, hidden ones too, and hidden files and folders beside it."""
    beside = [each for each in path.parent.iterdir() if each.name.startswith(".")]
    return [each for place in (path, *beside) for each in (place, *place.rglob("*")) if each.is_file()]


def hidden(path: Path, folder: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(folder).parts)


def digest(path: Path) -> str:
    """What is the same in a file whenever and however fast it was made."""
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            data = b"".join(arrays[name].tobytes() for name in sorted(arrays) if name not in ("step_ms", "summary"))
    elif path.suffix == ".pt":
        data = repr([value.tolist() for value in torch.load(path, weights_only=True)["best_state"].values()]).encode()
    elif path.name == "sequences.csv":
        rows = csv.DictReader(path.read_text().splitlines())
        data = json.dumps(
            [{key: row[key] for key in row if "ms" not in key and key != "wall_s"} for row in rows]
        ).encode()
    elif (
        path.suffix in (".html", ".png", ".tum")
        or (path.name in ("summary.json", "results.json")
        and "out/training" not in str(path))
    ):
        data = b""  # times are in it, or figures of them
    else:
        data = path.read_bytes()
    return hashlib.sha256(data).hexdigest()


def outcome(path: Path) -> dict[str, str]:
    """What a command that went to its end has made."""
    return {each.relative_to(path.parent).as_posix(): digest(each) for each in files(path)}


def remove(path: Path) -> None:
    for each in (path, *(each for each in path.parent.iterdir() if each.name.startswith("."))):
        shutil.rmtree(each) if each.is_dir() else each.unlink(missing_ok=True)


def torture(name: Name, folder: Path, kills: int, random_: random.Random) -> Counter[str]:
    """Kill a command so many times; returns what was seen."""
    command = COMMANDS[name]
    out, seen = folder / command.out, Counter[str]()
    begun = time.perf_counter()
    assert end(begin(command.words, folder)) == 0, (folder / "said").read_text()
    seconds, wanted = time.perf_counter() - begun, outcome(out)
    while seen["killed"] < kills:
        remove(out)
        neighbour = seen["killed"] % NEIGHBOUR == NEIGHBOUR - 1
        process = begin(command.words, folder)
        fate, _, told = kill_after(process, random_.uniform(0.0, seconds), folder, command.words, neighbour).partition(
            " "
        )
        if fate == "ended" or told == "before it began":
            seen["ended before the kill" if fate == "ended" else "neighbour came first"] += 1
            continue
        seen["killed"] += 1
        if neighbour:
            seen["neighbours told" if told == "told" else f"NEIGHBOUR: {told}"] += 1
        try:
            left = files(out)
            seen["left something hidden"] += any(hidden(each, folder) for each in left)
            seen["left files"] += any(not hidden(each, folder) for each in left)
            for each in left:
                if not hidden(each, folder):
                    check_whole(each)
            fresh = not out.exists()
            go_on = () if fresh and name in ("tune", "track") else command.again
            code = end(begin((*command.words, *go_on), folder))
            said = (folder / "said").read_text()
            complete = name == "train" and "holds a model already" in said
            assert code == 0 or complete, said
            after = outcome(out)
            if name == "tune" and not fresh:  # begins with what was found, and finds something else
                assert list(after) == list(wanted), list(after)
            else:
                different = [key for key in {**wanted, **after} if wanted.get(key) != after.get(key)]
                assert not different, f"differ: {different}"
            seen["went on to the same end"] += 1
        except Exception as error:
            seen[f"FAILED: {type(error).__name__}: {' '.join(str(error).split())[:300]}"] += 1
    return seen


def kill_commands(
    names: Annotated[tyro.conf.Positional[tuple[Name, ...]], tyro.conf.arg(metavar="COMMAND...")] = (),
    /,
    kills: int = 50,
    seed: int = 0,
) -> int:
    """Kill commands and print what was seen; 1 where anything failed."""
    bad = False
    with tempfile.TemporaryDirectory() as folder:
        prepare(Path(folder))
        for name in names or tuple(COMMANDS):
            begun = time.perf_counter()
            seen = torture(name, Path(folder), kills, random.Random(f"{seed} {name}"))
            remove(Path(folder) / COMMANDS[name].out)
            bad |= any(key.isupper() or key.startswith(("FAILED", "NEIGHBOUR")) for key in seen)
            told = ", ".join(f"{key} {count}" for key, count in seen.items())
            print(f"{name}: {told}; {time.perf_counter() - begun:.0f} s", flush=True)
    return int(bad)


if __name__ == "__main__":
    sys.exit(tyro.cli(kill_commands))
