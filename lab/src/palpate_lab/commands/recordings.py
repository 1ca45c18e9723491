"""`palpate simulate` and `truth`: recordings of a simulated sensor, and ground truth by a camera and printed tags."""

from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

import palpate
from palpate.cli.console import Report, complain, progress_bar
from palpate.cli.options import Force, Sensor, Workers, arg
from palpate.cli.quantities import TIME, quantities
from palpate.errors import SettingError
from palpate.files import in_file, new_file
from palpate.types.choices import Unit


@dataclass(frozen=True)
class Pushes:
    """The pushes to simulate."""

    shape: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        arg(
            "NAME|AxB|FILE",
            "disc, rectangle and ellipse",
            help="Object: disc, rectangle, ellipse, triangle, hexagon, t, butterfly, rounded-square, the sides of a "
            "rectangle such as 0.09x0.06 [m], or an outline in a file. Repeat for more.",
        ),
    ] = ()
    shape_unit: Annotated[Unit | None, arg(default="m, or the unit of the drawing")] = None
    """Unit of the numbers in --shape."""
    count: Annotated[int, arg("N")] = 10
    """Recordings of each object."""
    seconds: Annotated[float, quantities("--seconds", "S", TIME), arg("S", "15")] = 15.0
    """Length of a recording [s]."""
    knocks: bool = False
    """A finger shoves the object now and then, unknown to the sensor."""
    ideal: bool = False
    """State mounting, outline, time and first pose exactly, as no real set-up does; gel and light stay constant."""
    sensor: Sensor = "digit"
    fingers: int = 1
    """Fingers of the hand that pushes, each with images of its own: 1 to 3. With --replay, its tips as fingers."""
    pinch: bool = False
    """Two fingers hold the object between them and slide it over the table, in place of pushing it."""
    images: Annotated[bool, arg(default="with images")] = True
    """Make no touch images, which is faster."""

    def simulations(self, seed: int, unit: int | None) -> dict[str, Any]:
        """Return the simulations by file name. Raises SettingError."""
        from palpate.geometry.named_shapes import SHAPES
        from palpate.types.sensor_file import known_sensor
        from palpate_lab.simulate.hand_recordings import HandSimulation
        from palpate_lab.simulate.recordings import Simulation, plan

        shapes = {}
        for given in self.shape or ("disc", "rectangle", "ellipse"):
            name = Path(given).stem if Path(given).is_file() and given not in SHAPES else given
            if name in shapes:
                raise SettingError(f"--shape {given}: {name!r} is given twice; each shape needs a name of its own")
            shapes[name] = palpate.load_shape(given, self.shape_unit)
        options: dict[str, Any] = {name: getattr(self, name) for name in ("seconds", "images", "knocks", "ideal")}
        options["made"] = Simulation
        if self.pinch or self.fingers != 1:
            options |= {"made": HandSimulation, "fingers": self.fingers, "pinch": self.pinch}
        return plan(shapes, self.count, seed, unit=unit, sensor=known_sensor(self.sensor), **options)


def simulate(
    folder: Annotated[Path, arg("DIR")],
    /,
    *,
    pushes: Pushes = Pushes(),
    replay: Annotated[tyro.conf.UseAppendAction[tuple[Path, ...]], arg("FILE", "none")] = (),
    seed: Annotated[int, arg("N")] = 0,
    unit: Annotated[int | None, arg("N", "another unit for each")] = None,
    shard: Annotated[str | None, arg("K/N", "all")] = None,
    resume: bool = False,
    workers: Workers = Workers(),
) -> Report:
    """Simulate recordings of a sensor that pushes objects: poses, touch images, contacts and forces.

    Example: palpate simulate recordings --shape disc --count 20 --knocks

    Args:
        folder: Folder of the recordings.
        replay: Render touch images for the motion of a real recording instead. Repeat for more.
        seed: The same seed gives the same files.
        unit: Seed of one sensor unit on one robot for all recordings, with one mounting, outline error and delay.
        shard: Make every Nth recording from the Kth on, as one of N machines.
        resume: Keep the recordings that are there and make the rest.
    """
    from palpate_lab.simulate.recordings import SUFFIX, fill_folder

    if replay:
        items: Any = {
            Path(file.name.removesuffix(".gz")).stem + SUFFIX: _replay(file, pushes, seed, unit) for file in replay
        }
        if len(items) < len(replay):
            raise SettingError("--replay: files of one name would give one file; replay them apart")
    else:
        items = pushes.simulations(seed, unit)
        first, _, machines = (shard or "1/1").partition("/")
        if not (first.isdecimal() and machines.isdecimal() and 1 <= int(first) <= int(machines)):
            raise SettingError(f"--shard is {shard!r}; allowed is K/N, the Kth of N parts, such as 1/4")
        items = dict(list(items.items())[int(first) - 1 :: int(machines)])
    with progress_bar("rendering" if replay else "simulating", len(items)) as progress:
        made, kept, failed = fill_folder(folder, items, workers.workers, resume, workers.dask, progress)
    for name, why in failed.items():
        complain(why if replay else f"{folder / name}: {why}")  # the error of a replay names the file that was read
    files = {"made": made, "kept": kept, "failed": [{"file": name, "error": why} for name, why in failed.items()]}
    return Report("recordings", {"folder": str(folder), **files}, code=3 if failed else 0)


