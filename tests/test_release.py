"""What is released: a wheel that holds the package and nothing else, and works without what the extras bring."""

import re
import subprocess
import sys
import tarfile
import zipfile
from email.parser import Parser
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from recording_samples import pushed

import palpate

ROOT = Path(__file__).resolve().parents[1]

# In a Python that finds no module of an extra: runs commands and prints their exit codes.
WITHOUT = """
import sys
from importlib.machinery import PathFinder
class Finder(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name.partition(".")[0] in MISSING else super().find_spec(name, path, target)
MISSING = set(sys.argv[1].split(","))
sys.meta_path = [Finder if each is PathFinder else each for each in sys.meta_path]
import palpate
from palpate.cli.main import main
print(palpate.__file__)
print([main(words.split()) for words in sys.argv[2:]])
"""


def hatchling(folder: Path, target: str, out: Path) -> None:
    words = [sys.executable, "-m", "hatchling", "build", "--target", target, "--directory", str(out)]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    pytest.importorskip("hatchling", reason="hatchling is not installed: pip install palpate[dev]")
    folder = tmp_path_factory.mktemp("release")
    hatchling(ROOT, "sdist", folder)
    name = f"palpate-{palpate.__version__}"
    with tarfile.open(folder / f"{name}.tar.gz") as packed:
        packed.extractall(folder, filter="data")
    for file in ("README.md", "CHANGELOG.md", "CITATION.cff", "LICENSE", "tests/test_release.py"):
        assert (folder / name / file).is_file(), file
    hatchling(folder / name, "wheel", folder)
    return folder / f"{name}-py3-none-any.whl"


def test_the_wheel_holds_the_package_and_nothing_else(wheel):
    source = ROOT / "src"
    wanted = {path.relative_to(source).as_posix() for path in source.rglob("*") if path.is_file()}
    with zipfile.ZipFile(wheel) as packed:
        found = {name for name in packed.namelist() if ".dist-info/" not in name}
    assert found == {name for name in wanted if "__pycache__" not in name}


def test_the_wheel_works_without_the_extras(wheel, tmp_path):
    words = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", str(tmp_path)]
    subprocess.run([*words, str(wheel)], check=True)
    assert (tmp_path / "bin" / "palpate").exists()
    palpate.write_recording(pushed(), tmp_path / "push.mcap")
    lacking = {"sim": "simulate out", "train": "train . --out out"}
    words = [sys.executable, "-c", WITHOUT, ",".join(modules_of_extras(wheel)), "convert push.mcap copy.mcap"]
    environment = {"PYTHONPATH": str(tmp_path), "NO_COLOR": "1"}
    done = subprocess.run([*words, *lacking.values()], cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    place, *_, codes = done.stdout.splitlines()
    assert Path(place).is_relative_to(tmp_path)
    assert codes == "[0, 2, 2]"
    for extra, line in zip(lacking, done.stderr.splitlines(), strict=True):
        assert line.endswith(f"pip install palpate[{extra}]")


def modules_of_extras(wheel: Path) -> list[str]:
    """The modules that only extras bring, as the wheel's metadata says it."""
    with zipfile.ZipFile(wheel) as packed:
        (name,) = (name for name in packed.namelist() if name.endswith(".dist-info/METADATA"))
        said = Parser().parsestr(packed.read(name).decode()).get_all("Requires-Dist", [])
    always, extras = set(), set()
    for requirement in said:
        name = re.split(r"[^\w.-]", requirement)[0]
        (extras if "extra ==" in requirement else always).add(plain(name))
    lacking = extras - always - {"palpate"}
    return [module for module, names in packages_distributions().items() if set(map(plain, names)) <= lacking]


def plain(name: str) -> str:
    return name.lower().replace("_", "-")


def test_the_page_on_the_index_has_absolute_links(tmp_path):
    steps = (ROOT / ".github/workflows/publish.yml").read_text().split("- name: ")
    (step,) = (each for each in steps if each.startswith("Links of the page"))
    script = step.partition("run: |\n")[2].partition("      - run:")[0]
    for name in ("README.md", "pyproject.toml"):
        (tmp_path / name).write_text((ROOT / name).read_text())
    names = {"GITHUB_REPOSITORY": "us/palpate", "GITHUB_REF_NAME": "v1"}
    subprocess.run(["bash", "-e", "-c", script], cwd=tmp_path, env=names | {"PATH": "/usr/bin:/bin"}, check=True)
    links = re.findall(r"\]\(([^)]*)\)", (tmp_path / "README.md").read_text())
    assert links and all(link.startswith("https://") for link in links), links
    assert "https://github.com/us/palpate/raw/v1/docs/demo.gif" in links
    assert 'Source = "https://github.com/us/palpate"' in (tmp_path / "pyproject.toml").read_text()
