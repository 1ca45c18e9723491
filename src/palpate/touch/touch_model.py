"""Touch model: a folder with an ONNX network and a JSON of settings; opening one runs no code.

The network `touch.onnx` takes a difference from the untouched gel (1, 3, 32, 128). Its outputs are direction (1, 2) and
turn (1, 2), each a mean [rad] and a log variance, and corner (1, 4): mean, log variance, slope and log odds. A network
of a flat gel has place (1, 2) [cm] in place of the corner; one trained on presses has the direction alone.
"""

import hashlib
import json
import math
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import astuple, dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.checks import FARTHEST
from palpate.errors import FileError, SettingError, one_line
from palpate.files import existing_file, read_json
from palpate.touch.cells import Light, area_means, change_in_light, light_in
from palpate.types.sensor_file import known_sensor

Difference = NDArray[np.float32]
Reading = dict[str, tuple[float, ...]]
"""Mean and variance of each output of a model for one image.

- direction: angle of the contact on the tip [rad], [rad^2].
- turn: yaw of the sensor, up to an offset of the contact [rad], [rad^2].
- place: place along y of a flat pad [m], [m^2].
- corner: angle at a corner and its variance, see `measurements.ContactCorner`, then its slope and the log odds that
  there is a corner.
"""

FORMAT = "palpate-touch-model"
VERSION = 3
NETWORK = "touch.onnx"
ROWS = 32
COLUMNS = 128
"""Size of a difference, with ROWS. Columns are finer, as yaw shows across them: imprints of upright objects stand along
the rows, and the shading beside the line of a corner is a millimetre wide."""
LEVELS = 32.0  # grey levels that are 1 in a difference, about as much as a firm contact adds
LEAST_CORNER_LOG_ODDS = 2.0
"""Log odds of a corner from which its angle is a measurement."""

OUTPUTS = (("direction", "turn", "corner"), ("direction", "turn", "place"), ("direction",))
"""Outputs of a model of a round tip, of a model of a flat gel, and of one trained on presses."""
SIZES = {"corner": 4}
"""Count of numbers of each output that has more than mean and log variance."""
_DATA = Path(__file__).resolve().parents[1] / "data"
SHIPPED_OF = {"DIGIT": _DATA / "digit", "GelSight Mini": _DATA / "gelsight_mini"}
"""Folders of the models that come with palpate, by the name of the sensor profile."""


def reduced(image: NDArray[np.uint8] | Difference) -> Difference:
    """Return an image or a background's mean (height, width, 3) as (ROWS, COLUMNS, 3) [grey levels]."""
    means = area_means(image, ROWS, COLUMNS)
    return np.rint(means, out=means) if image.dtype == np.uint8 else means  # rounded as in training


def difference_in_light(image: NDArray[np.uint8], reduced_mean: Difference, light: Light | None = None) -> Difference:
    """Return the difference (ROWS, COLUMNS, 3) of an image (height, width, 3) from the background's reduced mean.

    The background is taken in the light of the image, which may have changed; unless the light is known, it is fitted
    to ROWS x ROWS means. The channels lie apart, as the network reads them.
    """
    reduced_image = reduced(image)
    if light is None:
        light = light_in(area_means(reduced_image, ROWS, ROWS), area_means(reduced_mean, ROWS, ROWS))
    difference = change_in_light(reduced_image, reduced_mean, light)
    difference /= np.float32(LEVELS)
    return difference


@dataclass(frozen=True)
class Spread:
    """Corrections of predicted variances, measured on units that the model was not trained on.

    For a model trained on presses they are measured on other presses of the same unit, and `together` is that of the
    DIGIT's model.
    """

    scale: float
    """Factor that makes the predicted variance of one image right."""
    together: float
    """Number of frames in a row that have the same error, so that their measurements are worth one."""

    @property
    def factor(self) -> float:
        """Factor on a predicted variance if every frame gives a measurement."""
        return self.scale * self.together


@dataclass(frozen=True)
class ModelSettings:
    """Properties of a model."""

    sensor: str
    """Name of the sensor profile."""
    image_height: int
    """Rows of its images [px]."""
    image_width: int
    """Columns of its images [px]."""
    spread: Mapping[str, Spread]
    """Corrections of the variances of each output; the outputs are one row of OUTPUTS."""
    training: Mapping[str, Any]
    """Data, seed and settings of the training, for people."""


