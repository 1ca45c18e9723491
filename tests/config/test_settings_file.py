import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import pytest
from push_samples import with_settings

from palpate.config.settings import PRESETS, PUBLISHED, NoiseSettings
from palpate.config.settings_file import FORMAT, VERSION, noise_from_dict, noise_of, read_noise, write_noise
from palpate.errors import FileError, SettingError

CHANGED = with_settings(
    PUBLISHED,
    contact={"deviation": 0.1 + 0.2},
    sensor_pose={"deviation": (1e-5, 2e-5, 3e-4), "calibration": (0.0, 2e-3, 0.1)},
    sticking={"kernel": 1.5},
    priors={"grip": (0.5, 0.2), "friction_center": (0.1, 0.2)},
)


def write(path, **changes):
    path.write_text(json.dumps({"format": FORMAT, "version": VERSION, "noise": asdict(CHANGED), **changes}))
    return path


def failure(path) -> str:
    with pytest.raises(FileError) as caught:
        read_noise(path)
    said = str(caught.value)
    assert said.startswith(f"{path}: ") and "\n" not in said
    return said.removeprefix(f"{path}: ")


def test_a_file_holds_every_setting_to_the_last_digit(tmp_path):
    path = tmp_path / "noise.json"
    write_noise(CHANGED, path, {"evaluations": 3})
    assert read_noise(path) == CHANGED
    content = json.loads(path.read_text())
    assert (content["format"], content["version"], content["tuned"]) == ("palpate-noise", 2, {"evaluations": 3})
    noise = content["noise"]
    assert list(noise) == [field.name for field in fields(NoiseSettings)]
    assert all(list(noise[name]) == [each.name for each in fields(getattr(CHANGED, name))] for name in noise)
    assert noise["contact"] == {"deviation": 0.1 + 0.2, "kernel": None}  # the published settings have none
    assert noise["friction_cone"]["share"] is None
    assert noise["priors"]["grip"] == [0.5, 0.2]
    with pytest.raises(FileError, match="already exists"):
        write_noise(NoiseSettings(), path, {})
    assert read_noise(path) == CHANGED
    write_noise(NoiseSettings(), path, {}, overwrite=True)
    assert read_noise(path) == NoiseSettings()
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_file_leaves_out_has_its_default(tmp_path):
    path = write(tmp_path / "few.json", noise={"contact": {"deviation": 1}, "turn": {}})
    assert read_noise(path) == with_settings(NoiseSettings(), contact={"deviation": 1.0})
    assert type(read_noise(path).contact.deviation) is float


OLD: dict[str, Any] = {
    "tactile": [1.0, 1.1, 0.07],
    "constant": [1.2, 1.3, 4.0],
    "sticking": 3e-5,
    "sticking_share": 0.07,
    "sliding_share": 1.9,
    "cone_margin": 0.05,
    "cone_width": 0.02,
    "cone_share": 0.14,
    "sticking_kernel": 2.5,
    "turning": 3e-7,
    "turning_share": 0.014,
    "turning_kernel": None,
    "friction_ratio": [0.1, 0.6],
    "friction_center": 0.07,
    "grip": [0.5, 0.2],
    "depth": [2e-4, 3e-4],
    "direction_bias": 0.02,
    "direction_share": 1.9,
    "turn_share": 80.0,
    "contact": 2e-3,
    "contact_kernel": 3.5,
    "feeling_kernel": 2.9,
    "sensor": [1.5e-4, 2e-4, 2e-3],
    "first_pose": [6e-4, 7e-4, 6e-3],
    "rest": [2e-5, 3e-5, 2e-4],
}
"""All settings of a file of version 1, none of them a default."""


def test_a_file_of_version_1_is_still_read(tmp_path):
    read = read_noise(write(tmp_path / "old.json", version=1, noise=OLD))
    assert asdict(read) == {
        # Which version 1 had not.
        "sensor_pose": {"deviation": (1.5e-4, 2e-4, 2e-3), "calibration": (1e-3, 1e-3, 9e-3)},
        # Version 1 did not tell a stated pose from a true one.
        "first_pose": {"deviation": (6e-4, 7e-4, 6e-3), "truth": (6e-4, 7e-4, 6e-3), "rest": (2e-5, 3e-5, 2e-4)},
        "contact": {"deviation": 2e-3, "kernel": 3.5},
        "direction": {"share": 1.9, "kernel": 2.9},
        "place": {"share": 2.0, "kernel": 3.0},  # which version 1 had not
        "turn": {"share": 80.0, "kernel": 2.9},
        "relative_pose": {"oracle": (1.0, 1.1, 0.07), "constant": (1.2, 1.3, 4.0), "linear": None},
        "sticking": {
            "still": 3e-5,
            "share": 0.07,
            "sliding_share": 1.9,
            "margin": 0.05,
            "width": 0.02,
            "kernel": 2.5,
        },
        "balance": {"still": 3e-7, "share": 0.014, "load": 0.8, "kernel": None},  # load is new, too
        "friction_cone": {"still": 3e-5, "share": 0.14, "width": 0.02, "kernel": None},
        "priors": {
            "direction_bias": (0.0, 0.02),
            "direction_scale": (0.0, 0.06),  # nor this
            "place_bias": (0.0, 1.2e-3),  # nor this
            "depth": (2e-4, 3e-4),
            "outline_scale": (0.0, 0.007),  # nor this
            "friction_ratio": (0.1, 0.6),
            "friction_center": (0.0, 0.07),
            "grip": (0.5, 0.2),
        },
    }
    # And what it leaves out has its default.
    few = read_noise(write(tmp_path / "few.json", version=1, noise={"cone_share": None}))
    assert few == with_settings(NoiseSettings(), friction_cone={"share": None})
    assert "noise 'contcat' is not known; known are tactile, constant," in failure(
        write(tmp_path / "bad.json", version=1, noise={"contcat": 1e-3})
    )
    assert "contact.deviation is -0.001; it must be a finite number above 0" in failure(
        write(tmp_path / "bad.json", version=1, noise={"contact": -1e-3})
    )


