import pydoc
from dataclasses import dataclass

import palpate
from palpate.field_docs import field_docs, with_field_docs


def test_help_tells_the_fields_of_a_public_class():
    told = pydoc.plain(pydoc.render_doc(palpate.Estimate))
    assert "The object's pose at one frame" in told
    assert "covariance\n" in told and "tangent space at the pose" in told
    assert str(palpate.Estimate.__doc__).count("Fields\n") == 1


def test_every_field_of_a_public_dataclass_has_a_docstring():
    for name in dir(palpate):
        found = getattr(palpate, name)
        if isinstance(found, type) and hasattr(found, "__dataclass_fields__"):
            assert set(vars(found).get("__annotations__", ())) <= set(field_docs(found)), name


def test_a_class_without_source_keeps_its_docstring():
    made = dataclass(type("Made", (), {"__doc__": "As it is.", "__annotations__": {"x": int}}))
    assert field_docs(made) == {}
    assert with_field_docs(made).__doc__.startswith("As it is.")
    assert with_field_docs(palpate.__version__) is palpate.__version__
