"""What the README says to do first, done."""

import runpy
import shlex
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
STEPS = ROOT / "scripts" / "readme_steps.py"
README = """# a thing

    make demo

## Install

    python -m pip install .

## Use

    palpate info push.mcap      # what is in it

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
        ("shell", "palpate info push.mcap      # what is in it\n"),
        ("python", "for frame in recording:\n    print(frame)\n"),
        ("shell", "palpate live\n"),
    ]


def test_a_step_that_fails_ends_it(capsys):
    run = runpy.run_path(str(STEPS))["run"]
    run("python", "import palpate\npalpate.Rectangle(0.12, 0.08)")
    assert capsys.readouterr().out.endswith("s  palpate.Rectangle(0.12, 0.08)\n")
    with pytest.raises(SystemExit, match="told why\n\nexit code 3"):
        run("shell", "echo told why; exit 3")


def test_what_the_readme_says_up_to_the_first_picture_of_ones_own_data(tmp_path, monkeypatch, capsys, command):
    def run_here(kind: str, text: str) -> None:
        """Run a step as the script does, but in this process: to start six takes half a minute of two cores."""
        if kind == "python":
            exec(compile(text, "README.md", "exec"), {})
            return
        for line in text.splitlines():
            name, *words = shlex.split(line, comments=True)
            assert name == "palpate"
            files = [sorted(map(str, Path().glob(word))) if "*" in word else [word] for word in words]
            assert command(*chain.from_iterable(files)) == 0

    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(STEPS))["main"]([str(ROOT / "README.md"), "--short"], run_here)
    assert capsys.readouterr().out.splitlines()[-1] == "picture of one's own data: runs/push/figure.png"
    assert (tmp_path / "runs" / "push" / "figure.png").read_bytes().startswith(b"\x89PNG")
