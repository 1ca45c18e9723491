"""Commands that messages advise, as they work here: from a checkout, and where PATH has no palpate."""

import json
import shlex
import shutil
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from palpate.errors import SettingError

LABORATORY = "palpate-lab"


def own_command() -> str:
    """Return the command that runs palpate here: palpate, the script that runs, or python -m palpate."""
    if shutil.which("palpate"):
        return "palpate"
    script = Path(sys.argv[0])
    if script.name == "palpate":
        return shlex.quote(sys.argv[0])
    is_on_path = shutil.which("python") == sys.executable
    return f"{'python' if is_on_path else shlex.quote(sys.executable)} -m palpate"


def install_command(extras: str = "", name: str = "palpate") -> str:
    """Return the command that installs a distribution of palpate with extras, from the checkout if it came from one.

    The requirement is in quotes, as some shells take brackets for a pattern.
    """
    checkout = _checkout()
    requirement = name
    if checkout is not None:
        requirement = str(checkout / "lab" if name == LABORATORY else checkout)
    if extras:
        requirement += f"[{extras}]"
    return f"{_pip()} install '{requirement}'"


def library(module: str, extra: str, needed_by: str) -> Any:
    """Return a module that an extra of palpate brings. Raises SettingError, with the command that installs it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise SettingError(f"{needed_by} needs {error.name or module}: {install_command(extra)}") from error


def reinstall_command(*names: str, requirement: str) -> str:
    """Return the command that removes distributions and installs one."""
    return f"{_pip()} uninstall -y {' '.join(names)} && {_pip()} install '{requirement}'"


def _pip() -> str:
    """Return the pip of the Python that runs."""
    is_on_path = shutil.which("python") == sys.executable
    return f"{'python' if is_on_path else shlex.quote(sys.executable)} -m pip"


def _checkout() -> Path | None:
    """Return the folder of the source that palpate was installed from or runs in; None if it came from an index."""
    root = Path(__file__).parents[2]
    if (root / "lab" / "pyproject.toml").exists():
        return root
    # These import a client of HTTP and a reader of mails.
    from importlib.metadata import PackageNotFoundError, distribution
    from urllib.parse import urlparse
    from urllib.request import url2pathname

    try:
        origin = json.loads(distribution("palpate").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        return None
    url = urlparse(origin.get("url", ""))
    folder = Path(url2pathname(url.path))
    is_source = url.scheme == "file" and (folder / "lab" / "pyproject.toml").exists()
    return folder if is_source else None
