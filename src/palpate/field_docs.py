"""Docstrings of fields: they stand under them in the source, Python drops them, and `help()` should show them."""

import ast
import inspect
import textwrap
from dataclasses import is_dataclass
from itertools import pairwise
from typing import Any

HEADING = "Fields"


def field_docs(cls: type) -> dict[str, str]:
    """Return the docstring under each field of a class, by name; nothing where there is no source to read."""
    try:
        (definition,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    except (OSError, TypeError):
        return {}
    found = {}
    for field, below in pairwise(getattr(definition, "body", ())):
        match field, below:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                found[name] = inspect.cleandoc(text)
    return found


def with_field_docs(found: Any) -> Any:
    """Return what was given; a dataclass gets a docstring that tells its fields, put together when it is read."""
    if isinstance(found, type) and is_dataclass(found) and not isinstance(vars(found).get("__doc__"), _Doc):
        found.__doc__ = _Doc(found.__doc__ or "")  # type: ignore[assignment]
    return found


class _Doc:
    """The docstring of a class, and below it those of its fields."""

    def __init__(self, own: str) -> None:
        self._own = inspect.cleandoc(own)

    def __get__(self, instance: object, owner: type) -> str:
        fields = (f"{name}\n{textwrap.indent(text, '    ')}" for name, text in field_docs(owner).items())
        return "\n".join([self._own, "", HEADING, "-" * len(HEADING), *fields])
