"""Kills whole processes of `palpate live --replay --record` at random times, and looks at what they recorded.

    python scripts/kill_live.py [--kills 20] [--seed 0] [--into FILE.json]

Each session is forked, so that imports do not take most of its time, and tells by a pipe how many messages it has
handed to the system. After SIGKILL the file has to open and hold all of these and at most what was being written then.
As far as there are frames, it has to be a recording that can be tracked. The counts are kept in FILE.json.
"""

import contextlib
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import tyro

from palpate import io as formats
from palpate.cli import main
from palpate.errors import FileError
from palpate.geometry.objects import SHAPES
from palpate.graph.warm_up import warm_up
from palpate.io.bags.containers import raw_messages
from palpate.io.bags.mcap_writer import MessageWriter
from palpate.io.bags.raw import CutShort
from palpate.lab.simulate.recordings import simulate_recording
from palpate.live import recorder, session  # noqa: F401

RATE, LONGEST = 60.0, 4.0
"""Images a second, and how long a session may live [s]."""
BEING_WRITTEN = 3
"""Messages of an estimate, the most that is written at once."""


def kill_live(kills: int = 20, seed: int = 0, into: Path | None = None) -> int:
    """Kill sessions and print what was seen; the exit code is 1 where anything was lost."""
    chance, failed, messages = random.Random(seed), 0, 0
    into = into and into.absolute()
    with tempfile.TemporaryDirectory() as made:
        os.chdir(made)
        push = simulate_recording(SHAPES["rectangle"], "rectangle-edges", 1, 10.0)
        formats.write(replace(push, time=push.time * push.sensor.rate / RATE), "push.h5")
        warm_up()
        for number in range(kills):
            path = Path(f"{number}.mcap")
            wait = chance.uniform(0.0, LONGEST)
            told = killed(path, wait)
            found = sum(1 for _ in whole_messages(path))
            said = f"{wait:.2f} s: {told} messages handed over, {found} in the file"
            if not told <= found <= told + BEING_WRITTEN:
                failed += 1
                said += ", FAILED"
            with contextlib.suppress(FileError):  # there may be no frame yet
                said += f", {len(formats.load_recording(path))} frames"
            messages += found
            print(said, flush=True)
    found = {"killed": kills, "failed": failed, "messages": messages}
    print(found)
    if into is not None:
        into.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return int(failed > 0)


def killed(path: Path, wait: float) -> int:
    """Start a session that records, kill it so long [s] after its first message; return how many it had written."""
    ours, its = os.pipe()
    process = os.fork()
    if not process:
        os.close(ours)
        sys.stdout = sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115
        tell_of_each_message(its)
        os._exit(main.main(["live", "--replay", "push.h5", "--record", str(path)]))
    os.close(its)
    os.read(ours, 1)
    time.sleep(wait)
    os.kill(process, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    assert code == -signal.SIGKILL, f"it ended with {code} before it was killed"
    with os.fdopen(ours, "rb") as pipe:
        return 1 + len(pipe.read())


def tell_of_each_message(pipe: int) -> None:
    """Let this process write a byte to a pipe for each message that was handed to the system."""
    attach, add, flush = MessageWriter.attach, MessageWriter.add, MessageWriter.flush
    files, added = list[MessageWriter](), list[str]()

    def attached(self: MessageWriter, name: str, media_type: str, data: bytes) -> None:
        files.append(self)  # the file; others write to nowhere, so that nothing is slow the first time
        attach(self, name, media_type, data)

    def noted(self: MessageWriter, topic: str, type_: str, time: int, **fields: Any) -> None:
        add(self, topic, type_, time, **fields)
        added.extend([topic] if self in files else [])

    def told(self: MessageWriter) -> None:
        flush(self)
        os.write(pipe, b"1" * len(added))
        added.clear()

    MessageWriter.attach, MessageWriter.add, MessageWriter.flush = attached, noted, told


def whole_messages(path: Path) -> Iterator[object]:
    """The messages of a file, as far as it goes."""
    with contextlib.suppress(CutShort):
        yield from raw_messages(path)


if __name__ == "__main__":
    sys.exit(tyro.cli(kill_live))
