"""`palpate live`: tracks as it happens, shows it and records it."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from palpate.cli.console import busy, complain, print_line, report
from palpate.cli.options import Bag, Force, Json, Start, Touch, arg, check_new
from palpate.errors import SettingError

if TYPE_CHECKING:
    from rich.table import Table

    from palpate.live.session import LiveState
    from palpate.live.sources import Sources
    from palpate.touch.calibration import Calibration
    from palpate.types.recording import Recording


@dataclass(frozen=True)
class Source:
    """Images and sensor poses: of a camera, or of a recording."""

    camera: Annotated[str | None, arg("SERIAL|PATH|N", "none; or --replay")] = None
    """Camera of a DIGIT."""
    poses: Annotated[str | None, arg("udp:PORT|ros2:TOPIC|NAME", "none; --camera needs it")] = None
    """Sensor poses: JSON by UDP on this machine, a ROS 2 topic, or an entry point of palpate.poses."""
    replay: Annotated[Path | None, arg("FILE", "none; or --camera")] = None
    """A recording or a bag, played in real time."""

    def open(
        self, stack: ExitStack, bag: Bag, start: Start, calibration: "Calibration | None"
    ) -> "tuple[Sources, Recording, tuple[Any, Any]]":
        """Return the sources, a recording that says what is tracked, and the first pose with its sigma.

        `stack` closes the sources.
        """
        import numpy as np

        from palpate.config import NoiseSettings
        from palpate.io.outlines import load_shape
        from palpate.live.camera import camera_sources
        from palpate.live.sources import replayed
        from palpate.pipeline.track import first_pose_of
        from palpate.types.recording import Recording
        from palpate.types.sensor import DIGIT

        first, sigma = start.pose_and_sigma()
        if (self.camera is None) == (self.replay is None) or (self.camera is None) != (self.poses is None):
            raise SettingError("live takes either --camera with --poses, or --replay FILE")
        if self.replay is not None:
            recording, _ = bag.read(self.replay)
            return replayed(recording), recording, first_pose_of(recording, NoiseSettings(), first, sigma)
        assert self.camera is not None and self.poses is not None
        if bag.shape is None or first is None:
            raise SettingError("--camera needs --shape NAME|FILE, and --first-pose X Y THETA or --first-pose-unknown")
        if bag != Bag(shape=bag.shape, shape_unit=bag.shape_unit):
            raise SettingError("--camera: of the options for bags, only --shape and --shape-unit can be used")
        shape = load_shape(bag.shape, bag.shape_unit)
        sources = stack.enter_context(camera_sources(self.camera, self.poses, DIGIT, calibration))
        return sources, Recording(np.zeros(1), np.array([first]), shape, DIGIT, image=(b"",)), (first, sigma)


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
        view: Show the session in Rerun too.
        seconds: End after this time [s].
    """
    from palpate.config import TrackerSettings
    from palpate.live.recorder import recorder
    from palpate.live.session import LiveState, stop_on_signals, track_live
    from palpate.tracker import Tracker

    if touch.tactile == "oracle":
        raise SettingError("--tactile oracle needs ground truth, which is unknown live")
    if seconds is not None and not seconds > 0.0:
        raise SettingError(f"--seconds is {seconds:g}; allowed is a time above 0 [s]")
    if view:
        from palpate.viewer.rerun_view import has_display

        if not has_display():
            raise SettingError("--view: there is no display to open a window on")
    if record:
        check_new(record, force)
    model, unit = touch.load(touch.tactile)
    name = source.replay.name if source.replay else f"camera {source.camera}"
    with ExitStack() as stack:
        with busy("looking for images and poses"):
            sources, scene, (first, sigma) = source.open(stack, bag, start, unit)
        settings = TrackerSettings(touch.tactile)
        tracker = Tracker(scene.shape, sources.sensor, first, settings, model, unit, first_pose_sigma=sigma)
        listen = watch = None
        if record:
            listen = stack.enter_context(recorder(record, scene.shape, sources.recorded_sensor, force))
        if view:
            from palpate.viewer.rerun_view import live_view

            watch = stack.enter_context(live_view(scene, name))
        stop = stack.enter_context(stop_on_signals())
        state = LiveState(complain)
        stack.enter_context(live_table(f"palpate live: {name}", state))
        track_live(tracker, sources, state, stop, listen or (lambda item: None), watch, seconds)
    report(json, "live", state.summary())
    if record and not json:
        print_line(f"recorded: {record}")
    return 0


@contextmanager
def live_table(title: str, state: "LiveState") -> Iterator[None]:
    """Show the table on standard error while the block runs; nothing is shown where that is no terminal."""
    from rich.console import Console
    from rich.live import Live

    console = Console(stderr=True, force_terminal=sys.stderr.isatty())  # FORCE_COLOR would ask for a table in a file
    if not console.is_terminal:
        yield
        return
    with Live(get_renderable=lambda: table_of(title, state), console=console, refresh_per_second=5, transient=True):
        yield


def table_of(title: str, state: "LiveState") -> "Table":
    """Return the table of a session as it stands."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from palpate.pipeline.metrics import pose_words, world_sigma

    table = Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, show_header=False)
    table.add_column(style="dim")
    table.add_column(min_width=60, overflow="fold")
    rate, counts = state.rate, state.counts
    seen = f"{counts['tracked']} tracked, {counts['dropped']} dropped, {counts['without_pose']} without a pose"
    rows = {"images": f"{'-' if rate is None else f'{rate:.1f}'} Hz; {seen}"}
    rows |= dict.fromkeys(("latency", "contact", "status", "object"), "-")
    rows["sensor poses"] = f"{counts['refused_poses']} refused"
    if state.last:
        one, recent = state.last.estimate, state.latency_ms(600)
        rows["latency"] = f"{recent['p50']:.1f} ms, 99 %: {recent['p99']:.1f} ms"
        rows["contact"] = "yes" if one.contact else "no"
        rows["status"] = f"{one.status}{one.reason and f': {one.reason}'}"
        rows["object"] = pose_words(one.pose, world_sigma(one.pose, one.covariance))
    for name, words in rows.items():
        table.add_row(name, words)
    return table
