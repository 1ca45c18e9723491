import json
from dataclasses import asdict, fields, replace

import pytest

from palpate.errors import FileError, SettingError
from palpate.graph.noise import PRESETS, PUBLISHED, GraphNoise
from palpate.graph.noise_file import FORMAT, VERSION, noise_of, read_noise, write_noise

CHANGED = replace(PUBLISHED, contact=0.1 + 0.2, sensor=(1e-5, 2e-5, 3e-4), sticking_kernel=1.5, grip=(0.5, 0.2))


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
    assert (content["format"], content["version"], content["tuned"]) == ("palpate-noise", 1, {"evaluations": 3})
    assert list(content["noise"]) == [field.name for field in fields(GraphNoise)]
    assert content["noise"]["contact_kernel"] is None  # the published settings have none
    assert content["noise"]["cone_share"] is None
    assert content["noise"]["grip"] == [0.5, 0.2]
    with pytest.raises(FileError, match="already exists"):
        write_noise(GraphNoise(), path, {})
    assert read_noise(path) == CHANGED
    write_noise(GraphNoise(), path, {}, overwrite=True)
    assert read_noise(path) == GraphNoise()
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_file_leaves_out_has_its_default(tmp_path):
    assert read_noise(write(tmp_path / "few.json", noise={"contact": 1})) == replace(GraphNoise(), contact=1.0)
    assert type(read_noise(tmp_path / "few.json").contact) is float


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


@pytest.mark.parametrize(
    ("noise", "said"),
    [
        ({"contcat": 1e-3}, "noise 'contcat' is not known; known are tactile, constant,"),
        ({"sensor": [1e-4, 1e-4]}, "noise sensor is [0.0001, 0.0001]; it must be 3 finite numbers"),
        ({"sensor": 1e-4}, "noise sensor is 0.0001; it must be 3 finite numbers"),
        ({"sensor": [1e-4, "1e-4", 1e-3]}, "it must be 3 finite numbers"),
        ({"contact": float("nan")}, "noise contact is nan; it must be a finite number"),
        ({"contact": float("inf")}, "noise contact is inf; it must be a finite number"),
        ({"contact": 10**400}, "it must be a finite number"),
        ({"contact": "1"}, "noise contact is '1'; it must be a finite number"),
        ({"contact": True}, "noise contact is True; it must be a finite number"),
        ({"contact": None}, "noise contact is None; it must be a finite number"),
        ({"contact_kernel": [1.0]}, "noise contact_kernel is [1.0]; it must be a finite number or null"),
        ({"contact": -1e-3}, "noise contact is -0.001; it must be finite and above 0"),
        ({"cone_share": "1"}, "noise cone_share is '1'; it must be a finite number or null"),
        ({"sliding_share": None}, "noise sliding_share is None; it must be a finite number"),
        ({"grip": 0.4}, "noise grip is 0.4; it must be 2 finite numbers"),
        ({"grip": [0.4, 0.0]}, "noise grip is (0.4, 0.0); it must be finite and above 0"),
        ({"pushing_kernel": 1.0}, "noise 'pushing_kernel' is not known"),  # of an older palpate
        ({"rest": [0.0, 1.0, 1.0]}, "noise rest is (0.0, 1.0, 1.0); it must be finite and above 0"),
    ],
)
def test_settings_that_are_wrong(tmp_path, noise, said):
    assert said in failure(write(tmp_path / "bad.json", noise=noise))


def test_files_that_are_wrong(tmp_path):
    path = tmp_path / "bad.json"
    assert "format is None, expected 'palpate-noise'" in failure(write(path, format=None))
    for version in (2, 0, "1", True, None):
        assert f"version is {version!r}, this palpate reads up to version 1" in failure(write(path, version=version))
    assert "noise is [1], expected an object of settings" in failure(write(path, noise=[1]))
    path.write_text("{")
    assert "is not valid JSON" in failure(path)
    path.write_text("[]")
    assert "expected an object" in failure(path)
    path.unlink()
    assert "no such file" in failure(path)
