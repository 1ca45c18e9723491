"""Every reader of files: small real files for it, and how it is called."""

import gzip
import json
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bag_samples import push_messages, write_bag
from mcap.writer import CompressionType, Writer
from recording_samples import TINY_CAMERA, pushed, tiny_images, tiny_recording, trajectory
from study_samples import drawn_trial

from palpate import io as formats
from palpate.config import NoiseSettings, read_noise, write_noise
from palpate.errors import PalpateError
from palpate.geometry.shapes import Disc, Rectangle
from palpate.io.bags.bag_recording import read_bag
from palpate.io.bags.contents import contents
from palpate.io.outlines.load import load_shape
from palpate.lab.study.comparison import read_scores
from palpate.lab.study.trial import Method, read_trial, write_trial
from palpate.live.sources import pose_in_packet as pose_in
from palpate.pipeline.details import read_answers, read_friction
from palpate.pipeline.inspection import inspect_recording
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration, load_calibration, write_calibration
from palpate.touch.model import NETWORKS, SHIPPED, TouchModel, fingerprint
from palpate.touch.press_files import read_presses
from palpate.types.images import decode_image, encode_image
from palpate.types.recording import Recording


@dataclass(frozen=True)
class Reader:
    """A reader of files."""

    seeds: Callable[[Path], list[Path]]
    """Writes small files that it reads into a folder."""
    read: Callable[[Path], Any]
    """Reads a file, and does with what it holds what is done first; PalpateError where it cannot."""
    suffix: str = ""
    """What the name of a file has to end with."""


def recordings(folder: Path) -> list[Path]:
    """Recordings of palpate, with images and without."""
    many = tiny_recording(3, extra={"force": np.arange(3.0), "on": np.ones((3, 2), bool)})
    for name, recording in {"a": many, "b": pushed(6)}.items():
        formats.write(recording, folder / f"{name}.h5")
    return sorted(folder.glob("*.h5"))


def read_recording(path: Path) -> None:
    """Read a file of any format, as `palpate info` does: what it holds is looked into."""
    formats.detect_format(path)
    data = formats.read(path)
    if isinstance(data, Recording):
        for frame in data:
            assert frame.time is not None
        inspect_recording(data)


def mits(folder: Path) -> list[Path]:
    """MIT pushes, one of them packed."""
    time = 1.0 + np.arange(50) * 1e-3
    pusher = np.array([np.full(50, 0.3), 0.05 * time])
    fields = {
        "q_pusher_sensed": pusher,
        "q_slider": np.array([pusher[0], pusher[1] + 0.05, np.zeros(50)]),
        "time": time,
    }
    text = json.dumps({f"{name}JSON": np.round(value, 5).tolist() for name, value in fields.items()}).encode()
    (folder / "a.json").write_bytes(text)
    (folder / "b.json.gz").write_bytes(gzip.compress(text))
    return [folder / "a.json", folder / "b.json.gz"]


def theseus(folder: Path) -> list[Path]:
    """Pushes of the Theseus example, in a list and in episodes."""
    formats.write(pushed(40, Disc(0.05)), folder / "a.json")
    said = json.loads((folder / "a.json").read_text())
    nested = {key: [value] if isinstance(value, list) else value for key, value in said.items()}
    (folder / "b.json").write_text(json.dumps(nested))
    return [folder / "a.json", folder / "b.json"]


