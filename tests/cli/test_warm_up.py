"""`palpate warm-up`."""

import os
from pathlib import Path


def test_warm_up_says_where_compiled_code_is_kept(json_of):
    folder = Path(json_of("warm-up")["folder"])
    assert any(path.name.startswith("improve") and os.access(path, os.R_OK) for path in folder.iterdir())
