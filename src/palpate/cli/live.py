"""`palpate live`: tracks as it happens, shows it and records it."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from palpate.cli.options import Bag, Force, Json, Start, Touch, arg, check_new, check_window

if TYPE_CHECKING:
    from palpate.live.session import LiveState
    from palpate.live.setup import SetUp
    from palpate.touch.calibration import Calibration


@dataclass(frozen=True)
class Source:
    """The source of images and sensor poses: a camera with poses, or a replay."""

    camera: Annotated[str | None, arg("SERIAL|PATH|N", "none; this or --replay is required")] = None
    """The camera of a DIGIT."""
    poses: Annotated[str | None, arg("udp:PORT|ros2:TOPIC|NAME", "none; required with --camera")] = None
    """Sensor poses: JSON by UDP on this machine, a ROS 2 topic, or an entry point of palpate.poses."""
    replay: Annotated[Path | None, arg("FILE", "none")] = None
    """A recording or a bag, played in real time."""

    def set_up(self, bag: Bag, start: Start, calibration: "Calibration | None") -> "SetUp":
        """Open the source; SettingError if options do not go together."""
        from palpate.errors import SettingError
        from palpate.io.outlines import load_shape
        from palpate.live.setup import camera_set_up, replay_set_up
        from palpate.types.recording import Recording

        first_pose, sigma = start.pose_and_sigma()
        if (self.camera is None) == (self.replay is None) or (self.camera is None) != (self.poses is None):
            raise SettingError("live takes either --camera with --poses, or --replay FILE")
        if self.replay is not None:
            reading = bag.read(self.replay)
            recording = reading if isinstance(reading, Recording) else reading.recording
            return replay_set_up(recording, self.replay.name, first_pose, sigma)
        assert self.camera is not None and self.poses is not None
        if bag.shape is None or first_pose is None:
            raise SettingError("--camera needs --shape NAME|FILE, and --first-pose X Y THETA or --first-pose-unknown")
        if bag != Bag(shape=bag.shape, shape_unit=bag.shape_unit):
            raise SettingError("--camera: of the options for bags, only --shape and --shape-unit can be used")
        shape = load_shape(bag.shape, bag.shape_unit)
        return camera_set_up(self.camera, self.poses, shape, first_pose, sigma, calibration)


def live(
    *,
    record: Annotated[Path | None, arg("OUT.mcap", "none")] = None,
    view: bool = False,
    seconds: Annotated[float | None, arg("S", "until Ctrl-C")] = None,
    force: Force = False,
    json: Json = False,
    source: Source = Source(),
    start: Start = Start(),
    touch: Touch = Touch(),
    bag: Bag = Bag(),
) -> int:
    """Track as it happens: the newest image with the sensor's pose at its time; Ctrl-C ends it.

    A table shows rate, latency, contact, status and pose; images that arrive faster than they are tracked are dropped
    and counted.

    Example: palpate live --camera D20001 --poses udp:5005 --shape rectangle --first-pose 0.1 0 0.3

    Args:
        record: Record images, sensor poses and estimates; a kill loses at most the last second.
        view: Show it in Rerun too.
        seconds: End after this time [s].
    """
    from palpate.cli.console import busy, complain, print_json
    from palpate.config import TrackerSettings
    from palpate.errors import SettingError
    from palpate.live.recorder import recorder
    from palpate.live.session import LiveState, track_live
    from palpate.live.setup import stop_on_signals
    from palpate.live.table import live_table
    from palpate.tracker import Tracker

    if touch.tactile == "oracle":
        raise SettingError("--tactile oracle needs ground truth, which is unknown live")
    if seconds is not None and not seconds > 0.0:
        raise SettingError(f"--seconds is {seconds:g}; allowed is a time above 0 [s]")
    if view:
        check_window()
    if record:
        check_new(record, force)
    model, calibration = touch.load()
    with ExitStack() as stack:
        sources_if_unused = stack.enter_context(ExitStack())
        with busy("looking for images and poses"):
            set_up = source.set_up(bag, start, calibration)
            sources_if_unused.callback(set_up.close)
        shape, first = set_up.scene.shape, set_up.first_pose
        settings, sigma = TrackerSettings(touch.tactile), set_up.first_pose_sigma
        tracker = Tracker(shape, set_up.sensor, first, settings, model, calibration, first_pose_sigma=sigma)
        taking = stack.enter_context(recorder(record, shape, set_up.recorded_sensor, force)) if record else None
        log = None
        if view:
            from palpate.viewer.rerun_view import live_view

            log = stack.enter_context(live_view(set_up.scene, set_up.name, None, force, window=True))
        stop = stack.enter_context(stop_on_signals())
        state = LiveState(complain)
        stack.enter_context(live_table(f"palpate live: {set_up.name}", state))
        sources_if_unused.pop_all()  # from here on the session's threads close them
        track_live(tracker, set_up.start(), state, stop, taking, log.show if log else None, seconds)
    if json:
        print_json(state.summary())
    else:
        _report(state, record)
    return 0


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
