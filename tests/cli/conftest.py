import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from recording_samples import BLIND, pushed

from palpate import write_recording

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_figures: None) -> Path:
    """A folder to work in, with push.mcap and blind.mcap, which has no ground truth."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    write_recording(pushed(), "push.mcap")
    write_recording(replace(pushed(), **BLIND), "blind.mcap")
    return tmp_path


@pytest.fixture
def succeeds(run_palpate: Run) -> Callable[..., str]:
    """Run a command that must succeed without a message; return its output."""

    def run(*words: object) -> str:
        code, out, err = run_palpate(*words)
        assert (code, err) == (0, "")
        return out

    return run


@pytest.fixture
def json_of(succeeds: Callable[..., str]) -> Callable[..., Any]:
    """Run a command with --json; return the object that it prints."""
    return lambda *words: json.loads(succeeds(*words, "--json"))
