"""Kills every command that works for long at random times, looks at what it leaves and lets it go on.

    python scripts/kill_commands.py [simulate evaluate tune train track] [--kills 50] [--seed 0] [--into FILE.json]

Each command runs on small recordings, in a process that is forked from one that has run it once, so that imports do not
take most of its time. After SIGKILL every file that shows has to be whole. The next start has to end with what a run
makes that was left alone, to the last bit but for times, and with no hidden file; a tuning that had left a file goes on
from its best settings and may find better ones, so that its files alone have to be the same. At every fifth kill a
neighbour begins the same while the command is at it, and has to be told. What was seen is printed, and kept in
FILE.json.
"""

import contextlib
import dataclasses
import io
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import onnx
import torch
import tyro
from onnx import numpy_helper
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from recording_samples import pushed
from training_samples import write_pushes

from palpate.cli import main
from palpate.graph.warm_up import warm_up
from palpate.io.palpate_h5 import source_of, write_recording
from palpate.lab.simulate.scene import load_mujoco
from palpate.lab.train import features, heads, learn, results, train
from palpate.lab.train.export import exported
from palpate.lab.train.fit import FitSettings
from palpate.pipeline import steps

NEIGHBOUR = 5
"""A neighbour comes with every so manieth kill."""
TOLD = ("another process is writing it", "already exists", "holds", "is not empty")
"""What it may be told: that somebody is there, or that something is."""
TIMED = (".png", ".html", ".tum", "summary.json", "out/results.json", "sequences.csv")
"""Ends of files that say how long something took, or that are drawn from such; what they are made of is compared."""

FRAMES = 16
"""Of a recording that is tracked: there are contacts in it, and fifty kills take a minute."""

Name = Literal["simulate", "evaluate", "tune", "train", "track"]


@dataclasses.dataclass(frozen=True)
class Command:
    """A command to be killed."""

    words: str
    """How it begins."""
    again: str
    """What is said beside that to go on with what is there."""
    out: str
    """What it writes."""


COMMANDS: dict[Name, Command] = {
    "simulate": Command("simulate out --shape disc --count 2 --seconds 3", "--resume", "out"),
    "evaluate": Command("evaluate pushes --out out --tactile oracle", "--resume", "out"),
    "tune": Command("tune pushes --out out.json --tactile oracle --evaluations 4", "--start out.json", "out.json"),
    "train": Command("train touches --out out", "--resume", "out"),
    "track": Command("track pushes/push-0.h5 --tactile oracle --out out", "--resume", "out"),
}


def prepare(folder: Path) -> None:
    """Make recordings, and shrink trainings."""
    load_mujoco()
    warm_up()
    (folder / "pushes").mkdir()
    for index in range(2):
        given = pushed(FRAMES)
        bent = given.sensor_pose + np.array([0.0, 1e-4 * index, 0.0])
        write_recording(dataclasses.replace(given, sensor_pose=bent), folder / "pushes" / f"push-{index}.h5")
    (folder / "touches").mkdir()
    write_pushes(folder / "touches")
    for more in ("bare", "push-2", "push-3"):  # they are there for a test
        (folder / "touches" / f"{more}.h5").unlink()
    short = FitSettings(steps=4, check=1)
    changes: dict[Any, dict[str, Any]] = {
        steps: {"_EVERY": 0.0},
        train: {"TrainSettings": partial(train.TrainSettings, keypoint=short, touch=short), "exported": export_of()},
        learn: {"_GROUPS": 2, "_IMAGES": 16, "_HELD_OUT": 1},
        heads: {"_STEPS": 20},
        features: {"PAIRS": 4000},
        results: {"PAIRS": 4000},
    }
    for module, values in changes.items():
        for name, value in values.items():
            setattr(module, name, value)


def export_of() -> Callable[[learn.Keypoints, learn.Touch], dict[str, bytes]]:
    """`exported`, which puts weights into networks that were traced once: tracing takes longer than all the rest."""
    traced = exported(learn.Keypoints(), learn.Touch())

    def with_weights(file: bytes, state: dict[str, torch.Tensor]) -> bytes:
        model = onnx.load_from_string(file)
        for each in model.graph.initializer:
            if each.name in state:
                each.CopyFrom(numpy_helper.from_array(state[each.name].numpy(), each.name))
        return model.SerializeToString()

    def export(keypoints: learn.Keypoints, touch: learn.Touch) -> dict[str, bytes]:
        networks = {"touch": touch.image, "pair": touch.pair, "keypoint": keypoints.encoder}
        return {name: with_weights(traced[name], network.state_dict()) for name, network in networks.items()}

    return export


