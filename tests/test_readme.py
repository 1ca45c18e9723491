"""What the README says to do first, done."""

import runpy
import shlex
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
STEPS = ROOT / "scripts" / "readme_steps.py"


def test_what_the_readme_says_up_to_the_first_picture_of_ones_own_data(tmp_path, monkeypatch, capsys, command):
    kinds: list[str] = []

    def run_here(kind: str, text: str) -> None:
        """Run a step as the script does, but in this process: to start six takes half a minute of two cores."""
        kinds.append(kind)
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
    assert set(kinds) == {"shell", "python"} and len(kinds) > 3
    assert capsys.readouterr().out.splitlines()[-1] == "picture of one's own data: runs/push/figure.png"
    assert (tmp_path / "runs" / "push" / "figure.png").read_bytes().startswith(b"\x89PNG")
