"""Traces: the estimates of some seventy recordings, frame by frame, as they were before the package was rebuilt.

    python scripts/traces.py make FOLDER [NAME ...]       # all of them, a file each
    python scripts/traces.py check [--exact] [NAME ...]   # against tests/traces; exit 1 where one is off

Which recordings they are is in `traced.py`; a checksum tells where one is not the same as it was. Comparing allows what
another processor or another BLAS makes of the same code; `--exact` allows nothing. A trace is sensitive from the frame
on at which sensor poses that are moved by 1e-13 move estimates by more than 1e-6: where it differs from there on is
told, and counts with `--exact` alone.
"""

import argparse
import logging
import sys
import zlib
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from traced import CASES, ROOT, SHARED, Array, Given

from palpate import EstimationError, FrameError, Tracker

TRACES = ROOT / "tests/traces"
NEAR = 1e-6
"""[m], [rad] by which poses may differ."""
NEAR_BY_IMAGES = 1e-5
"""The same for recordings with images: the networks that read them compute with single precision."""
NUDGE = 1e-13
"""[m], [rad] by which sensor poses are moved to find out where a trace is sensitive."""
TO_ONE = 1e-2
"""Factor on relative differences that makes them comparable with those of poses."""

Trace = dict[str, NDArray[Any]]
"""At N frames: pose (N, 3), covariance (N, 6) above its diagonal, status (N,), which are places among `names`, and
count (N,) of answers; of all answers in a row pose and weight (M, 4). A frame that was refused has NaN and no answers.
Besides `inputs`, a checksum of times, sensor poses and images; `by_images`, whether there are any; `sensitive_from`."""


def made(name: str) -> Trace:
    """Make a trace, and find out from which frame on it is sensitive."""
    given = CASES[name].given(CASES[name].recording())
    trace = tracked(given)
    off = [difference(tracked(given, nudge), trace, NEAR).off for nudge in (NUDGE, -NUDGE)]
    return trace | {"sensitive_from": np.array(np.argmax([*np.any(off, axis=0), True]))}


def tracked(given: Given, nudge: float = 0.0) -> Trace:
    """Track frame by frame, with sensor poses moved by normal noise of this size [m], [rad]."""
    shape = given.recording.shape
    sensor = given.recording.sensor
    rng = np.random.default_rng(3)
    how = {"calibration": given.calibration, "first_pose_sigma": given.first_pose_sigma}
    tracker = Tracker(shape, sensor, given.first_pose, given.settings, **how)
    rows: list[tuple[Any, ...]] = []
    inputs = 0
    for frame, said in zip(given.frames, given.said or repeat((), len(given.frames)), strict=True):
        for part in (np.array(frame.time), frame.sensor_pose, frame.image):
            inputs = inputs if part is None else zlib.crc32(part.tobytes(), inputs)
        try:
            moved = replace(frame, sensor_pose=frame.sensor_pose + nudge * rng.normal(size=3))
            estimate = tracker.update(moved, said)
            rows.append((estimate.pose, estimate.covariance, estimate.status, estimate.answers))
        except EstimationError as error:
            word = "refused" if isinstance(error, FrameError) else "failed"
            rows.append((np.full(3, np.nan), np.full((3, 3), np.nan), word, ()))
    pose, covariance, status, answers = zip(*rows, strict=True)
    names, places = np.unique(status, return_inverse=True)
    return {
        "pose": np.array(pose),
        "covariance": np.array(covariance)[:, *np.triu_indices(3)],
        "status": places.astype(np.int8),
        "names": names,
        "count": np.array([len(each) for each in answers], np.int8),
        "answers": np.array([(*one.pose, one.weight) for each in answers for one in each]).reshape(-1, 4),
        "inputs": np.array(inputs),
        "by_images": np.array(given.recording.image is not None),
    }


@dataclass(frozen=True, eq=False)
class Difference:
    """Differences of two traces at N frames, and flags of frames where they are larger than allowed."""

    metres: Array
    radians: Array
    covariance: Array
    """Relative to the standard deviations of both coordinates."""
    status: NDArray[np.bool_]
    answers: NDArray[np.bool_]
    off: NDArray[np.bool_]


def difference(found: Trace, stored: Trace, tolerance: float) -> Difference:
    """Compare two traces of one recording, where poses may differ by a tolerance [m], [rad]."""
    assert len(found["pose"]) == len(stored["pose"]), "the recordings differ in length"
    metres, radians = _apart(found["pose"], stored["pose"])
    deviation = np.sqrt(stored["covariance"][:, [0, 3, 5]])
    size = (deviation[:, :, None] * deviation[:, None])[:, *np.triu_indices(3)]
    covariance = np.nan_to_num(np.abs(found["covariance"] - stored["covariance"]) / size).max(axis=1)
    status = found["names"][found["status"]] != stored["names"][stored["status"]]
    pairs = zip(_by_frame(found), _by_frame(stored), strict=True)
    answers = np.array([not _are_same(ours, theirs, tolerance) for ours, theirs in pairs])
    off = np.max([metres, radians, TO_ONE * covariance], axis=0) > tolerance
    return Difference(metres, radians, covariance, status, answers, off | status | answers)


