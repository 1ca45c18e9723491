"""`palpate truth`, `truth-print` and `truth-camera`: ground truth from an overhead camera and printed tags."""

from pathlib import Path
from typing import Annotated, Literal

from palpate.cli.console import print_line, progress_bar, report
from palpate.cli.options import Force, Json, arg, check_new


def truth_print(
    out: Annotated[Path, arg("OUT.pdf")],
    /,
    *,
    shape: Annotated[str, arg("NAME|AxB|FILE")],
    paper: Literal["a4", "a3"] = "a4",
    force: Force = False,
) -> int:
    """Write the sheets to print for ground truth: tags for table, object and sensor, and a calibration board.

    Example: palpate truth-print sheets.pdf --shape rectangle --paper a3

    Args:
        out: The file to write.
        shape: The object, as in palpate simulate.
        paper: Paper size.
    """
    from palpate.io.outlines import load_shape
    from palpate.lab.truth.tags import write_sheets

    check_new(out, force)
    write_sheets(out, Path(shape).name, load_shape(shape), paper, force)
    print_line(f"{out}: print it at 100 % and measure the line of 100 mm")
    return 0


def truth_camera(
    video: Annotated[Path, arg("VIDEO")], /, *, out: Annotated[Path, arg("CAMERA.json")], force: Force = False
) -> int:
    """Calibrate the overhead camera by a video of the printed board, held at an angle all over the view.

    Example: palpate truth-camera board.mp4 --out camera.json

    Args:
        video: A video file.
        out: The file to write.
    """
    from palpate.lab.truth.camera import calibrated, read_video, save_camera

    check_new(out, force)
    with progress_bar(f"looking for the board in {video.name}"):
        camera = calibrated(picture for _, picture in read_video(video))
    save_camera(camera, out, force)
    print_line(f"{out}: reprojection error {camera.error:.2f} px; half a pixel or less is good")
    return 0


def truth(
    recording: Annotated[Path, arg("RECORDING")],
    video: Annotated[Path, arg("VIDEO")],
    /,
    *,
    camera: Annotated[Path, arg("CAMERA.json")],
    out: Annotated[Path, arg("OUT.mcap")],
    force: Force = False,
    json: Json = False,
) -> int:
    """Put ground truth into a recording, from a video of the push with tags on table, object and sensor.

    Example: palpate truth push.mcap push.mp4 --camera camera.json --out push-true.mcap

    Args:
        recording: The robot's recording of the push.
        video: A video of the same push.
        camera: The camera, from palpate truth-camera.
        out: The recording with ground truth.
    """
    import numpy as np

    from palpate.files import in_file
    from palpate.io import load_recording
    from palpate.io.recording_mcap import write_recording
    from palpate.lab.truth.alignment import align, with_truth
    from palpate.lab.truth.camera import load_camera, read_video, track_tags

    check_new(out, force)
    given, overhead = load_recording(recording), load_camera(camera)
    with progress_bar(f"looking for tags in {video.name}"), in_file(video):
        tag_on_object, tag_on_sensor = track_tags(read_video(video), overhead)
        alignment = align(given.time, given.sensor_pose, tag_on_sensor)
    found = with_truth(given, tag_on_object, alignment)
    write_recording(found, out, overwrite=force)
    assert found.object_pose is not None
    summary = {
        "frames": len(found),
        "with_truth": int(np.isfinite(found.object_pose).all(axis=1).sum()),
        "delay_s": alignment.delay,
        "delay_sigma_s": float(alignment.sigma[3]),
        "object_height_mm": tag_on_object.height * 1e3,
        "sensor_height_mm": tag_on_sensor.height * 1e3,
        "residual_mm": alignment.residual * 1e3,
        "table_sigma_mm": float(alignment.sigma[:2].max() * 1e3),
        "file": str(out),
    }
    report(json, "truth", summary)
    return 0
