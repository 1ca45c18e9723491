"""The model of pushing for compiled code."""

from palpate.estimation.compiled_model import CompiledModel, functions_of
from palpate.estimation.gauss_newton import make_improve
from palpate.estimation.records import record_types
from palpate.models import generated
from palpate.models.pushing import force, step
from palpate.models.pushing.model import MODEL

PUSHING = CompiledModel(
    model=MODEL,
    records=record_types(MODEL),
    improve=make_improve(
        functions_of(
            MODEL,
            move_step=generated.move_step,
            copy_step=generated.copy_step,
            difference=generated.difference,
            linearise_step=generated.linearise_step,
            linearise_measured=generated.linearise_measured,
            prepare_step=step.prepare_step,
            prepare_process=force.put_force_angle,
            prepare_last=force.put_last_force_angle,
            put_object=step.put_object,
            put_object_derivative=step.put_object_derivative,
        ),
        "pushing",
    ),
    begin_step=step.begin_step,
)
"""Variables, factors, records and compiled functions of pushing."""
