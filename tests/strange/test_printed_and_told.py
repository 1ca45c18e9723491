"""What files say never moves a terminal's cursor or becomes a formula, and a full disk is one sentence."""

import errno
import json
import logging
from pathlib import Path

import numpy as np
import pytest
from recording_samples import pushed
from study_samples import drawn_trial, with_summary

from palpate.cli import main
from palpate.cli.console import complain, print_line, print_table
from palpate.errors import FileError
from palpate.io.recording_mcap import write_recording
from palpate.lab.study.comparison import read_scores
from palpate.lab.study.results import write_results
from palpate.lab.study.trial import Method
from palpate.printable import PrintableFormatter, printable
from palpate.touch.model import NETWORKS, SHIPPED, TouchModel, fingerprint
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile

EVIL = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202egnp.exe\x08\r"


def is_harmless(text):
    return not any((ord(each) < 32 and each != "\n") or 127 <= ord(each) < 160 or each == "\u202e" for each in text)


def test_control_characters_are_spelt():
    assert printable("\x1b[31mred\x07 ü\n\ttab") == r"\x1b[31mred\x07 ü" + "\n" + r"\ttab"
    assert printable("\udcff\u202e") == r"\udcff\u202e"
    assert printable("naïve 日本 \U0001f600") == "naïve 日本 \U0001f600"


def test_a_message_does_not_quote_a_file_at_length():
    said = str(FileError("push.mcap: noise has no '" + 150_000 * "x" + "'; known are sticking, balance"))
    assert (
        len(said) < 2000
        and said.startswith("push.mcap: noise has no 'xxx")
        and said.endswith("known are sticking, balance")
    )
    assert str(FileError("push.mcap: is empty")) == "push.mcap: is empty"


def test_nothing_that_is_printed_moves_the_cursor(capsys):
    print_table(EVIL, ("what", "value"), [(EVIL, EVIL)])
    print_line(EVIL)
    complain(EVIL)
    complain(FileError(EVIL))
    said = capsys.readouterr()
    assert is_harmless(said.out) and is_harmless(said.err) and r"\x1b[2J" in said.out
    record = logging.LogRecord("a", logging.WARNING, "", 0, "%s", (EVIL,), None)
    assert is_harmless(PrintableFormatter("palpate: %(message)s").format(record))


def test_errors_are_harmless_in_anybodys_terminal():
    assert is_harmless(str(FileError(EVIL)))
    with pytest.raises(FileError, match=r"\\x1b\[2J"):
        raise FileError(EVIL)


def test_info_of_a_strangers_recording(tmp_path, capsys):
    plain = pushed(5)
    sensor = SensorProfile(name=EVIL, radius=0.01)
    made = Recording(plain.time, plain.sensor_pose, plain.shape, sensor, source=EVIL, frames={EVIL: EVIL})
    write_recording(made, tmp_path / "a.mcap")
    assert main.main(["info", str(tmp_path / "a.mcap")]) == 0
    said = capsys.readouterr()
    assert is_harmless(said.out) and is_harmless(said.err) and "owned" in said.out
    assert main.main(["info", str(tmp_path / "a.mcap"), "--json"]) == 0
    said = capsys.readouterr().out
    assert is_harmless(said) and json.loads(said)["source"] == EVIL


@pytest.mark.parametrize("name", ["=1+1.mcap", "+a.mcap", "-a.mcap", "@a.mcap", "\ta.mcap", "'a.mcap", "a.mcap"])
def test_no_cell_begins_a_formula(tmp_path, name):
    trial = with_summary(drawn_trial(Method("none", "fixed-lag"), seconds=1.0))
    object.__setattr__(trial, "recording", name)
    write_results(tmp_path, {}, [trial])
    text = (tmp_path / "sequences.csv").read_text()
    for line in text.splitlines()[1:]:
        assert not line.lstrip('"').startswith(("=", "+", "-", "@", "\t"))
    said = {"format": "palpate-study", "version": 1, "made_with": {}, "recordings": {}}
    (tmp_path / "study.json").write_text(json.dumps(said))
    assert [recording for recording, _ in read_scores(tmp_path)] == [name]


def test_a_full_disk_is_one_sentence(tmp_path, capsys, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device", "log.csv")

    monkeypatch.setitem(main.COMMANDS, "info", lambda: full())
    assert main.main(["info"]) == 2
    said = capsys.readouterr().err
    assert said == "palpate: [Errno 28] No space left on device: 'log.csv'\n"
    with pytest.raises(OSError, match="No space left"):
        main.main(["info", "--debug"])


@pytest.fixture
def model(tmp_path):
    """The shipped model, and a way to change it whose hash is right."""

    def change(name="", network=b"", **settings):
        networks = {each: (SHIPPED / f"{each}.onnx").read_bytes() for each in NETWORKS}
        if name:
            networks[name] = network
        said = json.loads((SHIPPED / "model.json").read_text())
        said["settings"] |= settings
        said["hash"] = fingerprint(said["settings"], networks)
        (tmp_path / "model.json").write_text(json.dumps(said))
        for each, data in networks.items():
            (tmp_path / f"{each}.onnx").write_bytes(data)
        return tmp_path

    return change


@pytest.mark.parametrize(
    "settings",
    [
        {"spread": []},
        {"spread": {"turn": {"scale": 1.0, "together": 1.0}}},
        {"spread": {name: {"scale": "x", "together": 1.0} for name in ("direction", "turn", "pair", "linear")}},
        {"image_height": None},
        {"linear": [[1.0, 2.0]]},
        {"linear": [[1.0]] * 5},
        {"linear": "words"},
        {"sensor": 3},
        {"more": 1},
    ],
)
def test_settings_of_a_model_with_a_right_hash_are_checked(model, settings):
    with pytest.raises(FileError, match=r"model\.json: settings do not fit this version"):
        TouchModel(model(**settings))


@pytest.mark.parametrize("network", [b"\x08\x07garbage", b"", (SHIPPED / "keypoint.onnx").read_bytes()])
def test_a_network_that_is_none_is_one_sentence(model, network):
    with pytest.raises(FileError, match=r"pair\.onnx: (is no network|is empty|takes and gives)"):
        TouchModel(model("pair", network)).compare(np.zeros((2, 16), np.float32), np.zeros(16, np.float32))


def test_a_network_that_keeps_its_numbers_elsewhere_is_refused(model, tmp_path):
    import onnx

    network = onnx.load_from_string((SHIPPED / "pair.onnx").read_bytes())
    secret = tmp_path / "secret.bin"
    onnx.save_model(network, tmp_path / "a.onnx", save_as_external_data=True, location=secret.name, size_threshold=0)
    assert Path(secret).stat().st_size > 0
    with pytest.raises(FileError, match=r"pair\.onnx: keeps its numbers in another file, which is not opened"):
        TouchModel(model("pair", (tmp_path / "a.onnx").read_bytes()))