def _apart(pose: Array, other: Array) -> tuple[Array, Array]:
    """Distances [m] and angles [rad] between poses (..., 3); 0 where a frame was refused."""
    off = np.nan_to_num(pose - other)
    return np.hypot(off[..., 0], off[..., 1]), np.abs(np.angle(np.exp(1j * off[..., 2])))


def _by_frame(trace: Trace) -> list[Array]:
    """Answers (K, 4) of each frame."""
    return np.split(trace["answers"], np.cumsum(trace["count"])[:-1])


def _are_same(ours: Array, theirs: Array, tolerance: float) -> bool:
    """Say whether answers (K, 4) are the same, in any order, as rounding decides it for equal weights."""
    if len(ours) != len(theirs) or not tolerance:
        return np.array_equal(ours, theirs)
    weights = TO_ONE * np.abs(ours[:, None, 3] - theirs[:, 3])
    near = np.max([*_apart(ours[:, None], theirs), weights], axis=0) <= tolerance
    return bool(near.any(axis=0).all() and near.any(axis=1).all())


@dataclass(frozen=True)
class Checked:
    """A trace that was made again."""

    difference: Difference
    remarks: tuple[str, ...]
    is_off: bool

    def line(self, name: str) -> str:
        """Return a row of the table."""
        apart = self.difference
        sizes = "".join(f"{np.max(each):<10.1e}" for each in (apart.metres, apart.radians, apart.covariance))
        counts = f"{np.sum(apart.status):6}{np.sum(apart.answers):9}"
        return f"{name:48}{len(apart.off):7}   {sizes}{counts}   {', '.join(self.remarks)}"


HEAD = f"{'trace':48} frames   {'m':10}{'rad':10}{'cov':10}status  answers"


def checked(name: str, exact: bool = False) -> Checked:
    """Make a trace again and compare it with the stored one."""
    with np.load(TRACES / f"{name}.npz") as file:
        stored = dict(file)
    found = tracked(CASES[name].given(CASES[name].recording()))
    allowed = NEAR_BY_IMAGES if stored["by_images"] else NEAR
    apart = difference(found, stored, 0.0 if exact else allowed)
    frames = len(apart.off)
    begin = int(stored["sensitive_from"])
    is_off = bool(apart.off[: frames if exact else begin].any())
    remarks = {
        "OFF": is_off,
        f"sensitive from frame {begin} on": begin < frames,
        "another recording": found["inputs"] != stored["inputs"],
    }
    return Checked(apart, tuple(word for word, holds in remarks.items() if holds), is_off)


def make(folder: Path, names: list[str]) -> None:
    """Make traces, all of them without names."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in there(names or list(CASES)):
        trace = made(name)
        np.savez_compressed(folder / f"{name}.npz", allow_pickle=False, **trace)
        frames = len(trace["pose"])
        begin = int(trace["sensitive_from"])
        print(f"{name:48}{frames:5} frames{f', sensitive from {begin} on' if begin < frames else ''}", flush=True)


def check(names: list[str], exact: bool) -> int:
    """Compare traces, print a table, and return how many are off."""
    print(HEAD)
    off = 0
    for name in there(names or list(CASES)):
        again = checked(name, exact)
        print(again.line(name), flush=True)
        off += again.is_off
    print(f"{off} off")
    return off


def there(names: list[str]) -> list[str]:
    """Return the traces whose recordings can be had, and say why others cannot."""
    unknown = [name for name in names if name not in CASES]
    if unknown:
        sys.exit(f"no traces are called {', '.join(unknown)}; there are {', '.join(CASES)}")
    lacking = [name for name in names if CASES[name].is_shared and not SHARED.is_dir()]
    for name in lacking:
        print(f"{name:48} skipped: no folder {SHARED}")
    return [name for name in names if name not in lacking]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Makes traces of estimates, or checks them.")
    commands = parser.add_subparsers(dest="command", required=True)
    to_make = commands.add_parser("make")
    to_make.add_argument("folder", type=Path)
    to_make.add_argument("names", nargs="*")
    to_check = commands.add_parser("check")
    to_check.add_argument("--exact", action="store_true")
    to_check.add_argument("names", nargs="*")
    options = parser.parse_args()
    logging.disable(logging.WARNING)
    if options.command == "make":
        make(options.folder, options.names)
    else:
        sys.exit(1 if check(options.names, options.exact) else 0)
