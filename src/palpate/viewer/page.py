"""A run on one page that needs no other file and no network: the push, to be played, with touch and plots."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.files import whole_file
from palpate.geometry.distance_field import DistanceField
from palpate.geometry.lines import closed_outline, half_axes_95
from palpate.pipeline.metrics import deviations, rotation_errors, translation_errors
from palpate.pipeline.run import Run
from palpate.viewer import colours
from palpate.viewer.geometry import contact_points
from palpate.viewer.images import jpeg, views
from palpate.web_page import picture_uri, rendered_page

Array = NDArray[np.float64]

TEMPLATE = Path(__file__).with_name("page.html.j2")
_MOST_FRAMES = 3000
_MOST_PICTURES = 600
_PICTURES_SIZE = 2_700_000  # [B] of all pictures together
_WIDTH = 160  # [px] of a picture


def write_page(run: Run, name: str, path: Path, force: bool = False) -> None:
    """Write the page of a run, whole or not at all; FileError if it exists, unless `force`.

    Long runs are thinned to some thousand frames and some hundred touch images, which keeps the page below 5 MB.
    """
    with whole_file(path, overwrite=force) as part:
        part.write_text(
            rendered_page(TEMPLATE, name=name, summary=run.summary, colours=colours, data=_json(page_data(run))),
            encoding="utf-8",
        )


def page_data(run: Run) -> dict[str, Any]:
    """Return what the page draws, as plain data: mm, yaw of poses in rad, errors in degrees; None where unknown."""
    online, recording = run.online, run.recording
    assert online.covariance is not None and online.contact is not None and online.status is not None
    frames = np.arange(0, len(online), -(-len(online) // _MOST_FRAMES))
    pose, sensor, covariance = online.pose[frames], recording.sensor_pose[frames], online.covariance[frames]
    truth = np.full_like(pose, np.nan) if run.truth is None else run.truth[frames]
    distance, angle = deviations(covariance)
    points = contact_points(sensor, pose, recording.sensor, DistanceField.of(recording.shape))
    points[~online.contact[frames]] = np.nan
    return {
        "time": _rounded(online.time[frames] - online.time[0], 3),
        "outline": _millimetres(closed_outline(recording.shape)),
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
    """Touch images, small, and what the model saw of each, at as many times as there is room for."""
    recording = run.recording
    if recording.image is None:
        return []
    every = -(-len(recording) // _MOST_PICTURES)
    taken = [
        (float(time - recording.time[0]), jpeg(image, _WIDTH), None if model is None else jpeg(model, _WIDTH))
        for index, (time, (image, model)) in enumerate(
            zip(recording.time, views(recording, run.calibration), strict=True)
        )
        if index % every == 0
    ]
    while sum(len(touch) + len(model or b"") for _, touch, model in taken) > _PICTURES_SIZE:
        taken = taken[::2]
    return [
        {"time": round(time, 3), "touch": picture_uri(touch), "model": None if model is None else picture_uri(model)}
        for time, touch, model in taken
    ]


def _poses(pose: Array) -> list[Any]:
    """Poses (..., 3) in mm and rad, None for those that are not known."""
    return [None if np.isnan(each).any() else [*_rounded(1e3 * each[:2], 2), round(float(each[2]), 5)] for each in pose]


def _millimetres(points: Array) -> list[Any]:
    return _rounded(1e3 * points, 2)


def _rounded(values: Array, digits: int) -> list[Any]:
    """Nested lists of numbers, None for what is not known."""
    rounded = np.round(np.asarray(values, dtype=np.float64), digits)
    numbers = rounded.astype(object)
    numbers[np.isnan(rounded)] = None
    return numbers.tolist()


def _json(data: dict[str, Any]) -> str:
    """JSON that may stand in a script element, whatever it says."""
    import markupsafe

    text = json.dumps(data, allow_nan=False, separators=(",", ":"), ensure_ascii=False)
    return markupsafe.Markup(text.replace("<", "\\u003c"))
