"""A model as a list of variables and factors: its generated code, and sentences on what is wrong in it."""

import math
from pathlib import Path
from typing import Any

import pytest

from palpate import SettingError
from palpate.estimation.factor import Factor
from palpate.estimation.generate import generate
from palpate.estimation.variable import Variable
from palpate.manifolds.functions import larger, wrap
from palpate.manifolds.planar import Pose, Vector
from palpate.models.pushing.compiled import extended_pushing
from palpate.models.pushing.model import MODEL
from palpate.models.pushing.settings import SETTINGS

GENERATED = Path(__file__).parents[2] / "src/palpate/models/generated.py"


def test_the_committed_code_is_that_of_the_model():
    assert GENERATED.read_text() == generate(MODEL, SETTINGS, "palpate.models.pushing"), "run make kernels"


def test_a_residual_is_plain_mathematics_on_numbers():
    # The sensor at (1, 2), turned by a right angle: a point 3 m ahead of it is at (1, 5).
    pose = Pose(Vector(1.0, 2.0), 0.0, 1.0, math.pi / 2)
    assert pose.act(Vector(3.0, 0.0)) == Vector(1.0, 5.0)
    assert pose.act_back(Vector(1.0, 5.0)) == Vector(3.0, 0.0)
    back = pose.compose(pose.inverse())
    assert (back.position, back.cos, back.sin, back.angle) == (Vector(0.0, 0.0), 1.0, 0.0, 0.0)
    assert wrap(1.5 * math.pi) == pytest.approx(-0.5 * math.pi)
    (torque,) = next(one for one in MODEL.factors if one.name == "turn").residual(
        now=Numbers(g=pose), measured=Numbers(angle=-math.pi, sign=1.0), turn_offset=0.25
    )
    assert torque == pytest.approx(-0.5 * math.pi - 0.25)


class Numbers:
    """Numbers by the names of fields."""

    def __init__(self, **fields: Any) -> None:
        self.__dict__.update(fields)


class Force:
    """A measurement."""


def with_factor(residual: Any, variance: Any = lambda: (1.0,), **more: Any) -> str:
    """The code of the model with one more factor."""
    factor = Factor("push_force", residual, variance, measurement=Force, data=("force",), **more)
    return generate(MODEL.extended(factors=[factor]), SETTINGS, "here")


def test_a_new_factor_is_generated_with_its_derivatives():
    code = with_factor(lambda measured, depth: (depth**2 - measured.force,))
    body = code.partition("def push_force(")[2].partition("@kernel")[0]
    assert f"out.jacobian[0, {MODEL.column(next(one for one in MODEL.shared if one.name == 'depth'))}] = 2.0*" in body
    assert "def linearise_measured" in code


@pytest.mark.parametrize(
    ("residual", "sentence"),
    [
        (lambda compliance: (compliance,), "factor 'push_force' reads 'compliance', which the model lacks; known are "),
        (
            lambda measured: (measured.torque,),
            "factor 'push_force' reads measured.torque, which is not known; known are",
        ),
        (lambda depth: (larger(depth, 0.0),), "factor 'push_force': its residual has no derivative: larger() has no "),
    ],
    ids=["a variable that is not declared", "a number that is not there", "no derivative"],
)
def test_a_wrong_residual_is_named(residual, sentence):
    with pytest.raises(SettingError) as error:
        with_factor(residual)
    assert sentence in str(error.value)


def test_a_robust_kernel_without_a_scale_is_named():
    with pytest.raises(SettingError, match=r"'push_force' has a robust kernel, .* settings= names one of contact, "):
        with_factor(lambda depth: (depth,), kernel="each")
    assert "settings.contact.kernel" in with_factor(lambda depth: (depth,), kernel="each", settings="contact")


def test_a_variable_of_three_numbers_is_no_vector():
    with pytest.raises(SettingError, match=r"variable 'wrench' has dimension 3; allowed are \(1, 2\)"):
        Variable("wrench", "contact", 3)


def test_factors_of_pairs_come_first():
    with pytest.raises(SettingError, match="factors of pairs of steps come first"):
        type(MODEL)(MODEL.variables, MODEL.factors[::-1], MODEL.geometry, MODEL.step_numbers, MODEL.step_poses)


def test_an_extended_model_keeps_the_places_of_the_object_variables():
    wider = MODEL.extended([Variable("compliance", "object", prior=(0.0, 1.0)), Variable("phase", "contact")])
    assert [wider.in_object[one] for one in MODEL.of("object")] == [MODEL.in_object[one] for one in MODEL.of("object")]
    assert (wider.object_size, wider.contact_size) == (MODEL.object_size + 1, MODEL.contact_size + 1)
    assert wider.width == MODEL.width + 2


def test_a_file_that_is_no_python_file_is_named(tmp_path):
    with pytest.raises(SettingError, match=r"kernels\.txt: is no Python file"):
        extended_pushing(MODEL, tmp_path / "kernels.txt")