class TouchModel:
    """Touch model in a folder, or that of a sensor by its name.

    Raises FileError if it is incomplete, of another version or altered.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = _model_folder(Path(folder))
        path = self.folder / "model.json"
        written = read_json(path)
        for name, expected in (("format", FORMAT), ("version", VERSION)):
            if written.get(name) != expected:
                raise FileError(f"{path}: {name} is {written.get(name)!r}, expected {expected!r}; train the model anew")
        self.network = existing_file(self.folder / NETWORK).read_bytes()
        # A tensor in another file has its name under this key; ONNX Runtime would open that file.
        if b"location" in self.network:
            raise FileError(f"{self.folder / NETWORK}: keeps its numbers in another file, which is not opened")
        self.hash = fingerprint(written.get("settings"), self.network)
        stated = written.get("hash")
        if self.hash != stated:
            raise FileError(f"{self.folder}: hash is {self.hash[:12]}, model.json says {str(stated)[:12]}: altered")
        self.settings = _settings(path, written["settings"])
        self._session: Any = None

    @property
    def is_shipped(self) -> bool:
        """True for a model that comes with palpate."""
        return self.folder.resolve() in SHIPPED_OF.values()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of copies and pickles, which open the network themselves."""
        return {**vars(self), "_session": None}

    def read(self, difference: Difference) -> Reading:
        """Return the reading of a difference (ROWS, COLUMNS, 3); opens the network at the first call."""
        batch = np.ascontiguousarray(difference.transpose(2, 0, 1)[None])
        names = list(self.settings.spread)
        try:
            if self._session is None:
                self._session = session(self.network)
                sizes = {output.name: output.shape[-1] for output in self._session.get_outputs()}
                expected = {name: SIZES.get(name, 2) for name in names}
                if sizes != expected:
                    raise ValueError(f"gives {sizes}, expected {expected}")
            outputs = self._session.run(names, {"difference": batch})
            rows = [row for (row,) in map(np.ndarray.tolist, outputs)]
        except Exception as error:  # a damaged network raises many kinds
            raise FileError(f"{self.folder / NETWORK}: is no network that can be run ({one_line(error)})") from error
        reading: Reading = {}
        for name, (mean, log_variance, *more) in zip(names, rows, strict=True):
            unit = 1e-2 if name == "place" else 1.0  # [m], as the network gives places in cm
            variance = math.exp(min(log_variance, 700.0))  # the log variance of a foreign network may be anything
            reading[name] = (unit * mean, unit**2 * variance, *more)
        return reading


def _model_folder(folder: Path) -> Path:
    """Return the folder, or that of the model of a sensor if it is the sensor's name. Raises FileError."""
    if folder.is_dir():
        return folder
    with suppress(SettingError, KeyError):
        folder = SHIPPED_OF[known_sensor(str(folder)).name]
    if not folder.is_dir():
        raise FileError(f"{folder}: no such folder; a touch model is a folder with model.json in it")
    return folder


@cache
def shipped_model(sensor: str = "DIGIT") -> TouchModel:
    """Return the model that comes with palpate for the sensor profile of this name; opened once.

    Raises SettingError if there is none: a model of other sensors has to be asked for by name.
    """
    if sensor not in SHIPPED_OF:
        raise SettingError(no_shipped_model(sensor))
    return TouchModel(SHIPPED_OF[sensor])


def no_shipped_model(sensor: str) -> str:
    """Return the sentence for a sensor profile without a shipped model, with the ways to give it one."""
    return (
        f"no touch model comes with palpate for sensor {sensor!r}; give one, in Python "
        "model=palpate.TouchModel(MODEL), for commands --model MODEL: a folder that palpate train makes, or digit or "
        "gelsight-mini if this sensor's images look like theirs"
    )


def fingerprint(settings: Any, network: bytes) -> str:
    """Return the hash of a model's settings and network."""
    text = json.dumps(settings, sort_keys=True).encode()
    return hashlib.sha256(text + hashlib.sha256(network).digest()).hexdigest()


def session(network: bytes) -> Any:
    """Return an ONNX Runtime session of a network."""
    # It reports the machine, the program and each network to its maker, from its first import on.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # errors; a constant that cannot be folded is none
    options.intra_op_num_threads = 1  # one image gains nothing from more threads
    options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])


def _settings(path: Path, plain: Mapping[str, Any]) -> ModelSettings:
    """Return the settings in the content of a model.json. Raises FileError, which names its path."""
    try:
        spread = {name: Spread(**value) for name, value in plain["spread"].items()}
        settings = ModelSettings(**{**plain, "spread": spread})
        numbers = (settings.image_height, settings.image_width, *chain(*map(astuple, spread.values())))
        in_range = all(0.0 < number < FARTHEST for number in numbers)
        if set(spread) not in map(set, OUTPUTS) or not in_range or not isinstance(settings.sensor, str):
            raise TypeError("sensor is no name, or spread or image size no set of numbers above 0")
        return settings
    except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise FileError(f"{path}: settings do not fit this version ({error})") from error
