"""README and docs: links lead somewhere, numbers are those of files, examples are Python; `make docs` builds it."""

import ast
import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

import palpate

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs/guide").glob("*.md"))]
LINK = re.compile(r"\[[^]]*\]\(([^)#\s]+)[^)]*\)")
EXAMPLE = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)


def named(pages: list[Path]) -> list[str]:
    return [str(page.relative_to(ROOT)) for page in pages]


@pytest.fixture(scope="module")
def check() -> ModuleType:
    sys.path.insert(0, str(ROOT / "scripts"))
    try:
        spec = importlib.util.spec_from_file_location("check_numbers", ROOT / "scripts/check_numbers.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(ROOT / "scripts"))
    return module


@pytest.mark.parametrize("page", PAGES, ids=named(PAGES))
def test_links_and_pictures_are_there(page):
    targets = [target for target in LINK.findall(page.read_text(encoding="utf-8")) if "://" not in target]
    assert [target for target in targets if not (page.parent / target).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=named(PAGES))
def test_pages_load_nothing_from_the_network(page):
    assert not re.search(r"!\[[^]]*\]\(https?:|<(script|img|iframe|link)\b", page.read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", PAGES, ids=named(PAGES))
def test_examples_are_python_and_name_what_there_is(page):
    for example in EXAMPLE.findall(page.read_text(encoding="utf-8")):
        for node in ast.walk(ast.parse(example)):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "palpate":
                assert hasattr(palpate, node.attr), node.attr


def test_every_number_is_that_of_its_file(check):
    assert [what for page in check.pages(check.MARKED) for what in check.found_wrong(page)] == []


@pytest.mark.parametrize(
    "text",
    [
        "It ends 2.0 mm off.\n",
        "<!-- numbers: step-facts -->\nA step takes 1.9 ms.\n<!-- end -->\n",
        "<!-- numbers: plain -->\n\n| objects |\n|---|\n| disc |\n\n<!-- end -->\n",
        "<!-- numbers: nobody -->\n5\n<!-- end -->\n",
    ],
    ids=["outside a block", "another number", "another table", "unknown block"],
)
def test_a_wrong_number_is_found(check, text, monkeypatch, tmp_path):
    page = tmp_path / "README.md"
    page.write_text(text)
    monkeypatch.setattr(check, "pages", lambda _: [page])
    assert len(check.found_wrong(page)) == 1


def test_a_table_is_written_from_its_file(check):
    written = check.written("<!-- numbers: plain -->\n| wrong |\n<!-- end -->\n")
    assert "| all | 120 |" in written and check.written(written) == written


def test_the_reference_has_every_public_name():
    page = (ROOT / "docs/reference.md").read_text(encoding="utf-8")
    names = [name for name in dir(palpate) if not name.startswith("_") and not name.endswith("Error")]
    assert [name for name in names if not re.search(rf"\.{name}\b", page)] == []


def test_readme_comes_to_ones_own_data_soon():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    before, _ = text.split("\n## On a sensor of your own\n")
    assert "from_arrays" in before
    assert len(before.split()) <= 600
    assert len(text.split()) <= 1200
