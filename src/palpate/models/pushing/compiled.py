"""The model of pushing for compiled code, and models that extend it."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from palpate.compiled import hash_of
from palpate.errors import SettingError
from palpate.estimation.compiled_model import CompiledModel, functions_of
from palpate.estimation.gauss_newton import make_improve
from palpate.estimation.model import Model
from palpate.estimation.records import record_types
from palpate.files import whole_file
from palpate.models import generated
from palpate.models.pushing import force, step
from palpate.models.pushing.model import MODEL
from palpate.models.pushing.settings import SETTINGS


def compiled_model(model: Model, code: ModuleType, name: str, **instead: Any) -> CompiledModel:
    """Return a model of pushing for compiled code: the functions of its generated module, and those of a step.

    `name` tells models apart where compiled code is kept. Functions of `Functions` by name take the place of the usual.
    """
    usual: dict[str, Any] = {
        "move_step": code.move_step,
        "copy_step": code.copy_step,
        "difference": code.difference,
        "linearise_step": code.linearise_step,
        "linearise_measured": code.linearise_measured,
        "prepare_step": step.prepare_step,
        "prepare_process": force.make_put_force(model),
        "prepare_last": force.make_put_last_force(model),
        "put_object": step.put_object,
        "put_object_derivative": step.put_object_derivative,
    }
    functions = functions_of(model, **(usual | instead))
    return CompiledModel(
        model=model,
        records=record_types(model),
        improve=make_improve(functions, name),
        begin_step=step.begin_step,
    )


PUSHING = compiled_model(MODEL, generated, "pushing")
"""Variables, factors, records and compiled functions of pushing."""


def extended_pushing(model: Model, path: Path | str) -> CompiledModel:
    """Return an extended model of pushing for compiled code, whose generated code is kept in a file.

    With SymPy, the file is written anew; without, it is read as it is. Raises SettingError where neither can be had,
    and where a residual cannot be differentiated or reads what is not there. Compiling takes some 15 s, once.
    """
    path = Path(path)
    try:
        from palpate.estimation.generate import generate
    except ImportError as error:
        if not path.exists():
            raise SettingError(
                f"{path}: there is no such file; to write it, SymPy is needed: pip install sympy"
            ) from error
    else:
        text = generate(model, SETTINGS, path.stem)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            with whole_file(path, overwrite=True) as part:
                part.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(f"palpate_generated_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise SettingError(f"{path}: is no Python file; its name must end in .py")
    code = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = code  # where Numba looks for it when it loads compiled code
    spec.loader.exec_module(code)
    return compiled_model(model, code, f"{path.stem}_{hash_of(path)}")