def cmu(folder: Path) -> list[Path]:
    """A log of the two-finger hand."""
    rows = [(1495591576.0 + 0.03 * i, 28.0 + i, 1.0, 0.0, 0.6 * i, 0.0, 0.0, 1 + i // 10) for i in range(20)]
    (folder / "a.txt").write_text("".join(",".join(f"{value:.4f}" for value in row) + "\n" for row in rows))
    return [folder / "a.txt"]


def written(suffix: str) -> Callable[[Path], list[Path]]:
    """Trajectories in one of palpate's formats."""

    def write(folder: Path) -> list[Path]:
        for name, made in {"a": trajectory(8), "b": trajectory(3, covariance=None, contact=None, status=None)}.items():
            formats.write(made, folder / f"{name}{suffix}")
        return sorted(folder.glob(f"*{suffix}"))

    return write


def own_mcaps(folder: Path) -> list[Path]:
    """What palpate writes to MCAP."""
    formats.write(tiny_recording(3), folder / "a.mcap")
    formats.write(trajectory(3), folder / "b.mcap")
    return [folder / "a.mcap", folder / "b.mcap"]


def small_push() -> Any:
    """Some messages of a push, with tiny images."""
    messages = push_messages()
    for message in messages:
        if message.type.endswith("CompressedImage"):
            message.content["data"] = np.frombuffer(encode_image(tiny_images(1)[0], "png"), np.uint8)
    return [message for message in messages if message.log_time < messages[0].log_time + 300_000_000]


def mcaps(folder: Path) -> list[Path]:
    """Bags of others, packed and plain, whose checksums do not keep anybody from reading on."""
    packed = write_bag(folder / "packed", "mcap", small_push())
    found = [packed]
    for compression in (CompressionType.NONE, CompressionType.LZ4):
        path = folder / f"{compression.name}.mcap"
        _rewritten(packed, path, compression)
        found.append(path)
    return found


def _rewritten(source: Path, path: Path, compression: CompressionType) -> None:
    from mcap.reader import make_reader

    with source.open("rb") as file, path.open("wb") as made:
        writer = Writer(made, compression=compression, enable_crcs=False, chunk_size=4096)
        writer.start()
        numbers: dict[int, int] = {}
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.id not in numbers:
                assert schema is not None
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(numbers[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()


def databases(folder: Path) -> list[Path]:
    """A database of ROS 2, as small as it gets."""
    found = next(write_bag(folder / "bag", "ros2", small_push()).glob("*.db3"))
    with closing(sqlite3.connect(found)) as opened:
        opened.execute("update message_definitions set encoded_message_definition = ''")
        opened.commit()
        opened.execute("vacuum")
    return [found]


def ros1(folder: Path) -> list[Path]:
    """A bag of ROS 1."""
    return [write_bag(folder / "a", "ros1", small_push())]


def read_any_bag(path: Path) -> None:
    """What a bag holds, and it as a recording."""
    contents(path)
    read_bag(path, Disc(0.05), sensor=TINY_CAMERA)


def calibrations(folder: Path) -> list[Path]:
    """What is known of a sensor unit."""
    level = np.full((4, 3, 3), 7.0, np.float32)
    write_calibration(Calibration(Background(level, level)), folder / "a.npz")
    return [folder / "a.npz"]


def trials(folder: Path) -> list[Path]:
    """A trial of a study."""
    write_trial(drawn_trial(Method("none", "fixed-lag"), seconds=0.5), folder / "a.npz")
    return [folder / "a.npz"]


def models(folder: Path) -> list[Path]:
    """The settings of a touch model, and one of its networks."""
    for name in ("model.json", "pair.onnx"):
        shutil.copy(SHIPPED / name, folder / name)
    return [folder / "model.json", folder / "pair.onnx"]


def read_model(path: Path) -> None:
    """Open a model in which one file is another, and the hash is right for it."""
    folder = path.with_name("model")
    folder.mkdir(exist_ok=True)
    data = path.read_bytes()
    networks = {name: (SHIPPED / f"{name}.onnx").read_bytes() for name in NETWORKS}
    said = (SHIPPED / "model.json").read_bytes()
    if data.lstrip()[:1] == b"{":
        said = data
    else:
        networks["pair"] = data
    try:
        plain = json.loads(said)
        plain["hash"] = fingerprint(plain["settings"], networks)
        said = json.dumps(plain).encode()
    except (ValueError, RecursionError, TypeError, KeyError, IndexError):
        pass
    (folder / "model.json").write_bytes(said)
    for name, network in networks.items():
        (folder / f"{name}.onnx").write_bytes(network)
    model = TouchModel(folder)
    descriptor = np.zeros((2, 16), np.float32)
    model.compare(descriptor, descriptor[0])


def noises(folder: Path) -> list[Path]:
    """Noise settings."""
    write_noise(NoiseSettings(), folder / "a.json", {})
    return [folder / "a.json"]


def outlines(folder: Path) -> list[Path]:
    """Corners as a table and as JSON."""
    (folder / "a.txt").write_text("-0.1 -0.1\n0.1 -0.1\n0.1 0.1\n-0.1 0.1\n")
    (folder / "b.json").write_text(json.dumps({"vertices": Rectangle(0.1, 0.2).corners.tolist()}))
    return [folder / "a.txt", folder / "b.json"]


def read_outline(path: Path) -> None:
    """Read an outline by the kind of file that it is."""
    kind = path.with_suffix(".json" if path.read_bytes().lstrip()[:1] == b"{" else ".txt")
    path.replace(kind)
    load_shape(kind)


def svgs(folder: Path) -> list[Path]:
    """A drawing of a rounded outline, in groups with transforms."""
    drawn = '<g transform="translate(10,10) rotate(5)"><path d="M0,0 L60,0 C80,10 80,30 60,40 L0,40 Z"/></g>'
    page = f'<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="100mm" viewBox="0 0 100 100">{drawn}</svg>'
    (folder / "a.svg").write_text(page)
    return [folder / "a.svg"]


def dxfs(folder: Path) -> list[Path]:
    """A drawing of one closed line, of the version that has the fewest words."""
    import ezdxf

    drawing = ezdxf.new("R12")  # pyright: ignore[reportPrivateImportUsage]
    drawing.header["$INSUNITS"] = 4
    drawing.modelspace().add_polyline2d([(0, 0), (60, 0), (60, 40), (0, 40)], close=True)
    drawing.saveas(folder / "a.dxf")
    return [folder / "a.dxf"]


def images(folder: Path) -> list[Path]:
    """A PNG and JPEGs."""
    pixels = tiny_images(1)[0]
    for name in ("png", "jpeg"):
        (folder / f"a.{name}").write_bytes(encode_image(pixels, name))
    return [folder / "a.jpeg", folder / "a.png"]


def presses(folder: Path) -> list[Path]:
    """A table of presses and an image it names."""
    (folder / "a.csv").write_text("file,angle_deg\n" + "".join(f"a.png,{angle}\n" for angle in range(-20, 21, 10)))
    return [folder / "a.csv"]


def read_press_table(path: Path) -> None:
    """Read a table of presses beside the image that it names."""
    path.with_name("a.png").write_bytes(encode_image(tiny_images(1)[0], "png"))
    read_presses(path)


def details(folder: Path) -> list[Path]:
    """Friction and other answers over a run."""
    (folder / "a.csv").write_text("time,friction,deviation\n0.0,0.5,0.1\n1.0,0.5,0.1\n")
    columns = "time,weight,x,y,theta,xx,xy,xtheta,yy,ytheta,thetatheta"
    (folder / "b.csv").write_text(f"{columns}\n0.0,0.5,1,2,3,1,0,0,1,0,1\n1.0,0.5,1,2,3,1,0,0,1,0,1\n")
    return [folder / "a.csv", folder / "b.csv"]


def read_details(path: Path) -> None:
    """Read a file as one and as the other."""
    time = np.array([0.0, 1.0])
    if b"friction" in path.read_bytes():
        read_friction(path, time)
    else:
        read_answers(path, time)


def scores(folder: Path) -> list[Path]:
    """The table of a study, and what the study was made with."""
    columns = "recording,tactile,smoother,final_translation_error_mm,final_rotation_error_deg"
    columns += ",translation_rmse_mm,rotation_rmse_deg,in_95_contact_share,recovered_in_2s"
    (folder / "a.csv").write_text(f"{columns}\na.h5,learnt,fixed-lag,1.0,2.0,3.0,4.0,0.9,True\n")
    (folder / "b.json").write_text(
        json.dumps({"format": "palpate-study", "version": 1, "made_with": {}, "recordings": {}})
    )
    return [folder / "a.csv", folder / "b.json"]


def read_score(path: Path) -> None:
    """Read a study in which one file is this one."""
    folder = path.with_name("study")
    folder.mkdir(exist_ok=True)
    for name, data in zip(("sequences.csv", "study.json"), scores(path.parent), strict=True):
        shutil.copy(data, folder / name)
    is_json = path.read_bytes().lstrip()[:1] == b"{"
    shutil.copy(path, folder / ("study.json" if is_json else "sequences.csv"))
    read_scores(folder)


def packets(folder: Path) -> list[Path]:
    """A pose as it comes by UDP."""
    (folder / "a.json").write_text(json.dumps({"time": 1.0, "pose": [0.1, 0.2, 0.3]}))
    return [folder / "a.json"]


READERS = {
    "recording": Reader(recordings, read_recording),
    "mit-push": Reader(mits, read_recording),
    "theseus-json": Reader(theseus, read_recording),
    "cmu-two-finger": Reader(cmu, read_recording),
    "tum": Reader(written(".tum"), read_recording),
    "estimates-csv": Reader(written(".csv"), read_recording),
    "own-mcap": Reader(own_mcaps, read_recording),
    "mcap": Reader(mcaps, read_any_bag),
    "ros2": Reader(databases, read_any_bag, ".db3"),
    "ros1": Reader(ros1, read_any_bag),
    "calibration": Reader(calibrations, load_calibration),
    "trial": Reader(trials, read_trial),
    "model": Reader(models, read_model),
    "noise": Reader(noises, read_noise),
    "outline": Reader(outlines, read_outline),
    "svg": Reader(svgs, load_shape, ".svg"),
    "dxf": Reader(dxfs, lambda path: load_shape(path, "mm"), ".dxf"),
    "image": Reader(images, lambda path: decode_image(path.read_bytes(), "png", (12, 8))),
    "presses": Reader(presses, read_press_table),
    "details": Reader(details, read_details),
    "scores": Reader(scores, read_score),
    "packet": Reader(packets, lambda path: pose_in(path.read_bytes(), 1.0)),
}


def outcome(reader: Reader, path: Path) -> str:
    """ "read", or the one sentence that a file is refused with; anything else is raised.

    A refusal because memory ran out is a fault too: what a file asks for is to be looked at before.
    """
    try:
        reader.read(path)
    except PalpateError as error:
        cause: BaseException | None = error
        while cause is not None:
            if isinstance(cause, MemoryError):
                raise
            cause = cause.__cause__
        said = str(error)
        if "\n" in said or len(said) > 2000:
            raise AssertionError(f"not one sentence: {said[:500]!r}") from error
        return said
    return "read"
