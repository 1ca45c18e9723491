"""The model of pushing for compiled code, and models that extend it."""

import importlib.util
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np

from palpate.compiled import compiled
from palpate.compiled.library import cache_folder, hash_of
from palpate.errors import SettingError
from palpate.estimation.compiled_model import CompiledModel, Given, functions_of
from palpate.estimation.gauss_newton import make_improve
from palpate.estimation.model import Model
from palpate.estimation.records import record_types
from palpate.files import whole_file
from palpate.models import generated
from palpate.models.pushing import force, hand_step, step
from palpate.models.pushing.contact_geometry import SURFACE
from palpate.models.pushing.hand import hand_model
from palpate.models.pushing.model import MODEL
from palpate.models.pushing.settings import SETTINGS


def compiled_model(model: Model, code: ModuleType, name: str) -> CompiledModel:
    """Return a model of pushing for compiled code: the functions of its generated module, and those of a step.

    `name` tells models apart where compiled code is kept.
    """
    is_hand = model.fingers > 0
    put_force = hand_step.make_put_hand_force(model) if is_hand else force.make_put_force(model)
    functions = functions_of(
        model,
        move_step=code.move_step,
        copy_step=code.copy_step,
        difference=code.difference,
        linearise_step=code.linearise_step,
        linearise_measured=code.linearise_measured,
        prepare_step=hand_step.prepare_hand_step if is_hand else step.prepare_step,
        prepare_process=put_force,
        prepare_last=force.make_put_last_force(put_force),
        put_object_pose=step.put_object_pose,
        put_object_derivative=step.put_object_derivative,
    )
    records = record_types(model)
    given = Given(
        settings=np.zeros(1, SETTINGS),
        drift=np.zeros(1),
        surface=model.fingers * (SURFACE,) if is_hand else SURFACE,
        places=np.zeros((1, 1)),
        work=np.zeros(1, records.work),
    )
    begin_step = compiled(np.zeros((1, 1), records.step), name=f"begin_step_{name}")
    made = CompiledModel(
        model=model,
        records=records,
        improve=make_improve(functions, records, given, name),
        begin_step=begin_step(hand_step.begin_hand_step if is_hand else step.begin_step),
    )
    MODELS.append(made)
    return made


MODELS: list[CompiledModel] = []
"""All models so far. A tracker needs the machine code of one, and each takes longer to compile than all else."""

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
    return compiled_model(model, _loaded(path), f"{path.stem}_{hash_of(path)}")


@cache
def pushing_with(fingers: int) -> CompiledModel:
    """Return the model of pushing with so many fingers for compiled code; that of one sensor for 0.

    Those of two and three fingers come with palpate. For more, SymPy writes the code where compiled code is kept, once;
    raises SettingError without SymPy, or where nothing can be kept.
    """
    if fingers == 0:
        return PUSHING
    model = hand_model(fingers)
    if fingers == 2:
        from palpate.models import generated_two_fingers

        return compiled_model(model, generated_two_fingers, "two_fingers")
    if fingers == 3:
        from palpate.models import generated_three_fingers

        return compiled_model(model, generated_three_fingers, "three_fingers")
    folder = cache_folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return extended_pushing(model, folder / f"palpate_{fingers}_fingers.py")


def _loaded(path: Path) -> ModuleType:
    """Return the module in a file of generated code."""
    spec = importlib.util.spec_from_file_location(f"palpate_generated_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise SettingError(f"{path}: is no Python file; its name must end in .py")
    code = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = code  # where Numba looks for it when it loads compiled code
    spec.loader.exec_module(code)
    return code
