"""A run as one HTML page that needs no other file and no network: the push, played, with touch images and plots."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.files import whole_file
from palpate.geometry.distance_field import DistanceField
from palpate.geometry.se2 import half_axes_95
from palpate.pipeline.metrics import deviations, rotation_errors, translation_errors
from palpate.pipeline.track import Run
from palpate.viewer import colours
from palpate.viewer.scene import contact_points, jpeg, touch_images
from palpate.web_page import picture_uri, rendered_page

Array = NDArray[np.float64]

TEMPLATE = Path(__file__).with_name("page.html.j2")


@dataclass(frozen=True)
class PageLimits:
    """Limits that keep a page below 5 MB."""

    frames: int = 3000
    """Frames, to which longer runs are thinned."""
    pictures: int = 600
    """Touch images, likewise."""
    picture_bytes: int = 2_700_000
    """Size of all touch images together [B]."""
    picture_width: int = 160
    """Width of a touch image [px]."""


LIMITS = PageLimits()


def write_page(run: Run, name: str, path: Path, force: bool = False) -> None:
    """Write the page of a run, whole or not at all; FileError if it exists, unless `force`."""
    with whole_file(path, overwrite=force) as part:
        part.write_text(
            rendered_page(TEMPLATE, name=name, summary=run.summary, colours=colours, data=_json(page_data(run))),
            encoding="utf-8",
        )


def page_data(run: Run) -> dict[str, Any]:
    """Return the data of the page: lengths in mm, yaw in rad, errors of yaw in degrees; None where unknown."""
    online, recording = run.online, run.recording
    assert online.covariance is not None and online.contact is not None and online.status is not None
    frames = np.arange(0, len(online), -(-len(online) // LIMITS.frames))
    pose, sensor, covariance = online.pose[frames], recording.sensor_pose[frames], online.covariance[frames]
    truth = np.full_like(pose, np.nan) if run.truth is None else run.truth[frames]
    distance, angle = deviations(covariance)
    points = contact_points(sensor, pose, recording.sensor, DistanceField.of(recording.shape))
    points[~online.contact[frames]] = np.nan
    return {
        "time": _rounded(online.time[frames] - online.time[0], 3),
        "outline": _millimetres(recording.shape.closed_outline),
        "pads": [_millimetres(pad) for pad in recording.sensor.pads],
        "estimate": _poses(pose),
        "truth": _poses(truth),
        "sensor": _poses(sensor),
        "halfAxes": _millimetres(half_axes_95(covariance)),
        "contact": _millimetres(points),
        "others": {
            str(place): _poses(np.array([one.pose for one in run.answers[frame][1:]]))
            for place, frame in enumerate(frames)
            if run.answers[frame]
        },
        "translation": {
            "error": _rounded(1e3 * translation_errors(pose, truth), 3),
            "sigma": _rounded(1e3 * distance, 3),
        },
        "rotation": {
            "error": _rounded(np.degrees(np.abs(rotation_errors(pose, truth))), 3),
            "sigma": _rounded(np.degrees(angle), 3),
        },
        "friction": {
            "value": _rounded(run.friction[frames, 0], 4),
            "sigma": _rounded(run.friction[frames, 1], 4),
        },
        "status": [online.status[frame] for frame in frames],
        "statusColours": colours.STATUS,
        "pictures": _pictures(run),
    }


def _pictures(run: Run) -> list[dict[str, Any]]:
    """Return small touch images and their differences from the untouched gel, as many as there is room for."""
    recording = run.recording
    if recording.image is None:
        return []
    every = -(-len(recording) // LIMITS.pictures)
    images = enumerate(zip(recording.time, touch_images(recording, run.calibration), strict=True))
    width = LIMITS.picture_width
    taken = [
        (float(time - recording.time[0]), jpeg(image, width), None if difference is None else jpeg(difference, width))
        for index, (time, (image, difference)) in images
        if index % every == 0
    ]
    while sum(len(touch) + len(model or b"") for _, touch, model in taken) > LIMITS.picture_bytes:
        taken = taken[::2]
    return [
        {"time": round(time, 3), "touch": picture_uri(touch), "model": None if model is None else picture_uri(model)}
        for time, touch, model in taken
    ]


def _poses(pose: Array) -> list[Any]:
    """Return poses (N, 3) in mm and rad, None for unknown ones."""
    return [None if np.isnan(each).any() else [*_rounded(1e3 * each[:2], 2), round(float(each[2]), 5)] for each in pose]


def _millimetres(points: Array) -> list[Any]:
    return _rounded(1e3 * points, 2)


def _rounded(values: Array, digits: int) -> list[Any]:
    """Return nested lists of rounded numbers, None for NaN."""
    rounded = np.round(np.asarray(values, dtype=np.float64), digits)
    numbers = rounded.astype(object)
    numbers[np.isnan(rounded)] = None
    return numbers.tolist()


def _json(data: dict[str, Any]) -> str:
    """Return JSON that is safe inside a script element."""
    import markupsafe

    text = json.dumps(data, allow_nan=False, separators=(",", ":"), ensure_ascii=False)
    return markupsafe.Markup(text.replace("<", "\\u003c"))