def test_the_studys_settings_are_still_read():
    path = Path(__file__).parents[2] / "docs" / "study" / "tuning.json"
    wanted = json.loads(path.read_text())
    found = read_noise(path)
    if wanted["version"] == 1:
        assert found.sticking.share == wanted["noise"]["sticking_share"]
        assert found.priors.friction_ratio == tuple(wanted["noise"]["friction_ratio"])
    else:
        assert found.sticking.share == wanted["noise"]["sticking"]["share"]
        assert found.priors.friction_ratio == tuple(wanted["noise"]["priors"]["friction_ratio"])


def test_a_preset_or_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert all(noise_of(name) == preset for name, preset in PRESETS.items())
    assert noise_of(str(write(tmp_path / "mine.json"))) == CHANGED
    (tmp_path / "published").write_text("not the preset")
    assert noise_of("published") == PUBLISHED
    with pytest.raises(SettingError, match="allowed are 'palpate', 'sticking', 'published' or a file of"):
        noise_of("magic")
    with pytest.raises(FileError, match="is a folder"):
        noise_of(str(tmp_path))


ABOVE = "it must be a finite number above 0"
THREE = "it must be 3 finite numbers above 0"
GROUPS = (
    "sensor_pose, first_pose, contact, direction, place, turn, relative_pose, sticking, balance, friction_cone, priors"
)


@pytest.mark.parametrize(
    ("noise", "said"),
    [
        ({"contcat": {}}, f"noise has no 'contcat'; known are {GROUPS}"),
        ({"contact": {"deviaton": 1e-3}}, "noise contact has no 'deviaton'; known are deviation, kernel"),
        ({"contact": 1e-3}, "noise contact is 0.001, expected an object of settings"),  # as version 1 has it
        ({"sensor_pose": {"deviation": [1e-4, 1e-4]}}, f"sensor_pose.deviation is [0.0001, 0.0001]; {THREE}"),
        (
            {"sensor_pose": {"calibration": [0.0, -1e-3, 0.0]}},
            "sensor_pose.calibration is [0.0, -0.001, 0.0]; it must be 3 finite numbers at least 0",
        ),
        ({"sensor_pose": {"deviation": 1e-4}}, f"sensor_pose.deviation is 0.0001; {THREE}"),
        ({"sensor_pose": {"deviation": [1e-4, "1e-4", 1e-3]}}, THREE),
        ({"contact": {"deviation": float("nan")}}, f"contact.deviation is nan; {ABOVE}"),
        ({"contact": {"deviation": float("inf")}}, f"contact.deviation is inf; {ABOVE}"),
        pytest.param({"contact": {"deviation": 10**400}}, ABOVE, id="huge"),
        ({"contact": {"deviation": "1"}}, f"contact.deviation is '1'; {ABOVE}"),
        ({"contact": {"deviation": True}}, f"contact.deviation is True; {ABOVE}"),
        ({"contact": {"deviation": None}}, f"contact.deviation is None; {ABOVE}"),
        ({"contact": {"kernel": [1.0]}}, f"contact.kernel is [1.0]; {ABOVE}, or None"),
        ({"contact": {"deviation": -1e-3}}, f"contact.deviation is -0.001; {ABOVE}"),
        (
            {"friction_cone": {"share": "1"}},
            "friction_cone.share is '1'; it must be a finite number at least 0, or None",
        ),
        ({"sticking": {"sliding_share": None}}, "sliding_share is None; it must be a finite number at least 0"),
        ({"priors": {"grip": 0.4}}, "priors.grip is 0.4; it must be a finite mean and a finite standard deviation"),
        ({"priors": {"grip": [0.4, 0.0]}}, "priors.grip is [0.4, 0.0]; it must be a finite mean and a finite standard"),
        ({"first_pose": {"rest": [0.0, 1.0, 1.0]}}, f"first_pose.rest is [0.0, 1.0, 1.0]; {THREE}"),
    ],
)
def test_settings_that_are_wrong(tmp_path, noise, said):
    assert said in failure(write(tmp_path / "bad.json", noise=noise))
    with pytest.raises(SettingError):
        noise_from_dict(noise)


def test_files_that_are_wrong(tmp_path):
    path = tmp_path / "bad.json"
    assert "format is None, expected 'palpate-noise'" in failure(write(path, format=None))
    for version in (3, 0, "1", True, None):
        assert f"version is {version!r}, this palpate reads up to version 2" in failure(write(path, version=version))
    assert "noise is [1], expected an object of settings" in failure(write(path, noise=[1]))
    path.write_text("{")
    assert "is not valid JSON" in failure(path)
    path.write_text("[]")
    assert "expected an object" in failure(path)
    path.unlink()
    assert "no such file" in failure(path)
