"""Touched frames of recordings with the labels that ground truth gives them: training samples, and presses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array, Flags, Image
from palpate.errors import FileError
from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Ellipse
from palpate.io import load_recording
from palpate.io.recording import Recording, contact_flags
from palpate.models.pushing.contact_geometry import contact_model
from palpate.pipeline.first_release import release_after_start
from palpate.touch.background import Background, background_of
from palpate.touch.calibration import AS_IT_IS, UNCORRECTED, Calibration, calibrated, mismatch
from palpate.touch.contact_detector import touched
from palpate.touch.markers import Markers, find_markers, without_markers
from palpate.touch.reader import angle_factor
from palpate.touch.touch_model import LEVELS, Difference, reduced
from palpate.types.sensor import SensorProfile
from palpate_lab.parallel import spread

Indices = NDArray[np.int_]

SHOWN = "shown_angle"
"""Field of a recording's `extra`: the angle of the contact on the tip as its images show it (N,) [rad]."""
CONTACT_ENDS = 2
"""Frames left out at each end of a contact, where the gel is not fully pressed in."""
SHORTEST_CONTACT = 5
"""Fewest frames that must be left of a contact."""
UNTOUCHED = 30
"""Most untouched frames that a background is taken from."""
# Distances of a contact from a corner [m]; a contact patch is 5 mm to either side of its middle.
_ON_CORNER = 3e-4
_AT_CORNER = 0.001
_NEAR_CORNER = 0.008
_SPREAD = 0.02  # [rad] of directions, over which a line through what images show is known

KINDS = ("disc", "ellipse", "edge", "near-corner", "corner")
"""Kinds of contact."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Touched frames, N of them, in the order of recordings and time."""

    difference: NDArray[np.float16]
    """Input of the networks, (N, ROWS, COLUMNS, 3)."""
    recording: Indices
    """Number of the recording, (N,)."""
    episode: Indices
    """Number of the contact, counted through all recordings, (N,)."""
    yaw: Array
    """Yaw of the sensor in the object frame, (N,) [rad], but for an offset of each contact as images show it."""
    direction: Array
    """Angle of the contact on the tip as images show it, (N,) [rad]; see `measurements.ContactDirection`."""
    place: Array
    """Where along y the pad is touched, (N,) [m]; see `measurements.ContactPlace`."""
    kind: Indices
    """Kind of contact, (N,), place in KINDS."""
    corner: Array
    """Angle of the contact's normal off the bisector of the corner that is touched, (N,) [rad]; NaN off corners, and
    infinite near one, where an image may show it."""
    cone: Array
    """Half the angle between the normals of that corner's sides, (N,) [rad]."""

    def __len__(self) -> int:
        return len(self.yaw)

    def of(self, chosen: Flags | Indices) -> "Samples":
        """Return some of the samples."""
        return Samples(*(getattr(self, field.name)[chosen] for field in fields(self)))


def difference(image: Image, reduced_mean: Difference) -> Difference:
    """Return the input of networks (ROWS, COLUMNS, 3): the difference of an image from a background's reduced mean.

    It is not taken in the light of the image: changes of light are drawn in training.
    """
    return (reduced(image) - reduced_mean) / np.float32(LEVELS)


def read_samples(
    files: Sequence[Path],
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
    calibration: Calibration | None = None,
    orientation: str = "",
) -> tuple[Samples, SensorProfile, dict[Path, str]]:
    """Return the samples of recordings, their sensor, and of those that have none to give the reason.

    `calibration` is of the unit that they are all of. Raises FileError if none is left or two sensors differ.
    """
    parts: dict[int, tuple[Samples, SensorProfile]] = {}
    failed: dict[Path, str] = {}
    read = partial(_read, calibration=calibration, orientation=orientation)
    for done, (index, part) in enumerate(spread(read, list(enumerate(files)), workers)):
        if isinstance(part, str):
            failed[files[index]] = part
        else:
            parts[index] = part
        if progress:
            progress(done + 1)
    if not parts:
        raise FileError(f"no recording can be learned from; the first: {next(iter(failed.values()), 'there is none')}")
    first, *others = sorted(parts)
    sensor = parts[first][1]
    for index in others:
        if parts[index][1] != sensor:
            found = f"{files[index]}: sensor {parts[index][1].name!r} is not the {sensor.name!r} of {files[first]}"
            raise FileError(f"{found}; a model is of one sensor profile")
    return _joined([parts[index][0] for index in sorted(parts)]), sensor, failed