def _replay(file: Path, pushes: Pushes, seed: int, unit: int | None) -> Any:
    """Return the replay of a recording, of which options of pushes say the number of fingers alone."""
    from palpate_lab.simulate.hand_replay import HandReplay
    from palpate_lab.simulate.replay import Replay

    if replace(pushes, fingers=1) != Pushes():
        raise SettingError(
            "--replay takes object and motion from its file; no options of pushes can go with it but --fingers"
        )
    recording = palpate.load_recording(file)
    return Replay(recording, seed, unit) if pushes.fingers == 1 else HandReplay(recording, seed, unit, pushes.fingers)


def truth_print(
    out: Annotated[Path, arg("OUT.pdf")],
    /,
    *,
    shape: Annotated[str, arg("NAME|AxB|FILE")],
    paper: Literal["a4", "a3"] = "a4",
    force: Force = False,
) -> Report:
    """Write the sheets to print for ground truth: tags for table, object and sensor, and a calibration board.

    Example: palpate truth-print sheets.pdf --shape rectangle --paper a3

    Args:
        out: The file to write.
        shape: The object, as in palpate simulate.
        paper: Paper size.
    """
    from palpate_lab.truth.tags import write_sheets

    new_file(out, force)
    write_sheets(out, Path(shape).name, palpate.load_shape(shape), paper, force)
    return Report("sheets", {"file": str(out)}, notes=["Print them at 100 % and measure the line of 100 mm."])


def truth_camera(
    video: Annotated[Path, arg("VIDEO")], /, *, out: Annotated[Path, arg("CAMERA.json")], force: Force = False
) -> Report:
    """Calibrate the overhead camera by a video of the printed board, held at an angle all over the view.

    Example: palpate truth-camera board.mp4 --out camera.json

    Args:
        video: A video file.
        out: The file to write.
    """
    from palpate_lab.truth.camera import calibrated, read_video, save_camera

    new_file(out, force)
    with progress_bar(f"looking for the board in {video.name}"):
        camera = calibrated(picture for _, picture in read_video(video))
    save_camera(camera, out, force)
    data = {"file": str(out), "reprojection_error_px": camera.error}
    return Report("camera", data, notes=["Half a pixel or less is good."])


def truth(
    recording: Annotated[Path, arg("RECORDING")],
    video: Annotated[Path, arg("VIDEO")],
    /,
    *,
    camera: Annotated[Path, arg("CAMERA.json")],
    out: Annotated[Path, arg("OUT.mcap")],
    force: Force = False,
) -> Report:
    """Put ground truth into a recording, from a video of the push with tags on table, object and sensor.

    Example: palpate truth push.mcap push.mp4 --camera camera.json --out push-true.mcap

    Args:
        recording: The robot's recording of the push.
        video: A video of the same push.
        camera: The camera, from palpate truth-camera.
        out: The recording with ground truth.
    """
    from palpate_lab.truth.alignment import align, with_truth
    from palpate_lab.truth.camera import load_camera, read_video, track_tags

    new_file(out, force)
    given = palpate.load_recording(recording)
    overhead = load_camera(camera)
    with progress_bar(f"looking for tags in {video.name}"), in_file(video):
        tag_on_object, tag_on_sensor = track_tags(read_video(video), overhead)
        alignment = align(given.time, given.sensor_pose, tag_on_sensor)
    with_poses = with_truth(given, tag_on_object, alignment)
    palpate.write_recording(with_poses, out, overwrite=force)
    summary = {
        "frames": len(with_poses),
        "with_truth": sum(map(isfinite, with_poses.truth[:, 0])),
        "delay_s": alignment.delay,
        "delay_sigma_s": float(alignment.sigma[3]),
        "object_height_mm": tag_on_object.height * 1e3,
        "sensor_height_mm": tag_on_sensor.height * 1e3,
        "residual_mm": alignment.residual * 1e3,
        "table_sigma_mm": float(alignment.sigma[:2].max() * 1e3),
        "file": str(out),
    }
    return Report("truth", summary)
