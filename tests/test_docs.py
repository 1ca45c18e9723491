"""README and docs: links lead somewhere, numbers are those of files, examples are Python, and the site is built."""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import palpate

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs/guide").glob("*.md"))]
LINK = re.compile(r"\[[^]]*\]\(([^)#\s]+)[^)]*\)")
DATA = "https://huggingface.co/datasets/"
KNOWN = {
    *("https://arxiv.org/abs/2012.03768", "https://digit.ml", "https://gtsam.org"),
    *(DATA + name for name in ("facebook/digit-pose-estimation", "joehjhuang/TactileTracking", "yxma/React")),
}
"""Pages elsewhere that were looked at."""
EXAMPLE = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def numbers() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "scripts")
        return importlib.import_module("reported_numbers")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_pictures_and_examples_of_a_page(page):
    text = page.read_text(encoding="utf-8")
    targets = [target for target in LINK.findall(text) if "://" not in target]
    assert [target for target in targets if not (page.parent / target).exists()] == []
    assert {target for target in LINK.findall(text) if "://" in target} <= KNOWN
    assert not re.search(r"!\[[^]]*\]\(https?:|<(script|img|iframe|link)\b", text)  # nothing is loaded from the network
    for example in EXAMPLE.findall(text):
        assert max(map(len, example.splitlines())) <= 88  # so that no page scrolls
        for node in ast.walk(ast.parse(example)):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "palpate":
                assert hasattr(palpate, node.attr), node.attr


@pytest.mark.parametrize("page", ["own_data", "outlines", "own_sensor", "estimate", "status", "other_measurements"])
def test_the_examples_of_a_page_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    examples = EXAMPLE.findall((ROOT / f"docs/guide/{page}.md").read_text(encoding="utf-8"))
    assert examples
    exec(compile("\n".join(examples), page, "exec"), {})


def test_every_number_is_that_of_its_file(numbers):
    assert [complaint for page in numbers.pages(numbers.PAGES) for complaint in numbers.complaints(page)] == []


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("It ends 2.0 mm off.\n", "stands in no block"),
        ("<!-- numbers: from step-times -->\nA step takes 0.123 ms.\n<!-- end -->\n", "says 0.123"),
        ("<!-- numbers: plain -->\n\n| objects |\n|---|\n| disc |\n\n<!-- end -->\n", "differs"),
        ("<!-- numbers: nobody -->\n5\n<!-- end -->\n", "nobody"),
    ],
)
def test_a_wrong_number_is_found(numbers, text, complaint, monkeypatch, tmp_path):
    page = tmp_path / "README.md"
    page.write_text(text, encoding="utf-8")
    monkeypatch.setattr(numbers, "pages", lambda _: [page])
    (found,) = numbers.complaints(page)
    assert complaint in found


def test_a_table_is_written_from_its_file(numbers):
    written = numbers.written("<!-- numbers: plain -->\n| wrong |\n<!-- end -->\n")
    assert "| all | 120 |" in written and numbers.written(written) == written


def test_the_reference_has_every_public_name():
    page = (ROOT / "docs/reference.md").read_text(encoding="utf-8")
    names = [name for name in dir(palpate) if not name.startswith("_") and not name.endswith("Error")]
    assert [name for name in names if not re.search(rf"\.{name}\b", page)] == []


def test_the_site_is_built_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet", "docs", str(tmp_path)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert (built.returncode, built.stderr) == (0, "")
    assert "<math" in (tmp_path / "factors.html").read_text(encoding="utf-8")
