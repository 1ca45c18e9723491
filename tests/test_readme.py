"""What the README says to do first, done."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
STEPS = ROOT / "scripts" / "readme_steps.py"
README = """# a thing

    make demo

## Install

    python -m pip install .
    make ready

## Use

    palpate info push.h5      # what is in it
    palpate track push.h5

```python
for frame in recording:
    print(frame)
```

## Your own data

    palpate live

## More

    palpate never
"""


def test_steps_are_the_blocks_of_code_but_for_installing():
    assert runpy.run_path(str(STEPS))["steps"](README) == [
        ("shell", "palpate info push.h5      # what is in it\npalpate track push.h5\n"),
        ("python", "for frame in recording:\n    print(frame)\n"),
        ("shell", "palpate live\n"),
    ]


def test_what_the_readme_says_up_to_the_first_picture_of_ones_own_data(tmp_path):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")
    words = [sys.executable, str(STEPS), str(ROOT / "README.md"), "--short"]
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(words, cwd=tmp_path, env={**os.environ, "PATH": path}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "picture of one's own data: runs/push/figure.png"
    assert (tmp_path / "runs" / "push" / "figure.png").read_bytes().startswith(b"\x89PNG")
