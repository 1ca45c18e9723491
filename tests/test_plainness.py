"""The measures of plainness in `make lint`, on small packages."""

import importlib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
ROOM = "class Window:\n    def add(self, *, " + ", ".join("abcdefgh") + "):\n        x, y = 1, 2\n        return x\n"
LONG = "def long():\n    '''Long.\n    '''\n" + 81 * "    print()\n"
PACKAGE = {
    "config.py": "LIMIT = 0.5\nSHARED, OTHER = 3, 4\nNAME = 'a'\n",
    "tracker.py": "from package.config import LIMIT, SHARED\n",
    "window/window.py": ROOM + "SHARED = 2\n",
    "window/rest.py": "def wide(" + ", ".join("abcdefghi") + "):\n    '''Whether it rests.'''\n" + LONG,
}


@pytest.fixture
def plainness(monkeypatch) -> Any:
    monkeypatch.syspath_prepend(ROOT / "scripts")
    return importlib.import_module("check_plainness")


@pytest.fixture
def package(tmp_path, monkeypatch, plainness) -> str:
    for name, text in PACKAGE.items():
        path = tmp_path / "package" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(plainness, "ROOT", tmp_path)
    return "package"


def test_each_measure_counts_what_it_names(plainness, package):
    found = {measure.name: measure for measure in plainness.measures(plainness.read_sources(package))}
    values = {name: measure.value for name, measure in found.items()}
    assert values == {
        "tuple assignments per 1000 code lines": round(1000 * 2 / 96),
        "tuple assignments per 1000 code lines, worst room": round(1000 * 1 / 300),
        "percent of functions above 40 lines": 33.3,
        "longest function, lines": 82,
        "functions of more than 8 arguments": 1,
        "constants of config that one other file alone uses": 1,
        "numeric module constants": 4,
        "docstrings that open with a question word": 1,
    }
    assert found["functions of more than 8 arguments"].places == ["package/window/rest.py:1 wide"]
    assert found["longest function, lines"].is_exceeded


def test_an_exceeded_limit_fails_and_names_the_places(plainness, package, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(plainness, "DISTRIBUTIONS", (package,))
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests/test_inner.py").write_text("from palpate.tracker import Tracker\n")
    assert plainness.main() == 1
    out = capsys.readouterr().out
    assert "package/window/rest.py:3 long" in out and "tests/test_inner.py" in out
    for name in plainness.LIMITS:
        monkeypatch.setitem(plainness.LIMITS, name, 1000)
    assert plainness.main() == 1  # for the tests alone
    (tmp_path / "tests/test_inner.py").write_text("import palpate\n")
    assert plainness.main() == 0