def samples_of(recording: Recording, number: int = 0, calibration: Calibration | None = None) -> Samples:
    """Return the samples of one recording; raises FileError where it lacks what is needed.

    The calibration of its unit turns images, corrects directions and turns, and replaces missing untouched frames.
    A simulated recording states the angles at which its images show contacts.
    """
    name = recording.file or "the recording"
    recording = with_contact(recording, calibration)
    assert recording.object_pose is not None and recording.contact is not None
    view = calibration.view if calibration else AS_IT_IS

    def image(index: int) -> Image:
        touch_image = recording[index].image
        assert touch_image is not None
        return view.of(touch_image)

    background, markers = gel_at_rest(recording, image, calibration)
    mean = reduced(background.mean)
    g = se2.between(recording.object_pose, recording.sensor_pose)
    episode, frame = contact_frames(recording.contact & np.isfinite(g).all(axis=1))
    images = [without_markers(image(index), markers) for index in frame.tolist()]
    direction, place, kind, corner, cone = geometry_of(recording, g[frame])
    yaw = g[frame, 2]
    if calibration or SHOWN not in recording.extra:
        correction = calibration.direction if calibration else UNCORRECTED
        factor = angle_factor(None, calibrated(recording.sensor, calibration))
        direction = (correction.offset + correction.scale * direction) / factor
        yaw = correction.scale / factor * _unwrapped(yaw, episode)
    else:
        shown = np.asarray(recording.extra[SHOWN][frame], dtype=np.float64)
        if shown.ndim != 1 or not (np.abs(shown) <= np.pi).all():
            raise FileError(f"{name}: extra/{SHOWN} must be an angle [rad] in each frame of a contact, or not there")
        if np.ptp(direction) > _SPREAD:  # images show turns as much larger or smaller as they show directions
            yaw = float(np.polyfit(np.sin(direction), np.sin(shown), 1)[0]) * _unwrapped(yaw, episode)
        direction = shown
    seen = np.array([difference(each, mean) for each in images], dtype=np.float16).reshape(-1, *mean.shape)
    return Samples(seen, np.full(len(frame), number), episode, yaw, direction, place, kind, corner, cone)


def with_contact(recording: Recording, calibration: Calibration | None = None) -> Recording:
    """Return a recording with contact flags: its own, else those that its images show, else by truth and outline.

    Raises FileError if it has no images or no poses of the object.
    """
    name = recording.file or "the recording"
    lacks = [field for field in ("image", "object_pose") if getattr(recording, field) is None]
    if lacks:
        raise FileError(f"{name}: has no {' and no '.join(lacks)}; learning needs them")
    if recording.contact is not None:
        return recording
    if calibration is None and recording.first_pose is not None and recording.first_pose_sigma is not None:
        calibration = release_after_start(recording, recording.first_pose, recording.first_pose_sigma, "learnt")
    contact = touched(recording.image or (), recording.sensor, calibration)
    if not contact.any():
        gap = recording.sensor.gaps(recording.sensor_pose, np.asarray(recording.object_pose), recording.shape)
        contact = contact_flags(gap, touch=1.5e-3, release=2e-3)  # [m] as robot and motion capture agree
    return replace(recording, contact=contact)


