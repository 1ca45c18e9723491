"""A trained touch model on disk: ONNX networks and a JSON of settings in a folder; opening one runs no code of its own.

| file | from | to |
|---|---|---|
| touch.onnx | difference (1, 3, 32, 128) | direction (1, 2), turn (1, 2), descriptor (1, D) |
| pair.onnx | earlier (P, D), later (P, D) | turned (P, 2) |
| keypoint.onnx | difference (1, 3, 32, 128) | keypoint (1, 2), kinds (1, C), which are logits |

Direction, turn and turned are means [rad] and log variances. That of a flat gel gives place (1, 2) [cm] besides, after
the others. One that was learnt from presses has touch.onnx alone, which gives direction alone. Training writes the
folder, `TouchModel` reads it.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.checks import FARTHEST
from palpate.errors import FileError
from palpate.files import existing_file, read_json, whole_file
from palpate.printable import one_line
from palpate.touch.difference import Difference

Array = NDArray[np.float64]
FORMAT, VERSION = "palpate-touch-model", 2  # all of version 1 told direction, turn and pairs
NETWORKS = ("touch", "pair", "keypoint")
ARRAYS = {
    "touch": (("difference",), ("direction", "turn", "descriptor")),
    "pair": (("earlier", "later"), ("turned",)),
    "keypoint": (("difference",), ("keypoint", "kinds")),
}
"""What each network takes and gives."""
LARGEST = 100 * 10**6
"""[bytes] of a network; the shipped ones have less than one million."""
KINDS = ("disc", "ellipse", "edge", "near-corner", "corner")
"""Kinds of contact that a model tells apart."""
SIZES = {"direction": 2, "turn": 2, "place": 2, "turned": 2, "keypoint": 2, "kinds": len(KINDS)}
"""How many numbers they give of each for an image, or for a pair of them; a descriptor may have any."""
_DATA = Path(__file__).resolve().parents[1] / "data"
SHIPPED = _DATA / "digit"
"""The model of the DIGIT that comes with palpate."""
SHIPPED_OF = {"DIGIT": SHIPPED, "GelSight Mini": _DATA / "gelsight_mini"}
"""Those that come with palpate, by the names of their sensor profiles."""
TOLD, PLACE = ("direction", "turn", "pair", "linear"), "place"
"""What models tell, and what those of flat gels tell besides."""


@dataclass(frozen=True)
class Spread:
    """How far a prediction is to be believed, measured on recordings of units that were not trained on.

    Of a model that is learnt from presses it is measured on other presses of the same unit; `together`, which these do
    not tell, is then as with the model of the DIGIT.
    """

    scale: float
    """By how much predicted variances are to be multiplied to be right for one image or pair."""
    together: float
    """How many frames in a row err together: so many measurements are worth one."""

    @property
    def factor(self) -> float:
        """What a predicted variance is multiplied by where every frame gives a measurement of its own."""
        return self.scale * self.together


@dataclass(frozen=True)
class ModelSettings:
    """What a model was made for and from."""

    sensor: str
    """Name of the sensor profile."""
    image_height: int
    """Rows of its images [px]."""
    image_width: int
    """Columns of its images [px]."""
    spread: Mapping[str, Spread]
    """Of all TOLD, or of "direction" alone, and of "place" where a model tells it. The linear one predicts no variance:
    its scale is the variance [rad^2]."""
    linear: tuple[tuple[float, float], ...]
    """Change of sin(yaw) per change of the key point's column and row, for each of KINDS: the paper's linear model."""
    training: Mapping[str, Any]
    """Data, seed and settings that it comes from, for people."""


@dataclass(frozen=True, eq=False)
class Look:
    """What one image says by itself."""

    direction: tuple[float, float]
    """Angle of the contact on the tip, mean [rad] and variance [rad^2]."""
    turn: tuple[float, float] | None
    """Yaw up to an offset of the contact, mean [rad] and variance [rad^2]; None of a model that tells no turns."""
    descriptor: NDArray[np.float32] | None
    """(D,) what `TouchModel.compare` takes; None likewise."""
    place: tuple[float, float] | None = None
    """Where along y a flat pad is touched, mean [m] and variance [m^2]; None on a round tip."""


class TouchModel:
    """A model folder; raises FileError where it is incomplete, of a newer version or altered."""

    def __init__(self, folder: Path | str) -> None:
        folder = Path(folder)
        if not folder.is_dir():
            raise FileError(f"{folder}: no such folder; a touch model is a folder with model.json in it")
        written = read_json(folder / "model.json")
        if written.get("format") != FORMAT:
            raise FileError(f"{folder / 'model.json'}: format is {written.get('format')!r}, expected {FORMAT!r}")
        version = written.get("version")
        if not isinstance(version, int) or version > VERSION:
            raise FileError(f"{folder / 'model.json'}: version is {version!r}, this palpate reads up to {VERSION}")
        settings = written.get("settings")
        spread = settings.get("spread") if isinstance(settings, dict) else None
        names = NETWORKS[:1] if isinstance(spread, dict) and set(spread) == {*TOLD[:1]} else NETWORKS
        self.networks = {name: _network(folder / f"{name}.onnx") for name in names}
        found = fingerprint(written.get("settings"), self.networks)
        if found != written.get("hash"):
            raise FileError(f"{folder}: hash is {found[:12]}, model.json says {str(written.get('hash'))[:12]}: altered")
        self.folder, self.hash = folder, found
        self._opened: dict[str, Any] = {}
        self.settings = _settings(folder, written["settings"])

    def look(self, difference: Difference) -> Look:
        """Return what a difference from the untouched gel (32, 128, 3) says; see `touch.difference`."""
        direction, *others = self._run("touch", difference=_batch(difference))
        if not others:
            return Look(_gaussian(direction[0]), None, None)
        turn, descriptor, *place = others
        centimetres = _gaussian(place[0][0]) if place else None
        told = centimetres and (1e-2 * centimetres[0], 1e-4 * centimetres[1])
        return Look(_gaussian(direction[0]), _gaussian(turn[0]), descriptor[0], told)

    def compare(self, earlier: NDArray[np.float32], later: NDArray[np.float32]) -> tuple[Array, Array]:
        """Return the sensor's turn (P,) [rad] from descriptors (P, D) to one (D,), and its variance (P,)."""
        (turned,) = self._run("pair", earlier=earlier, later=np.broadcast_to(later, earlier.shape))
        return turned[:, 0].astype(np.float64), _variance(turned[:, 1])

    def keypoint(self, difference: Difference) -> tuple[Array, Array]:
        """Return the key point (2,), column and row in -1 to 1, and how likely each of KINDS is (C,)."""
        point, logits = self._run("keypoint", difference=_batch(difference))
        likely = np.exp(logits[0].astype(np.float64) - logits[0].max())
        return point[0].astype(np.float64), likely / likely.sum()

    def linear(self, earlier: Array, later: Array, kinds: Array) -> Array:
        """Return the turn (P,) [rad] from key points (P, 2) to one (2,) in contacts of these kinds (P, C)."""
        sine = np.sum((later - earlier) * (kinds @ np.asarray(self.settings.linear)), axis=1)
        return np.arcsin(np.clip(sine, -1.0, 1.0))

    def _run(self, name: str, **given: NDArray[np.float32]) -> Any:
        """What a network makes of arrays. Raises FileError where it is none that can be run."""
        if name not in self._opened:
            self._opened[name] = self._session(name)
        try:
            found = self._opened[name].run(None, given)
            told = {each: np.shape(values) for each, values in zip(self._gives(name), found, strict=True)}
        except Exception as error:  # of a damaged network that could be opened, of many kinds
            raise FileError(f"{self.folder / name}.onnx: cannot be run ({one_line(error)})") from error
        count = len(next(iter(given.values())))
        for each, shape in told.items():
            size = SIZES.get(each, shape[-1] if shape else 0)
            if shape != (count, size):
                raise FileError(f"{self.folder / name}.onnx: gives {each} of shape {shape}, expected {(count, size)}")
        return found

    def _gives(self, name: str) -> tuple[str, ...]:
        """What a network gives, by what the settings say that the model tells."""
        gives, spread = ARRAYS[name][1], self.settings.spread
        if name != "touch":
            return gives
        return gives[:1] if "turn" not in spread else (*gives, PLACE) if PLACE in spread else gives

    def _session(self, name: str) -> Any:
        """What runs a network. Raises FileError where it is none, or has not the arrays of one."""
        place = self.folder / f"{name}.onnx"
        try:
            found = session(self.networks[name])
            has = {each.name for each in found.get_inputs()}, [each.name for each in found.get_outputs()]
        except Exception as error:  # what ONNX Runtime makes of damaged bytes, of many kinds
            raise FileError(f"{place}: is no network that can be run ({one_line(error)})") from error
        takes, gives = ARRAYS[name][0], self._gives(name)
        if has != (set(takes), list(gives)):
            raise FileError(f"{place}: takes and gives {has}, expected {takes, gives}")
        return found


