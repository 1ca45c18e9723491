"""A tracker in a file: what it was made of and all that it knows, so that a process that restarts goes on.

The estimates that follow are those of a tracker that was not interrupted, to the last digit, with the same palpate.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import palpate
from palpate.config import TrackerSettings, noise_from_dict
from palpate.errors import FileError, PalpateError, SettingError
from palpate.geometry.shapes import shape_from_dict, shape_to_dict
from palpate.graph.variables import UNKNOWNS
from palpate.saved_state import StateFile, Unsaved, write_state
from palpate.touch.learnt import DifferenceInput
from palpate.touch.model import TouchModel, shipped_model
from palpate.tracker import Tracker
from palpate.types.sensor import sensor_from_dict, sensor_to_dict

FORMAT = "palpate-tracker"
_TRACKER_MADE_WITH = "_shape", "_sensor", "_settings", "_model", "_contact_model", "_is_touch_given", "_gate"
_STREAM_MADE_WITH = "_sensor", "_deviation"
"""Attributes of a tracker and of its stream that they are made with; all others are what they know."""


def save_tracker(tracker: Tracker, path: Path | str, beside: Any = None) -> None:
    """See Tracker.save; `beside` is what else to keep in the file."""
    smoother = tracker._settings.smoother
    if smoother == "particle-filter":
        raise SettingError("a tracker with the particle filter cannot be saved: what it draws next is in no file")
    if tracker._is_touch_given:
        raise SettingError("a tracker with a touch of your own cannot be saved: palpate cannot make it anew")
    stream = _known(tracker._gate, _STREAM_MADE_WITH)
    if tracker._gate.last is not None:
        stream["last"] = replace(tracker._gate.last, measurements=())
    known = {"tracker": _known(tracker, _TRACKER_MADE_WITH), "stream": stream, "beside": beside}
    try:
        write_state(path, _about(tracker), known, _given(tracker))
    except Unsaved as error:
        if smoother == "isam2":
            reason = "GTSAM keeps the graph of a contact to itself; save between contacts, or track with fixed-lag"
        else:
            reason = f"no file holds {error}; save between contacts"
        raise SettingError(f"{path}: the tracker cannot be saved now: {reason}") from error


def load_tracker(path: Path | str) -> Tracker:
    """See Tracker.load."""
    return load_tracker_and(path)[0]


def load_tracker_and(path: Path | str) -> tuple[Tracker, Any]:
    """Return the tracker of a file and what was kept beside it, if anything was. Raises FileError."""
    file = StateFile(path)
    try:
        about = file.about
        if about.get("format") != FORMAT:
            raise FileError(f"format is {about.get('format')!r}, expected {FORMAT!r}")
        if about["palpate"] != palpate.__version__:
            raise FileError(
                f"was saved by palpate {about['palpate']}, and this is {palpate.__version__}; begin anew from its last "
                "pose: a state goes on with the version that saved it"
            )
        tracker = _made(about)
        known = file.state(_given(tracker))
        vars(tracker).update(known["tracker"])
        vars(tracker._gate).update(known["stream"])
        return tracker, known["beside"]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FileError(f"{file.path}: is no saved tracker ({error!r})") from error
    except PalpateError as error:
        raise FileError(f"{file.path}: {str(error).removeprefix(f'{file.path}: ')}") from error


def _known(thing: Any, made_with: Sequence[str]) -> dict[str, Any]:
    """The attributes of a tracker or its stream but for those that it is made with."""
    return {name: value for name, value in vars(thing).items() if name not in made_with}


def _about(tracker: Tracker) -> dict[str, Any]:
    """What a tracker is made of, as plain data."""
    model = tracker._model
    learnt = tracker.tactile.startswith(("learnt", "auto"))
    return {
        "format": FORMAT,
        "palpate": palpate.__version__,
        "shape": shape_to_dict(tracker._shape),
        "sensor": sensor_to_dict(tracker._sensor),
        "settings": asdict(tracker._settings),
        "tactile": [tracker.tactile, tracker.tactile_reason],
        "model": None if model is None else str(model.folder.absolute()),
        "model_hash": (model or shipped_model(tracker._sensor.name)).hash if learnt else None,
    }


def _made(about: dict[str, Any]) -> Tracker:
    """A tracker as it was made, which knows nothing yet."""
    settings = about["settings"]
    settings = TrackerSettings(**{**settings, "noise": noise_from_dict(settings["noise"])})
    model = None if about["model"] is None else TouchModel(about["model"])
    shape, sensor = shape_from_dict(about["shape"]), sensor_from_dict(about["sensor"])
    if about["model_hash"] not in (None, (model or shipped_model(sensor.name)).hash):
        raise FileError("its touch model is another one now, so that estimates would not be the same")
    tracker = Tracker(shape, sensor, None, settings, model)
    if settings.tactile == "auto" and about["tactile"][0] != "auto":
        tracker._settle_touch(*about["tactile"])
    return tracker


def _given(tracker: Tracker) -> dict[str, Any]:
    """What a tracker makes anew and does not change, by names."""
    return {
        "contact model": tracker._contact_model,
        "begin contact": tracker._estimator.begin_contact,
        **{f"unknown {one.name}": one for one in UNKNOWNS},
        **dict(_tools(tracker._touch, "touch")),
    }


def _tools(thing: Any, name: str) -> Iterator[tuple[str, Any]]:
    """The functions and networks that touch works with."""
    for field, value in vars(thing).items():
        if callable(value) or isinstance(value, TouchModel):
            yield f"{name}.{field}", value
        elif isinstance(value, DifferenceInput):
            yield from _tools(value, f"{name}.{field}")
