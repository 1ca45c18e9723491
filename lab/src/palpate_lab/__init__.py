"""The laboratory: it simulates, trains and studies.

Its commands join those of palpate by entry points; palpate imports nothing of it.
"""

import os
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from palpate.errors import SettingError
from palpate.hints import LABORATORY, install_command, reinstall_command


def required(purpose: str, extras: str, *modules: str) -> Any:
    """Return the last of some modules. Raises SettingError with the command to install, if one is missing or broken."""
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # torch's threads would wait in a loop, where cores are shared
    try:
        return [import_module(module) for module in modules][-1]
    except ImportError as error:
        _check_mujoco(purpose)
        command = install_command(extras, LABORATORY)
        missing = f"{purpose} needs {error.name}, which is not installed: {command}"
        if "train" in extras:
            missing += "; PyTorch for CPUs is enough and 3 GB smaller: install it first, as pytorch.org says"
        raise SettingError(missing) from error
    except OSError as error:  # of a shared library
        _check_mujoco(purpose)
        raise SettingError(f"{purpose} needs a library that cannot be loaded: {error}") from error


def _check_mujoco(purpose: str) -> None:
    """Raise SettingError if two versions of MuJoCo are installed into one folder, each with files of the other.

    From version 4 on, its modules come as mujoco-core; the package mujoco of version 3 has modules of the same names.
    """
    try:
        old = version("mujoco")
        new = version("mujoco-core")
    except PackageNotFoundError:
        return
    if int(old.partition(".")[0]) < 4:
        command = reinstall_command("mujoco", "mujoco-core", requirement=f"mujoco-core=={new}")
        raise SettingError(f"{purpose}: mujoco {old} and mujoco-core {new} overwrote each other's files: {command}")