def shipped_model(sensor: str = "DIGIT") -> TouchModel:
    """Return the model that comes with palpate for a profile of this name, opened once; else that of the DIGIT."""
    return _opened(SHIPPED_OF.get(sensor, SHIPPED))


@cache
def _opened(folder: Path) -> TouchModel:
    return TouchModel(folder)


def write_model(folder: Path, settings: ModelSettings, networks: Mapping[str, bytes]) -> None:
    """Write the files of a model into an existing folder; `networks` are the ONNX files by name.

    `model.json` comes last, so that a folder with one holds a whole model.
    """
    plain = json.loads(json.dumps(asdict(settings)))
    for name in networks:
        with whole_file(folder / f"{name}.onnx", overwrite=True) as part:
            part.write_bytes(networks[name])
    written = {"format": FORMAT, "version": VERSION, "hash": fingerprint(plain, networks), "settings": plain}
    with whole_file(folder / "model.json", overwrite=True) as part:
        part.write_text(json.dumps(written, indent=2) + "\n", encoding="utf-8")


def fingerprint(settings: Any, networks: Mapping[str, bytes]) -> str:
    """Return the hash of a model's settings and networks."""
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
    for name in networks:
        digest.update(hashlib.sha256(networks[name]).digest())
    return digest.hexdigest()


