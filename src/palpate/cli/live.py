"""`palpate live`: tracks as it happens, shows it and records it."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    import numpy as np
    from numpy.typing import NDArray

    from palpate.live.recorder import Recorder
    from palpate.live.rig import Rig
    from palpate.live.session import Compared
    from palpate.live.state import LiveState
    from palpate.live.truth import TruePose
    from palpate.touch.calibration import Calibration
    from palpate.viewer.live import LiveLog

LATENCIES = (("p50", "latency, median"), ("p99", "latency, 99 %"), ("max", "latency, largest"))


def live(
    *,
    camera: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="SERIAL|PATH|N", help="The camera of a DIGIT.", help_behavior_hint="(required, or --replay)"
        ),
    ] = None,
    poses: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="udp:PORT|ros2:TOPIC|NAME",
            help="Sensor poses: JSON by UDP on this machine, a ROS 2 topic, or an entry point of palpate.poses.",
            help_behavior_hint="(required with --camera)",
        ),
    ] = None,
    replay: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="FILE",
            help="A recording or a bag, which is played in real time.",
            help_behavior_hint="(default: none)",
        ),
    ] = None,
    truth: Annotated[
        tuple[str, Path] | None,
        tyro.conf.arg(
            metavar="CAMERA|VIDEO CAMERA.json",
            help="Ground truth by an overhead camera over printed tags, or by a video of one, and its file of palpate "
            "truth-camera.",
            help_behavior_hint="(default: none)",
        ),
    ] = None,
    tactile: TactileOption = "auto",
    model: ModelOption = None,
    calibration: CalibrationOption = None,
    first_pose: FirstPoseOption = None,
    first_pose_sigma: FirstPoseSigmaOption = None,
    first_pose_unknown: FirstPoseUnknownOption = False,
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
    from palpate.config import TrackerSettings
    from palpate.errors import SettingError
    from palpate.live.ended import ended_by_signals
    from palpate.live.overhead import overhead_truth
    from palpate.live.recorder import recorder
    from palpate.live.session import track_live
    from palpate.live.state import LiveState
    from palpate.live.table import LiveTable
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
    settings = TrackerSettings(tactile)
    first_pose, first_pose_sigma = stated_first_pose(first_pose, first_pose_sigma, first_pose_unknown)
    learnt = None if model is None else TouchModel(model)
    unit = None if calibration is None else load_calibration(calibration)
    with ExitStack() as stack:
        unused = stack.enter_context(ExitStack())
        with busy("looking for images and poses"):
            overhead = None if truth is None else overhead_truth(*truth)
            if overhead:
                unused.callback(overhead.close)
            rig = _rig(camera, poses, replay, bag, first_pose, first_pose_sigma, unit)
            unused.callback(rig.close)
        shape = rig.scene.shape
        sigma = rig.first_pose_sigma
        tracker = Tracker(shape, rig.sensor, rig.first_pose, settings, learnt, unit, first_pose_sigma=sigma)
        taking = record and stack.enter_context(recorder(record, shape, rig.recorded_sensor, force))
        log = None
        if view:
            from palpate.viewer.live import live_view

            log = stack.enter_context(live_view(rig.scene, rig.name, None, force, window=True))
        stop = stack.enter_context(ended_by_signals())
        table = LiveTable(f"palpate live: {rig.name}")
        state = LiveState(complain if not table.shown else lambda _: None)
        stack.enter_context(table.of(state))
        unused.pop_all()  # the session's threads close what they take from
        sources, watch = replace(rig.begin(), truth=overhead), log.show if log else None
        track_live(tracker, sources, state, stop, taking or None, watch, seconds, _compared(taking or None, log))
    if json:
        print_json(state.summary())
    else:
        _report(state, record)
    return 0


def _rig(
    camera: str | None,
    poses: str | None,
    replay: Path | None,
    bag: BagOptions,
    first_pose: tuple[float, float, float] | None,
    first_pose_sigma: tuple[float, float, float] | None,
    calibration: "Calibration | None",
) -> "Rig":
    """What the options say is to be tracked by what. Raises SettingError where they do not go together."""
    from palpate.errors import SettingError
    from palpate.io.outlines.load import load_shape
    from palpate.live.rig import camera_rig, replay_rig
    from palpate.types.recording import Recording

    if (camera is None) == (replay is None) or (camera is None) != (poses is None):
        raise SettingError("live takes either --camera with --poses, or --replay FILE")
    if replay is not None:
        reading = read_with(replay, bag)
        recording = reading if isinstance(reading, Recording) else reading.recording
        return replay_rig(recording, replay.name, first_pose, first_pose_sigma)
    assert camera is not None and poses is not None
    if bag.shape is None or first_pose is None:
        raise SettingError(
            "--camera: the object is not known; --shape NAME|FILE and --first-pose X Y THETA or --first-pose-unknown "
            "say it"
        )
    if bag != BagOptions(shape=bag.shape, shape_unit=bag.shape_unit):
        raise SettingError("--camera: of the options for bags, only --shape and --shape-unit are of use")
    return camera_rig(camera, poses, load_shape(bag.shape, bag.shape_unit), first_pose, first_pose_sigma, calibration)


def _compared(taking: "Recorder | None", log: "LiveLog | None") -> "Compared":
    """What takes true poses: the recording and the view, if there are any."""

    def take(true: "TruePose", estimate: "NDArray[np.float64] | None") -> None:
        if taking:
            taking.truth(true)
        if log:
            log.show_truth(true.time, true.pose, estimate)

    return take


def _report(state: "LiveState", record: Path | None) -> None:
    """Print how it went."""
    from palpate.cli.console import number, print_line, print_table

    said: dict[str, Any] = state.summary()
    rows = [
        ("images", str(said["images"]), ""),
        ("tracked", str(said["tracked"]), ""),
        ("dropped", str(said["dropped"]), ""),
        ("without a sensor pose", str(said["without_pose"]), ""),
        ("left out", str(said["left_out"]), ""),
        ("sensor poses", str(said["sensor_poses"]), ""),
        ("refused poses", str(said["refused_poses"]), ""),
        ("rate", number(said["rate_hz"]), "Hz"),
        *((name, number(said["latency_ms"][key]), "ms") for key, name in LATENCIES),
        ("in contact", str(said["contact_frames"]), "frames"),
        *_truth_rows(said["truth"]),
        ("status", ", ".join(f"{count} {status}" for status, count in said["statuses"].items()), "frames"),
    ]
    print_table("live", ("what", "value", "unit"), rows, numbers=(1,))
    if record:
        print_line(f"recorded: {record}")


def _truth_rows(truth: dict[str, Any] | None) -> list[tuple[str, str, str]]:
    """What ground truth says, if somebody looked for it."""
    from palpate.cli.console import number

    if truth is None:
        return []
    errors = [
        (f"{what} error, {name}", number(truth["error"][key][share]), unit)
        for what, key, unit in (("translation", "translation_mm", "mm"), ("rotation", "rotation_deg", "deg"))
        for name, share in (("median", "p50"), ("largest", "max"))
    ]
    return [("true poses, compared", f"{truth['poses']}, {truth['compared']}", ""), *errors]
