"""The laboratory: it simulates, trains and studies.

Its commands join those of palpate by entry points; palpate imports nothing of it.
"""

import os
from importlib import import_module
from typing import Any

from palpate.errors import SettingError


def required(purpose: str, extras: str, *modules: str) -> Any:
    """Return the last of some modules. Raises SettingError, which names the extras to install, if one is missing."""
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # torch's threads would wait in a loop, where cores are shared
    try:
        return [import_module(module) for module in modules][-1]
    except ImportError as error:
        missing = f"{purpose} needs {error.name}, which is not installed: pip install 'palpate-lab[{extras}]'"
        if "train" in extras:
            missing += "; PyTorch for CPUs is enough and 3 GB smaller: install it first, as pytorch.org says"
        raise SettingError(missing) from error