def begin(words: str, folder: Path) -> int:
    """Fork a process that runs a command in a folder; what it prints goes to the file `said`."""
    process = os.fork()
    if process:
        return process
    code = 70
    try:
        os.chdir(folder)
        said = os.open("said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        os.dup2(said, 1)
        os.dup2(said, 2)
        code = main.main(words.split())
    except Exception:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


def end(process: int) -> int:
    """Wait for a process and return its exit code, negative where a signal ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def neighbour_is_told(process: int, words: str, folder: Path) -> bool:
    """Stop a process where it is, begin the same beside it and kill it; False where the neighbour was the first."""
    os.kill(process, signal.SIGSTOP)
    code, said = end(begin(words, folder)), (folder / "said").read_text()
    os.kill(process, signal.SIGKILL)
    if code != 0 and not any(each in said for each in TOLD):
        raise AssertionError(f"a neighbour ended with {code}: {said}")
    return code != 0


def files_of(out: Path) -> dict[str, Path]:
    """The files of an output, and hidden ones beside it, by their names."""
    beside = [each for each in out.parent.iterdir() if each.name.startswith(".")]
    found = [each for place in (out, *beside) for each in (place, *place.rglob("*")) if each.is_file()]
    return {each.relative_to(out.parent).as_posix(): each for each in found}


def is_hidden(name: str) -> bool:
    """Whether a file, or a folder that it lies in, is hidden."""
    return any(part.startswith(".") for part in name.split("/"))


def content(name: str, path: Path) -> Any:
    """What a file holds that is the same whenever it is made; raises an error unless the file is whole."""
    data: Any = path.read_bytes()
    if path.suffix == ".h5":
        source_of(path)
    elif path.suffix == ".npz":
        with np.load(path) as arrays:
            data = {key: arrays[key].tobytes() for key in arrays if key not in ("step_ms", "about")}
    elif path.suffix == ".pt":
        state = torch.load(path, weights_only=True)
        data = [state["step"], *(value.tolist() for value in state["best_state"].values())]
    elif path.suffix == ".png":
        Image.open(io.BytesIO(data)).load()
    elif path.suffix == ".json":
        json.loads(data)
    else:
        ends = {".html": (b"</html>", b"</html>\n"), ".csv": b"\n", ".tum": b"\n"}
        assert not data or data.endswith(ends.get(path.suffix, b"")), f"{name} is cut"
    return None if name.endswith(TIMED) else data


def remove(out: Path) -> None:
    """Remove an output and what is hidden beside it."""
    for each in (out, *(each for each in out.parent.iterdir() if each.name.startswith("."))):
        shutil.rmtree(each) if each.is_dir() else each.unlink(missing_ok=True)


def go_on(name: Name, folder: Path, wanted: dict[str, Any], seen: Counter[str]) -> None:
    """Look at what a kill left, begin again and compare what comes of it."""
    command = COMMANDS[name]
    out = folder / command.out
    left = files_of(out)
    for key, path in left.items():
        if not is_hidden(key):
            content(key, path)
    seen["left hidden files"] += any(map(is_hidden, left))
    seen["left files"] += out.exists()
    from_start = not out.exists()
    with_more = command.words if from_start and name == "tune" else f"{command.words} {command.again}"
    code, said = end(begin(with_more, folder)), (folder / "said").read_text()
    assert code == 0 or (name == "train" and "holds a model already" in said), said
    found = {key: content(key, path) for key, path in files_of(out).items()}
    assert found.keys() == wanted.keys(), f"other files: {found.keys() ^ wanted.keys()}"
    if name != "tune" or from_start:  # a tuning that begins with what was found may find something better
        different = [key for key in wanted if found[key] != wanted[key]]
        assert not different, f"other content: {different}"
        seen["went on to the same end"] += 1
    else:
        seen["went on"] += 1


def torture(name: Name, folder: Path, kills: int, chance: random.Random) -> Counter[str]:
    """Kill a command so many times; returns what was seen."""
    command, seen = COMMANDS[name], Counter[str]()
    out = folder / command.out
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        assert main.main(command.words.split()) == 0  # loads what it needs, once for all processes
    remove(out)
    start = time.perf_counter()
    assert end(begin(command.words, folder)) == 0, (folder / "said").read_text()
    seconds, wanted = time.perf_counter() - start, {key: content(key, path) for key, path in files_of(out).items()}
    while seen["killed"] < kills:
        remove(out)
        process = begin(command.words, folder)
        time.sleep(chance.uniform(0.0, seconds))
        told = True
        try:
            if seen["killed"] % NEIGHBOUR == NEIGHBOUR - 1:
                told = neighbour_is_told(process, command.words, folder)
            os.kill(process, signal.SIGKILL)
            if end(process) != -signal.SIGKILL or not told:
                seen["ended before" if told else "neighbour was first"] += 1
                continue
            seen["killed"] += 1
            seen["neighbours told"] += seen["killed"] % NEIGHBOUR == 0
            go_on(name, folder, wanted, seen)
        except AssertionError as error:
            seen[f"FAILED {' '.join(str(error).split())[:300]}"] += 1
        if seen["killed"] % 10 == 0:
            print(f"{name}: {dict(seen)}", file=sys.stderr, flush=True)
    return seen


def kill_commands(
    names: Annotated[tyro.conf.Positional[tuple[Name, ...]], tyro.conf.arg(metavar="COMMAND...")] = (),
    /,
    kills: int = 50,
    seed: int = 0,
    into: Path | None = None,
) -> int:
    """Kill commands and print what was seen; the exit code is 1 where anything failed."""
    failed, found = False, dict[str, dict[str, float]]()
    with tempfile.TemporaryDirectory() as folder:
        prepare(Path(folder))
        for name in names or tuple(COMMANDS):
            start = time.perf_counter()
            seen = torture(name, Path(folder), kills, random.Random(f"{seed} {name}"))
            remove(Path(folder) / COMMANDS[name].out)
            failed |= any(key.startswith("FAILED") for key in seen)
            found[name] = {**seen, "seconds": round(time.perf_counter() - start)}
            print(f"{name}: {', '.join(f'{key} {count}' for key, count in found[name].items())}", flush=True)
            if into is not None:
                into.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return int(failed)


if __name__ == "__main__":
    sys.exit(tyro.cli(kill_commands))
