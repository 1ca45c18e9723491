"""`palpate live`: tracks as it happens, shows it and records it."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from palpate.cli.bag_options import BAG_DEFAULTS, Bag, BagOptions, read_with
from palpate.cli.options import (
    CalibrationOption,
    FirstPoseOption,
    FirstPoseSigmaOption,
    FirstPoseUnknownOption,
    ForceOption,
    JsonOption,
    ModelOption,
    TactileOption,
    check_model,
    check_new,
    check_window,
    stated_first_pose,
)

if TYPE_CHECKING:
    from palpate.live.session import LiveState
    from palpate.live.setup import SetUp
    from palpate.touch.calibration import Calibration

Camera = Annotated[
    str | None,
    tyro.conf.arg(metavar="SERIAL|PATH|N", help="The camera of a DIGIT.", help_behavior_hint="(required, or --replay)"),
]
Poses = Annotated[
    str | None,
    tyro.conf.arg(
        metavar="udp:PORT|ros2:TOPIC|NAME",
        help="Sensor poses: JSON by UDP on this machine, a ROS 2 topic, or an entry point of palpate.poses.",
        help_behavior_hint="(required with --camera)",
    ),
]
Replay = Annotated[
    Path | None,
    tyro.conf.arg(
        metavar="FILE", help="A recording or a bag, played in real time.", help_behavior_hint="(default: none)"
    ),
]
Record = Annotated[
    Path | None,
    tyro.conf.arg(
        metavar="OUT.mcap",
        help="Record images, sensor poses and estimates; a kill loses at most the last second.",
        help_behavior_hint="(default: nothing is recorded)",
    ),
]
Seconds = Annotated[
    float | None, tyro.conf.arg(metavar="S", help="End after this time [s].", help_behavior_hint="(default: at Ctrl-C)")
]


def live(
    *,
    camera: Camera = None,
    poses: Poses = None,
    replay: Replay = None,
    tactile: TactileOption = "auto",
    model: ModelOption = None,
    calibration: CalibrationOption = None,
    first_pose: FirstPoseOption = None,
    first_pose_sigma: FirstPoseSigmaOption = None,
    first_pose_unknown: FirstPoseUnknownOption = False,
    bag: Bag = BAG_DEFAULTS,
    record: Record = None,
    view: Annotated[bool, tyro.conf.arg(help="Show it in Rerun too.")] = False,
    seconds: Seconds = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> int:
    """Track as it happens: the newest image with the sensor's pose at its time; Ctrl-C ends it.

    A table shows rate, latency, contact, status and pose; images that come faster than they are tracked are dropped and
    counted.

    Example: palpate live --camera D20001 --poses udp:5005 --shape rectangle --first-pose 0.1 0 0.3
    """
    from palpate.cli.console import busy, complain, print_json
    from palpate.config import TrackerSettings
    from palpate.errors import SettingError
    from palpate.live.recorder import recorder
    from palpate.live.session import LiveState, track_live
    from palpate.live.setup import stop_on_signals
    from palpate.live.table import live_table
    from palpate.touch.calibration import load_calibration
    from palpate.touch.model import TouchModel
    from palpate.tracker import Tracker

    check_model(model, [tactile])
    if tactile == "oracle":
        raise SettingError("--tactile oracle takes the truth, which nobody knows live; the others go")
    if seconds is not None and not seconds > 0.0:
        raise SettingError(f"--seconds is {seconds:g}; allowed is a time above 0 [s]")
    if view:
        check_window()
    if record:
        check_new(record, force)
    first_pose, first_pose_sigma = stated_first_pose(first_pose, first_pose_sigma, first_pose_unknown)
    learnt = None if model is None else TouchModel(model)
    unit = None if calibration is None else load_calibration(calibration)
    with ExitStack() as stack:
        sources_if_unused = stack.enter_context(ExitStack())
        with busy("looking for images and poses"):
            what = _set_up(camera, poses, replay, bag, first_pose, first_pose_sigma, unit)
            sources_if_unused.callback(what.close)
        shape, first = what.scene.shape, what.first_pose
        settings = TrackerSettings(tactile)
        tracker = Tracker(shape, what.sensor, first, settings, learnt, unit, first_pose_sigma=what.first_pose_sigma)
        taking = stack.enter_context(recorder(record, shape, what.recorded_sensor, force)) if record else None
        log = None
        if view:
            from palpate.viewer.rerun_view import live_view

            log = stack.enter_context(live_view(what.scene, what.name, None, force, window=True))
        stop = stack.enter_context(stop_on_signals())
        state = LiveState(complain)
        stack.enter_context(live_table(f"palpate live: {what.name}", state))
        sources_if_unused.pop_all()  # from here on the session's threads close them
        track_live(tracker, what.start(), state, stop, taking, log.show if log else None, seconds)
    if json:
        print_json(state.summary())
    else:
        _report(state, record)
    return 0


def _set_up(
    camera: str | None,
    poses: str | None,
    replay: Path | None,
    bag: BagOptions,
    first_pose: tuple[float, float, float] | None,
    first_pose_sigma: tuple[float, float, float] | None,
    calibration: "Calibration | None",
) -> "SetUp":
    """Return the set-up that the options describe; SettingError if they do not go together."""
    from palpate.errors import SettingError
    from palpate.io.outlines import load_shape
    from palpate.live.setup import camera_set_up, replay_set_up
    from palpate.types.recording import Recording

    if (camera is None) == (replay is None) or (camera is None) != (poses is None):
        raise SettingError("live takes either --camera with --poses, or --replay FILE")
    if replay is not None:
        reading = read_with(replay, bag)
        recording = reading if isinstance(reading, Recording) else reading.recording
        return replay_set_up(recording, replay.name, first_pose, first_pose_sigma)
    assert camera is not None and poses is not None
    if bag.shape is None or first_pose is None:
        raise SettingError(
            "--camera: the object is not known; --shape NAME|FILE and --first-pose X Y THETA or --first-pose-unknown "
            "say it"
        )
    if bag != BagOptions(shape=bag.shape, shape_unit=bag.shape_unit):
        raise SettingError("--camera: of the options for bags, only --shape and --shape-unit are of use")
    shape = load_shape(bag.shape, bag.shape_unit)
    return camera_set_up(camera, poses, shape, first_pose, first_pose_sigma, calibration)


def _report(state: "LiveState", record: Path | None) -> None:
    from palpate.cli.console import number, print_line, print_table

    latency = state.latency_ms()
    rows = [
        ("images", str(state.images), ""),
        ("tracked", str(state.tracked), ""),
        ("dropped", str(state.dropped), ""),
        ("without a sensor pose", str(state.without_pose), ""),
        ("left out", str(state.left_out), ""),
        ("sensor poses", str(state.poses), ""),
        ("refused poses", str(state.refused), ""),
        ("rate", number(state.rate), "Hz"),
        ("latency, median", number(latency["p50"]), "ms"),
        ("latency, 99 %", number(latency["p99"]), "ms"),
        ("latency, largest", number(latency["max"]), "ms"),
        ("in contact", str(state.contact_frames), "frames"),
        ("status", ", ".join(f"{count} {status}" for status, count in state.statuses.items()), "frames"),
    ]
    print_table("live", ("quantity", "value", "unit"), rows, numbers=(1,))
    if record:
        print_line(f"recorded: {record}")
