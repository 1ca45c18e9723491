"""A share of what `make fuzz` does that takes a moment, and all that it has found."""

from pathlib import Path

import pytest
from fuzzing.readers import READERS, outcome
from fuzzing.worker import changed_file, seeds_of

CORPUS = Path(__file__).parents[1] / "corpus"
"""What readers failed on, by the name of the reader."""
SHARE = 6
LIBRARIES = {"dxf": "ezdxf", "svg": "svgelements"}
"""What a reader needs that may not be installed."""


@pytest.mark.parametrize("name", READERS)
def test_changed_files_are_read_or_refused(tmp_path, name):
    if name in LIBRARIES:
        pytest.importorskip(LIBRARIES[name])
    reader = READERS[name]
    seeds = seeds_of(reader, tmp_path / "seeds")
    path = tmp_path / f"file{reader.suffix}"
    said = set()
    for number in range(SHARE):
        path.write_bytes(changed_file(name, seeds, number))
        said.add(outcome(reader, path))
    assert len(said) > 1 or name == "packet"


@pytest.mark.parametrize("file", sorted(CORPUS.glob("*/*")), ids=lambda file: f"{file.parent.name}/{file.name}")
def test_what_was_found_stays_mended(tmp_path, file, monkeypatch):
    monkeypatch.setenv("PALPATE_MAX_SECONDS", "1")  # one of them holds the HDF5 library up
    reader = READERS[file.parent.name]
    if file.parent.name in LIBRARIES:
        pytest.importorskip(LIBRARIES[file.parent.name])
    path = tmp_path / f"file{reader.suffix}"
    path.write_bytes(file.read_bytes())
    outcome(reader, path)