def session(network: bytes) -> Any:
    """Return what runs an ONNX file."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # errors; folding of constants that it cannot do is none
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # one image gains nothing from more
    return onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])


def _network(path: Path) -> bytes:
    """The bytes of a network that is all in its file."""
    size = existing_file(path).stat().st_size
    if size > LARGEST:
        raise FileError(f"{path}: has {size} bytes, allowed are {LARGEST}")
    data = path.read_bytes()
    # A tensor that is kept in another file names it under this key; ONNX Runtime would open it.
    if b"location" in data:
        raise FileError(f"{path}: keeps its numbers in another file, which is not opened")
    return data


def _settings(folder: Path, plain: Mapping[str, Any]) -> ModelSettings:
    try:
        spread = {name: Spread(**value) for name, value in plain["spread"].items()}
        made = ModelSettings(**{**plain, "spread": spread})
        numbers = [number for each in spread.values() for number in (each.scale, each.together)]
        numbers += [made.image_height, made.image_width]
        if set(spread) not in ({*TOLD}, {*TOLD, PLACE}, {*TOLD[:1]}) or not all(
            isinstance(number, int | float) and 0.0 < number < FARTHEST for number in numbers
        ):
            raise TypeError("spread or the size of images is no set of numbers above 0")
        if np.shape(made.linear) != (len(KINDS), 2) or not np.isfinite(np.asarray(made.linear, np.float64)).all():
            raise TypeError(f"linear is no table of {len(KINDS)} rows of 2 numbers")
        if not isinstance(made.sensor, str):
            raise TypeError("sensor is no name")
        return made
    except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise FileError(f"{folder / 'model.json'}: settings do not fit this version ({error})") from error


def _batch(difference: Difference) -> Difference:
    return np.ascontiguousarray(difference.transpose(2, 0, 1)[None])


def _gaussian(said: NDArray[np.float32]) -> tuple[float, float]:
    return float(said[0]), float(_variance(said[1]))


def _variance(log: Any) -> Any:
    """Variances from their logs: beyond all numbers where a network that is none of ours says so."""
    with np.errstate(over="ignore"):
        return np.exp(np.float64(log))
