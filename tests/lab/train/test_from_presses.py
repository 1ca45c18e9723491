"""A model of directions alone, from presses on a wall."""

import contextlib
import dataclasses

import cv2
import numpy as np
import pytest
from pin_samples import PIN_DOME, draw_dome, press

from palpate.cli.main import main
from palpate.errors import FileError, SettingError
from palpate.lab.train import from_presses
from palpate.lab.train.from_presses import samples_of_presses, train_on_presses
from palpate.lab.train.samples import Samples
from palpate.lab.train.train import Bar, TrainSettings
from palpate.touch.background import Background
from palpate.touch.difference import difference, reduced
from palpate.touch.model import TouchModel
from palpate.touch.modes import chosen, make_touch
from palpate.touch.press_calibration import Presses
from palpate.types.frame import Frame
from palpate.types.measurements import ContactDirection

RNG = np.random.default_rng(0)
DOME = draw_dome(0)
STILL = press(DOME, None, RNG)
ANGLES = RNG.uniform(-0.7, 0.7, 60)
IMAGES = tuple(press(DOME, angle, RNG) for angle in ANGLES)
GIVEN = Presses(IMAGES, ANGLES, tuple(f"{i}.png" for i in range(60)))
SIGMAS = (1.0, 1.0, 1.0)


def test_the_way_from_a_table_of_grey_images_to_measurements(tmp_path, capsys):
    for name, image in zip(GIVEN.names, GIVEN.images, strict=True):
        cv2.imwrite(str(tmp_path / name), image[..., 0])
    cv2.imwrite(str(tmp_path / "still.png"), STILL[..., 0])
    table = tmp_path / "presses.csv"
    rows = [f"{name},{np.degrees(angle)}" for name, angle in zip(GIVEN.names, ANGLES, strict=True)]
    table.write_text("\n".join(["file,angle_deg", *rows]))
    out = tmp_path / "model"
    given = [str(table), "--untouched", str(tmp_path / "still.png"), "--out", str(out), "--steps", "2"]
    assert main(["train", *given]) == 2
    assert "presses take --untouched and --sensor" in capsys.readouterr().err
    of_no_use = ["--calibration", "gone.npz", "--workers", "3"]
    assert main(["train", *given, "--sensor", "pin dome", *of_no_use]) == 2
    assert "train: --calibration, --workers: of no use with presses (.csv)" in capsys.readouterr().err
    assert main(["train", *given, "--sensor", "pin dome"]) == 0
    assert "of 9 presses that were left out, directions are off by" in capsys.readouterr().out
    model = TouchModel(out)
    assert model.settings.sensor == "pin dome" and set(model.settings.spread) == {"direction"}
    assert sorted(path.name for path in out.glob("*.onnx")) == ["touch.onnx"]
    look = model.look(difference(IMAGES[0], reduced(STILL)))
    assert look.turn is look.descriptor is look.place is None
    gel = Background(STILL.astype(np.float32), np.ones(STILL.shape, np.float32))
    frame = Frame(0.0, np.zeros(3), IMAGES[0])
    for tactile in ("learnt", "learnt-direction"):
        (said,) = make_touch(tactile, PIN_DOME, SIGMAS, SIGMAS, model, lambda: gel).measure(frame)
        assert isinstance(said, ContactDirection)
    with pytest.raises(SettingError, match="learnt from presses, which tell directions alone"):
        make_touch("learnt-turn", PIN_DOME, SIGMAS, SIGMAS, model, lambda: gel)
    assert chosen(STILL, PIN_DOME, model)[0] == "learnt"  # though it is grey


def test_samples_are_of_presses_that_have_nothing_in_common():
    samples = samples_of_presses(GIVEN, [STILL])
    assert len(np.unique(samples.episode)) == 60
    np.testing.assert_array_equal(samples.direction, ANGLES)
    np.testing.assert_allclose(samples.difference[3], difference(IMAGES[3], reduced(STILL)), atol=5e-3)


def test_presses_that_a_model_is_judged_by_do_not_end_its_descent(tmp_path, monkeypatch):
    """Nor is it learnt from them; how far it is to be believed is measured on all that are not learnt from."""
    parts: list[set[int]] = []
    off = from_presses._off
    monkeypatch.setattr(from_presses, "learn_direction", lambda _, *given: parts.extend(map(numbers, given[:2])))
    monkeypatch.setattr(from_presses, "_off", lambda *given: parts.append(numbers(given[1])) or off(*given))
    settings = TrainSettings(steps=1)
    bar: Bar = lambda *_: contextlib.nullcontext(print)  # noqa: E731
    told = train_on_presses(GIVEN, [STILL], "dome", tmp_path / "model", bar, settings)
    learned, checked, scaled, judged = parts
    assert (len(learned), len(checked), len(judged), told["held_out"]) == (42, 9, 9, 9)
    assert learned.isdisjoint(checked | judged) and checked.isdisjoint(judged) and scaled == checked | judged


def numbers(samples: Samples) -> set[int]:
    return set(samples.episode.tolist())


@pytest.mark.parametrize(("field", "value"), [("steps", "0"), ("steps", "-5"), ("seed", "-1")])
def test_bad_settings_are_refused_for_presses_too(tmp_path, capsys, field, value):
    given = ["presses.csv", "--untouched", "still.png", "--sensor", "pin dome", "--out", str(tmp_path / "model")]
    assert main(["train", *given, f"--{field}", value]) == 2
    assert f"{field} is {value}; allowed is" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"images": IMAGES[:10], "angle": ANGLES[:10]}, "found 10 presses; at least 50"),
        ({"angle": 0.01 * ANGLES}, r"found presses within 0\.8 degrees"),
        (
            {"images": (*IMAGES[:-1], IMAGES[0][:100])},
            r"59\.png: image is \(100, 320\), the untouched",
        ),
    ],
)
def test_presses_that_cannot_be_learnt_from(tmp_path, changed, message):
    with pytest.raises(FileError, match=message):
        train_on_presses(dataclasses.replace(GIVEN, **changed), [STILL], "dome", tmp_path / "model", lambda *_: None)  # type: ignore[arg-type,return-value]
    assert not (tmp_path / "model").exists()


def test_a_press_moves_the_pins_near_it():
    for angle in (-0.5, 0.0, 0.5):
        moved = np.abs(press(DOME, angle, RNG).astype(float) - STILL).mean(axis=(0, 2))
        columns = np.arange(320)
        middle = (columns * (moved - moved.min())).sum() / (moved - moved.min()).sum()
        assert abs(middle - (159.5 + 100.0 * np.sin(angle))) < 40.0
