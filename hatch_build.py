"""Machine code in wheels: `make wheel` builds one for this kind of machine and every Python, as the code needs neither.

Without this hook, as in a checkout, the code is made when it is first needed.
"""

import platform
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class LibrariesHook(BuildHookInterface):
    """Builds the libraries of all compiled functions into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the libraries; `version` is "editable" for a checkout, which gets none."""
        if version == "editable":
            return
        sys.path.insert(0, str(Path(self.root, "src")))
        import palpate.touch.marks  # noqa: F401
        from palpate.compiled import EVERY
        from palpate.compiled.library import LEVELS, WITH_PALPATE, make
        from palpate.models.pushing.compiled import pushing_with

        pushing_with(2)

        levels = LEVELS if platform.machine() == "x86_64" else ["generic"]
        for path in [make(each, WITH_PALPATE, level) for level in levels for each in EVERY]:
            if path.suffix == ".o":
                self.app.abort("machine code cannot be linked: a C compiler is needed")
            build_data["artifacts"].append(str(path.relative_to(self.root)))
        tag = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{tag}"
