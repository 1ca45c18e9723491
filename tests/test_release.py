"""What is released: two wheels that hold their package and nothing else, and work without what the extras bring."""

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email.parser import Parser
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from recording_samples import pushed

import palpate

ROOT = Path(__file__).resolve().parents[1]

# In a Python that finds neither some modules nor some distributions: runs commands and prints their exit codes.
WITHOUT = """
import sys
from importlib.machinery import PathFinder
class Finder(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name.partition(".")[0] in MISSING else super().find_spec(name, path, target)
    @classmethod
    def find_distributions(cls, *args):
        return [each for each in super().find_distributions(*args) if each.name not in MISSING]
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


def built(project: Path, name: str, folder: Path, wanted: tuple[str, ...]) -> Path:
    """Build the wheel of a distribution from its sdist, which holds the wanted files; return its path."""
    pytest.importorskip("hatchling", reason="hatchling is not installed: pip install palpate[dev]")
    hatchling(project, "sdist", folder)
    release = f"{name}-{palpate.__version__}"
    with tarfile.open(folder / f"{release}.tar.gz") as packed:
        packed.extraction_filter = lambda member, _: member  # of our own; Python 3.11.3 has no filters by name
        packed.extractall(folder)
    for file in wanted:
        assert (folder / release / file).is_file(), file
    hatchling(folder / release, "wheel", folder)
    return folder / f"{release}-py3-none-any.whl"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    wanted = ("README.md", "CHANGELOG.md", "CITATION.cff", "LICENSE", "tests/test_release.py")
    return built(ROOT, "palpate", tmp_path_factory.mktemp("release"), wanted)


@pytest.fixture(scope="module")
def lab_wheel(tmp_path_factory) -> Path:
    return built(ROOT / "lab", "palpate_lab", tmp_path_factory.mktemp("lab"), ("README.md", "LICENSE"))


def install(folder: Path, *wheels: Path) -> None:
    words = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", str(folder)]
    subprocess.run([*words, *map(str, wheels)], check=True)


def run_without(missing: list[str], folder: Path, *commands: str) -> "subprocess.CompletedProcess[str]":
    """Run commands of the wheels that are installed in a folder, in a Python without some modules."""
    words = [sys.executable, "-c", WITHOUT, ",".join(missing), *commands]
    environment = {"PYTHONPATH": str(folder), "NO_COLOR": "1"}
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, env=environment, check=True)


def contents(wheel: Path) -> set[str]:
    """Return the files of a wheel, without its metadata."""
    with zipfile.ZipFile(wheel) as packed:
        return {name for name in packed.namelist() if ".dist-info/" not in name}


def sources(folder: Path) -> set[str]:
    found = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    return {name for name in found if "__pycache__" not in name}


def test_each_wheel_holds_its_package_and_nothing_else(wheel, lab_wheel):
    assert contents(wheel) == sources(ROOT / "src")
    assert contents(lab_wheel) == sources(ROOT / "lab" / "src")
    assert (ROOT / "lab" / "LICENSE").read_text() == (ROOT / "LICENSE").read_text()


def test_palpate_and_its_laboratory_have_one_version():
    laboratory = tomllib.loads((ROOT / "lab" / "pyproject.toml").read_text())["project"]
    assert laboratory["version"] == palpate.__version__
    assert laboratory["dependencies"] == [f"palpate[camera]=={palpate.__version__}"]


def test_palpate_alone_tracks_and_names_what_the_laboratory_needs(wheel, tmp_path):
    install(tmp_path, wheel)
    assert (tmp_path / "bin" / "palpate").exists()
    palpate.write_recording(pushed(), tmp_path / "push.mcap")
    missing = ["palpate-lab", "palpate_lab", *modules_of_extras(wheel)]
    done = run_without(missing, tmp_path, "convert push.mcap copy.mcap", "simulate out", "tune . --out noise.json")
    place, *_, codes = done.stdout.splitlines()
    assert Path(place).is_relative_to(tmp_path)
    assert codes == "[0, 2, 2]"
    simulate, tune = done.stderr.splitlines()
    assert "simulate" in simulate and simulate.endswith("pip install 'palpate-lab[sim]'")
    assert "tune" in tune and tune.endswith("pip install 'palpate-lab'")


def test_the_laboratory_works_without_its_extras(wheel, lab_wheel, tmp_path):
    install(tmp_path, wheel, lab_wheel)
    done = run_without(modules_of_extras(lab_wheel), tmp_path, "simulate out", "train . --out out")
    assert done.stdout.splitlines()[-1] == "[2, 2]"
    simulate, train = done.stderr.splitlines()
    assert "pip install 'palpate-lab[sim]'" in simulate and "pip install 'palpate-lab[train]'" in train


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
