"""`palpate live`: tracks as it happens, shows it and records it."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

from palpate.cli.console import complain, print_line, progress_bar, report
from palpate.cli.options import Bag, Force, Json, Start, Touch, arg, check_new
from palpate.errors import SettingError


def live(
    *,
    camera: Annotated[str | None, arg("SERIAL|N|PATH", "none; or --replay")] = None,
    poses: Annotated[str | None, arg("udp:PORT", "none; --camera needs it")] = None,
    replay: Annotated[Path | None, arg("FILE", "none; or --camera")] = None,
    record: Annotated[Path | None, arg("OUT.mcap", "none")] = None,
    seconds: Annotated[float | None, arg("S", "until Ctrl-C")] = None,
    force: Force = False,
    json: Json = False,
    start: Start = Start(),
    touch: Touch = Touch(),
    bag: Bag = Bag(),
) -> int:
    """Track as it happens: the newest image with the sensor's pose at its time; Ctrl-C ends it.

    A line shows status and pose; images that arrive faster than they are tracked are dropped and counted.

    Example: palpate live --camera D20001 --poses udp:5005 --shape rectangle --first-pose 0.1 0 0.3

    Args:
        camera: Camera of a DIGIT, or a video or a folder of images in its place.
        poses: Sensor poses: JSON by UDP on this machine.
        replay: A recording or a bag, played in real time.
        record: Record images, sensor poses and estimates; a kill loses at most the last second.
        seconds: End after this time [s].
    """
    from palpate.config import NoiseSettings, TrackerSettings
    from palpate.io.outlines import load_shape
    from palpate.live.camera import camera_sources
    from palpate.live.recorder import recorder
    from palpate.live.session import LiveSession, stop_on_signals
    from palpate.live.sources import replayed
    from palpate.pipeline.metrics import pose_words, world_sigma
    from palpate.pipeline.track import first_pose_of
    from palpate.touch.calibration import turned_as
    from palpate.tracker import Tracker
    from palpate.types.estimate import Estimate
    from palpate.types.sensor import DIGIT
    from palpate.types.space import GelPoses, Placement

    if touch.tactile == "oracle":
        raise SettingError("--tactile oracle needs ground truth, which is unknown live")
    if seconds is not None and not seconds > 0.0:
        raise SettingError(f"--seconds is {seconds:g}; allowed is a time above 0 [s]")
    if (camera is None) == (replay is None) or (camera is None) != (poses is None):
        raise SettingError("live takes either --camera with --poses, or --replay FILE")
    if record:
        check_new(record, force)
    first: Any
    first, sigma = start.pose_and_sigma()
    model, unit = touch.load(touch.tactile)
    with ExitStack() as stack:
        if camera and poses:
            if bag.shape is None or first is None:
                raise SettingError("--camera needs --shape NAME|FILE, --first-pose X Y THETA or --first-pose-unknown")
            taken = ("shape", "shape_unit", "orientation", "sensor_T_gel", "time_offset", "plane")
            if bag.plane == "fit" or bag != Bag(**{name: getattr(bag, name) for name in taken}):
                words = ", ".join(f"--{name.replace('_', '-')}" for name in taken)
                raise SettingError(f"--camera: of the options for bags, only {words} X Y Z apply")
            if not abs(bag.time_offset) <= 1.0:
                raise SettingError(f"--time-offset is {bag.time_offset:g}; allowed are -1 to 1 s")
            name, shape = f"camera {camera}", load_shape(bag.shape, bag.shape_unit)
            place = GelPoses(Placement(sensor_T_gel=bag.sensor_T_gel, plane=bag.plane))
            opened = camera_sources(camera, poses, turned_as(DIGIT, unit), place, bag.orientation, bag.time_offset)
            with progress_bar("looking for images and poses"):
                sources = stack.enter_context(opened)
        else:
            assert replay is not None
            name, (recording, _) = replay.name, bag.read(replay)
            shape, sources = recording.shape, replayed(recording)
            first, sigma = first_pose_of(recording, NoiseSettings(), first, sigma)
        settings = TrackerSettings(touch.tactile)
        sensor = turned_as(sources.sensor, unit)
        tracker = Tracker(shape, sensor, first, settings, model, unit, first_pose_sigma=sigma)
        keep = record and stack.enter_context(recorder(record, shape, sources.sensor, force))
        stop = stack.enter_context(stop_on_signals())
        session = LiveSession(tracker, sources, complain)
        bar = stack.enter_context(progress_bar(name))

        def listen(item: Any) -> None:
            if keep:
                keep(item)
            if isinstance(item, Estimate):
                words = pose_words(item.pose, world_sigma(item.pose, item.covariance))
                bar(session.counts["tracked"], f"{item.status} {item.reason} {words}")

        session.run(stop, listen, float("inf") if seconds is None else seconds)
    report(json, "live", session.summary())
    if record and not json:
        print_line(f"recorded: {record}")
    return 0
