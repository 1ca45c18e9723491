"""`palpate live`: tracks as it happens, shows it and records it."""

import signal
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from palpate.cli.bag_options import BAG_DEFAULTS, Bag, BagOptions, read_with
from palpate.cli.options import (
    CalibrationOption,
    FirstPoseOption,
    FirstPoseSigmaOption,
    ForceOption,
    JsonOption,
    ModelOption,
    TactileOption,
    check_model,
    check_window,
)

if TYPE_CHECKING:
    from palpate.live.state import LiveState
    from palpate.recording.recording import Recording

LATENCIES = (("p50", "latency, median"), ("p99", "latency, 99 %"), ("max", "latency, largest"))


def live(
    *,
    replay: Annotated[
        Path,
        tyro.conf.arg(metavar="FILE", help="A recording or a bag, which is played in real time."),
    ],
    tactile: TactileOption = "learnt",
    model: ModelOption = None,
    calibration: CalibrationOption = None,
    first_pose: FirstPoseOption = None,
    first_pose_sigma: FirstPoseSigmaOption = None,
    bag: Bag = BAG_DEFAULTS,
    record: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="OUT.mcap",
            help="Record images, sensor poses and estimates; a kill loses at most the last message.",
            help_behavior_hint="(default: nothing is recorded)",
        ),
    ] = None,
    view: Annotated[bool, tyro.conf.arg(help="Show it in Rerun too.")] = False,
    seconds: Annotated[
        float | None,
        tyro.conf.arg(metavar="S", help="End after so long [s].", help_behavior_hint="(default: at Ctrl-C)"),
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> int:
    """Track as it happens: the newest image with the sensor's pose at its time; Ctrl-C ends it.

    A table shows rate, latency, contact, status and pose; images that come faster than they are tracked are dropped and
    counted.
    """
    from palpate.cli.console import busy, complain, print_json
    from palpate.errors import SettingError
    from palpate.live.recorder import recorder
    from palpate.live.replay import Replay
    from palpate.live.session import Sources, track_live
    from palpate.live.state import LiveState
    from palpate.live.table import live_table
    from palpate.touch.calibration import load_calibration
    from palpate.touch.model import SHIPPED, TouchModel
    from palpate.tracker import Tracker, TrackerSettings
    from palpate.tracking.run import first_pose_of

    check_model(model, [tactile])
    if tactile == "oracle":
        raise SettingError("--tactile oracle takes the truth, which nobody knows live; learnt, none and constant go")
    if seconds is not None and not seconds > 0.0:
        raise SettingError(f"--seconds is {seconds:g}; allowed is a time above 0 [s]")
    if view:
        check_window()
    with busy(f"reading {replay.name}"):
        recording = _recording(replay, bag)
    with ExitStack() as stack:
        learnt = TouchModel(model or SHIPPED) if tactile.startswith("learnt") else None
        tracker = Tracker(
            recording.shape,
            recording.sensor,
            first_pose_of(recording) if first_pose is None else first_pose,
            TrackerSettings(tactile),
            learnt,
            None if calibration is None else load_calibration(calibration),
            first_pose_sigma=first_pose_sigma,
        )
        taking = record and stack.enter_context(recorder(record, recording.shape, recording.sensor, force))
        log = None
        if view:
            from palpate.view.live import live_view

            log = stack.enter_context(live_view(recording, replay.name, None, force, window=True))
        state = LiveState(complain)
        stop = stack.enter_context(_ended_by_signals())
        played = Replay(recording)
        size = (recording.sensor.image_height, recording.sensor.image_width)
        sources = Sources(played.images, played.poses, played.clock, size)
        stack.enter_context(live_table(f"palpate live: {replay.name}", state))
        track_live(tracker, sources, state, stop, taking, log.show if log else None, seconds)
    if json:
        print_json(state.summary())
    else:
        _report(state, record)
    return 0


def _recording(file: Path, bag: BagOptions) -> "Recording":
    """The recording in a file or a bag."""
    from palpate.recording.recording import Recording

    reading = read_with(file, bag)
    return reading if isinstance(reading, Recording) else reading.recording


@contextmanager
def _ended_by_signals() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C and SIGTERM set, so that whatever is being written is written to its end."""
    stop = threading.Event()
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _report(state: "LiveState", record: Path | None) -> None:
    """Print how it went."""
    from palpate.cli.console import number, print_line, print_table

    said: dict[str, Any] = state.summary()
    rows = [
        ("images", str(said["images"]), ""),
        ("tracked", str(said["tracked"]), ""),
        ("dropped", str(said["dropped"]), ""),
        ("without a sensor pose", str(said["without_pose"]), ""),
        ("sensor poses", str(said["sensor_poses"]), ""),
        ("refused poses", str(said["refused_poses"]), ""),
        ("rate", number(said["rate_hz"]), "Hz"),
        *((name, number(said["latency_ms"][key]), "ms") for key, name in LATENCIES),
        ("in contact", str(said["contact_frames"]), "frames"),
        ("status", ", ".join(f"{count} {status}" for status, count in said["statuses"].items()), "frames"),
    ]
    print_table("live", ("what", "value", "unit"), rows, numbers=(1,))
    if record:
        print_line(f"recorded: {record}")
