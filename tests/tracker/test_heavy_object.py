"""An object so heavy that the tip sinks in by more than 3 mm, tracked from simulated touch images."""

import dataclasses
import importlib
from collections.abc import Iterator

import numpy as np
import pytest

import palpate
from palpate import Run, track


@pytest.fixture(scope="module")
def patched() -> Iterator[pytest.MonkeyPatch]:
    with pytest.MonkeyPatch.context() as patch:
        yield patch


@pytest.fixture(scope="module")
def heavy(tmp_path_factory, command, patched) -> Run:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")
    pushes = importlib.import_module("palpate_lab.simulate.pushes")
    usual = pushes.draw_settings

    def drawn(*given):
        return dataclasses.replace(usual(*given), mass=4.0, table_friction=0.35, gel_stiffness=3000.0)

    patched.setattr(pushes, "draw_settings", drawn)
    folder = tmp_path_factory.mktemp("heavy") / "simulated"
    options = ("--shape", "rectangle", "--count", 1, "--seconds", 6, "--seed", 79, "--ideal")
    assert command("simulate", folder, *options) == 0
    (path,) = folder.iterdir()
    recording = palpate.load_recording(path)
    assert recording.extra["indentation"].max() > 3e-3
    return track(recording)


def test_its_pose_is_in_the_region(heavy):
    assert heavy.summary["in_95_contact_share"] > 0.9
    assert heavy.summary["silently_wrong_share"] == 0.0


def test_the_reason_says_that_the_tip_has_sunk_in(heavy):
    deep = heavy.recording.extra["indentation"].ravel() > 3e-3
    told = np.array(["sunk in" in reason for reason in heavy.online.reason])
    assert np.mean(told[deep]) > 0.5
    assert not told[~np.asarray(heavy.online.contact)].any()