def gel_at_rest(
    recording: Recording, image: Callable[[int], Image], calibration: Calibration | None = None
) -> tuple[Background, Markers | None]:
    """Return the untouched gel of a recording, else of its unit, without its markers, and these; None without."""
    name = recording.file or "the recording"
    known = calibration and calibration.background
    wrong = mismatch(calibration, recording.sensor) if calibration else None
    if wrong:
        raise FileError(f"{name}: {wrong}")
    assert recording.contact is not None
    untouched = np.flatnonzero(~recording.contact)
    if len(untouched) < 2 and known:
        markers = find_markers(known.mean)
        return replace(known, mean=without_markers(known.mean, markers)), markers
    if len(untouched) < 2:
        raise FileError(f"{name}: has {len(untouched)} frames without contact; learning needs 2 to compare with")
    chosen = untouched[np.linspace(0, len(untouched) - 1, min(UNTOUCHED, len(untouched))).astype(int)]
    images = [image(index) for index in chosen.tolist()]
    markers = find_markers(images[0])
    return background_of([without_markers(each, markers) for each in images]), markers


def _read(
    numbered: tuple[int, Path], calibration: Calibration | None, orientation: str
) -> tuple[int, tuple[Samples, SensorProfile] | str]:
    number, file = numbered
    try:
        recording = load_recording(file, orientation)
        return number, (samples_of(recording, number, calibration), recording.sensor)
    except FileError as error:
        return number, str(error)


def contact_frames(touched: Flags) -> tuple[Indices, Indices]:
    """Return number of the contact and of the frame of each frame that is well within a contact, from flags (N,)."""
    edges = np.flatnonzero(np.diff(touched, prepend=False, append=False))
    spans = [
        np.arange(first + CONTACT_ENDS, last - CONTACT_ENDS)
        for first, last in zip(edges[::2], edges[1::2], strict=True)
    ]
    spans = [span for span in spans if len(span) >= SHORTEST_CONTACT]
    if not spans:
        return np.empty(0, int), np.empty(0, int)
    return np.repeat(np.arange(len(spans)), [len(span) for span in spans]), np.concatenate(spans)


def geometry_of(recording: Recording, g: Array) -> tuple[Array, Array, Indices, Array, Array]:
    """Return from the outline, (N,) each: angle of the contact on the tip, its place along y, its kind, and the last
    two fields of `Samples`.

    g is object_T_sensor, (N, 3).
    """
    model = contact_model(recording.shape, recording.sensor)
    shape = recording.shape
    count = len(g)
    touch = model.touching(g[None])[0]
    normal = np.angle(-touch["normal"])
    kind = np.full(count, KINDS.index("edge"))
    corner = np.full(count, np.nan)
    cone = np.zeros(count)
    if isinstance(shape, Disc | Ellipse):
        kind[:] = KINDS.index("disc" if isinstance(shape, Disc) else "ellipse")
    elif len(model.corners):
        away = np.abs(
            (touch["point"] - touch["gap"] * touch["normal"])[:, None] - model.corners @ [1.0, 1.0j, 0.0, 0.0]
        )
        _, _, bisector, cone = model.corners[away.argmin(axis=1)].T
        away = away.min(axis=1)
        kind[away < _NEAR_CORNER] = KINDS.index("near-corner")
        kind[away < _AT_CORNER] = KINDS.index("corner")
        corner[away < _AT_CORNER] = np.inf
        corner = np.where(away < _ON_CORNER, se2.wrap(normal - bisector), corner)
    return se2.wrap(normal - g[:, 2]), np.imag(touch["material"]), kind, corner, cone


def _unwrapped(yaw: Array, episode: Indices) -> Array:
    """Return yaws (N,) [rad] without leaps at half a turn within a contact."""
    unwrapped = yaw.copy()
    for number in np.unique(episode):
        contact = episode == number
        unwrapped[contact] = np.unwrap(yaw[contact])
    return unwrapped


def _joined(parts: Sequence[Samples]) -> Samples:
    """All samples, with episodes numbered through."""
    counts = [int(part.episode[-1]) + 1 if len(part) else 0 for part in parts]
    first = np.cumsum([0, *counts[:-1]])
    parts = [replace(part, episode=part.episode + start) for part, start in zip(parts, first, strict=True)]
    return Samples(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Samples)))
