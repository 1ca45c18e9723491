"""Records that compiled code reads and writes: a step, a row of the window, a measurement, linearised rows."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.estimation.model import Model

MOST_OWN_ROWS = 6
"""Largest number of rows of a measurement that brings its own residual, and of a factor's innovations."""
POSE = 3
"""Numbers of a pose."""


@dataclass(frozen=True, eq=False)
class RecordTypes:
    """Structured types of a model; see the functions that make them for their fields."""

    step: np.dtype
    term: np.dtype
    past: np.dtype
    row: np.dtype
    linear: np.dtype
    work: np.dtype


def record_types(model: Model) -> RecordTypes:
    """Return the types of a model."""
    past = past_type(model)
    linear = linear_type(model)
    return RecordTypes(
        step=step_type(model),
        term=term_type(model),
        past=past,
        row=row_type(model, past),
        linear=linear,
        work=work_type(model, linear, past),
    )


def step_type(model: Model) -> np.dtype:
    """Return the type of one step of a row of the window.

    - The variables of the step by their short names, poses that are known, and the rotations `turn_NAME` of both,
      exp(i theta) as complex numbers.
    - touch: contact geometry at the variables.
    - The numbers of the step that factors read.
    - Of several fingers, each of these by finger: finger and turn_finger, the pose in the hand and its rotation;
      touch_of, contact geometry of its own; touches, 1 while it touches; and further numbers of a finger.
    - cost: cost of measurements and of the process, and 1 if the latter does not count.
    - cost_of_belief: that of the belief with which a contact begins, which is no evidence.
    - surprise: square of the innovations of each factor when this step was the last one, in units of the variance
      predicted and that of the factor.
    - root, y: what is left of the step once it is eliminated; see `estimation.eliminate`.
    """
    fields: dict[str, Any] = {}
    for variable in model.of("step"):
        fields[variable.field] = "3f8"
        fields[f"turn_{variable.field}"] = "c16"
    for name in model.step_poses:
        fields[name] = "3f8"
        fields[f"turn_{name}"] = "c16"
    fields["touch"] = model.geometry
    fields |= dict.fromkeys(model.step_numbers, "f8")
    if model.fingers:
        fields["finger"] = f"({model.fingers},3)f8"
        fields["turn_finger"] = f"{model.fingers}c16"
        fields["touch_of"] = (model.geometry, (model.fingers,))
        fields |= dict.fromkeys(("touches", *model.finger_numbers), f"{model.fingers}f8")
    fields["cost"] = "3f8"
    fields["cost_of_belief"] = "f8"
    fields["surprise"] = f"{len(model.names)}f8"
    fields["root"] = f"({model.step_size},{model.width})f8"
    fields["y"] = f"{model.step_size}f8"
    return _record(fields)


def term_type(model: Model) -> np.dtype:
    """Return the type of the term that a measurement brings.

    - step: its step, counted from the beginning of the contact.
    - kind: place of its factor among those of the model.
    - arrived: the step with which it arrived, which is later if it is late.
    - from_touch: 1 if it was read from touch images, which may be mirrored.
    - variance: stated variance, 0 if it has a covariance.
    - data: its numbers, `Factor.data`.
    - root: inverse Cholesky root of its covariance, `Factor.root`.
    """
    most = max(len(factor.data) for factor in model.factors)
    fields = dict.fromkeys(("step", "kind", "arrived", "from_touch", "variance"), "f8")
    return _record({**fields, "data": f"{most}f8", "root": "(3,3)f8"})


def past_type(model: Model) -> np.dtype:
    """Return the type of a Gaussian on the oldest step and the shared variables, which is all that older steps say.

    It has the information matrix, the negative gradient, and the values at which it is that. The information is NaN if
    it is indeterminate.
    """
    fields: dict[str, Any] = {
        "information": f"({model.last_size},{model.last_size})f8",
        "gradient": f"{model.last_size}f8",
    }
    fields |= {variable.field: "3f8" for variable in model.of("step")}
    fields["shared"] = f"{model.shared_size}f8"
    return _record(fields)


def row_type(model: Model, past: np.dtype) -> np.dtype:
    """Return the type of all else in a row of the window.

    - shared: shared variables.
    - sign: -1.0 if touch images are taken as mirrored, else 1.0.
    - first_...: belief about the object at the beginning: pose with its rotation, variables, and whitening matrix of
      their joint covariance.
    - past, next_past: what older steps say, and what they will say once the oldest step has left.
    - object, covariance: the object's last pose [m, m, rad], and the joint covariance of this and its variables.
    - surprise: mean of those of the last steps for each factor; 0 until there are enough.
    - innovations: of the rows of each factor that arrived with the last step, see `Estimate.innovations`.
    - change, earlier_change, moved: largest change of a variable of a step in the last Gauss-Newton step, that of a
      step that is not recent, and the changes of the last step and the shared variables.
    - last_root, last_y: what is left of the last step and the shared variables once they are eliminated.
    - is_lost: True if there is no solution.
    """
    size = POSE + model.object_size
    names = len(model.names)
    fields: dict[str, Any] = {
        "shared": f"{model.shared_size}f8",
        "sign": "f8",
        "first_pose": "3f8",
        "first_turn": "c16",
        "first_values": f"{model.object_size}f8",
        "first_root": f"({size},{size})f8",
        "past": past,
        "next_past": past,
        "object": "3f8",
        "covariance": f"({size},{size})f8",
        "change": "f8",
        "earlier_change": "f8",
        "surprise": f"{names}f8",
        "innovations": f"({names},{MOST_OWN_ROWS},3)f8",
        "moved": f"{model.last_size}f8",
        "last_root": f"({model.last_size},{model.width})f8",
        "last_y": f"{model.last_size}f8",
        "is_lost": "?",
    }
    return _record(fields)


def linear_type(model: Model) -> np.dtype:
    """Return the type of the linearised rows of a factor.

    - residual: its rows.
    - jacobian: by perturbations of the step before and of this step, and by the shared variables; 0 before a factor
      writes to it.
    - information, weight: inverse variances, without and with the weight that the robust kernel leaves.
    - error: room for computing.
    """
    most = max(POSE + model.object_size, MOST_OWN_ROWS)
    fields: dict[str, Any] = {
        "residual": f"{most}f8",
        "jacobian": f"({most},{model.width})f8",
        "information": f"{most}f8",
        "weight": f"{most}f8",
        "error": "3f8",
    }
    return _record(fields)


def work_type(model: Model, linear: np.dtype, past: np.dtype) -> np.dtype:
    """Return the type of the room for computing one row of a window; arrays made in compiled code compile slowly.

    `earlier` is what the earlier steps say about the first recent one.
    """
    fields: dict[str, Any] = {
        "linear": linear,
        "earlier": past,
        "system": f"({model.width},{model.width})f8",
        "gradient": f"{model.width}f8",
        "change": f"{model.width}f8",
        "next_system": f"({model.width},{model.width})f8",
        "next_gradient": f"{model.width}f8",
        "next_root": f"({model.step_size},{model.width})f8",
        "next_y": f"{model.step_size}f8",
    }
    return _record(fields)


def _record(formats: dict[str, Any]) -> np.dtype:
    """Return a structured type for compiled code."""
    return np.dtype(list(formats.items()), align=True)
