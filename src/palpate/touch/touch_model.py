"""Touch model: a folder with an ONNX network and a JSON of settings; opening one runs no code.

The network `touch.onnx` takes a difference from the untouched gel (1, 3, 32, 128) and gives direction (1, 2) and turn
(1, 2), each mean [rad] and log variance, and corner (1, 4), these two, slope and log odds. That of a flat gel gives
place (1, 2) [cm] in place of the corner, one trained on presses the direction alone.
"""

import hashlib
import json
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
from palpate.touch.cells import area_means, change_in_light
from palpate.types.sensor import known_sensor

Difference = NDArray[np.float32]
Reading = dict[str, tuple[float, ...]]
"""Mean and variance of each output of a model for one image: direction, the angle of the contact on the tip [rad],
[rad^2]; turn, the yaw of the sensor up to an offset of the contact [rad]; place along y of a flat pad [m]; corner, see
`measurements.ContactCorner`, with its slope, and the log odds of a corner."""

FORMAT, VERSION, NETWORK = "palpate-touch-model", 3, "touch.onnx"
ROWS, COLUMNS = 32, 128
"""Size of a difference. Imprints of upright objects stand along the rows, and their yaw shows across the columns, down
to the shading beside a corner's line of a millimetre: so columns are finer."""
LEVELS = 32.0  # grey levels that are 1 in a difference, about as much as a firm contact adds
LEAST_CORNER_LOG_ODDS = 2.0
"""Log odds of a corner from which its angle is a measurement."""

OUTPUTS = (("direction", "turn", "corner"), ("direction", "turn", "place"), ("direction",))
"""Outputs of a model of a round tip, of a flat gel, and of one trained on presses."""
SIZES = {"corner": 4}
"""Numbers of an output that has more than mean and log variance."""
_DATA = Path(__file__).resolve().parents[1] / "data"
SHIPPED_OF = {"DIGIT": _DATA / "digit", "GelSight Mini": _DATA / "gelsight_mini"}
"""Folders of the models that come with palpate, by the name of the sensor profile."""


def reduced(image: NDArray[np.uint8] | Difference) -> Difference:
    """Return an image or a background's mean (height, width, 3) as (ROWS, COLUMNS, 3) [grey levels]."""
    means = area_means(image, ROWS, COLUMNS)
    return np.rint(means) if image.dtype == np.uint8 else means  # rounded as in training


def difference_in_light(image: NDArray[np.uint8], reduced_mean: Difference) -> Difference:
    """Return the difference (ROWS, COLUMNS, 3) of an image (height, width, 3) from the background's reduced mean.

    The background is taken in the light of the image, which may have changed and is found in ROWS x ROWS of them.
    """
    return change_in_light(reduced(image), reduced_mean, ROWS) / np.float32(LEVELS)


@dataclass(frozen=True)
class Spread:
    """Corrections of predicted variances, measured on units that were not trained on.

    For a model trained on presses: on other presses of the same unit, with `together` as for the DIGIT's model.
    """

    scale: float
    """Factor that makes predicted variances right for one image."""
    together: float
    """Number of frames in a row with the same error: so many measurements are worth one."""

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
    """For each output, one of OUTPUTS."""
    training: Mapping[str, Any]
    """Data, seed and settings of the training, for people."""


class TouchModel:
    """Touch model in a folder, or that of a sensor by its name.

    Raises FileError if it is incomplete, of another version or altered.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = folder = Path(folder)
        if not folder.is_dir():
            with suppress(SettingError, KeyError):
                self.folder = folder = SHIPPED_OF[known_sensor(str(folder)).name]
        if not folder.is_dir():
            raise FileError(f"{folder}: no such folder; a touch model is a folder with model.json in it")
        path = folder / "model.json"
        written = read_json(path)
        for name, expected in (("format", FORMAT), ("version", VERSION)):
            if (found := written.get(name)) != expected:
                raise FileError(f"{path}: {name} is {found!r}, expected {expected!r}; train the model anew")
        self.network = existing_file(folder / NETWORK).read_bytes()
        # A tensor in another file has its name under this key; ONNX Runtime would open that file.
        if b"location" in self.network:
            raise FileError(f"{folder / NETWORK}: keeps its numbers in another file, which is not opened")
        self.hash = fingerprint(written.get("settings"), self.network)
        if self.hash != (stated := written.get("hash")):
            raise FileError(f"{folder}: hash is {self.hash[:12]}, model.json says {str(stated)[:12]}: altered")
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
        outputs = list(self.settings.spread)
        try:
            if self._session is None:
                self._session = session(self.network)
                given = {each.name: each.shape[-1] for each in self._session.get_outputs()}
                if given != (expected := {name: SIZES.get(name, 2) for name in outputs}):
                    raise ValueError(f"gives {given}, expected {expected}")
            values = self._session.run(outputs, {"difference": batch})
            numbers = [row for (row,) in map(np.ndarray.tolist, values)]
        except Exception as error:  # a damaged network raises many kinds
            raise FileError(f"{self.folder / NETWORK}: is no network that can be run ({one_line(error)})") from error
        found: Reading = {}
        for name, (mean, log_variance, *more) in zip(outputs, numbers, strict=True):
            unit = 1e-2 if name == "place" else 1.0  # [m] of what the network has in cm
            variance = float(np.exp(min(log_variance, 700.0)))  # a foreign one may give any
            found[name] = unit * mean, unit**2 * variance, *more
        return found


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
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # errors; a constant that cannot be folded is none
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # one image gains nothing from more
    return onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])


def _settings(path: Path, plain: Mapping[str, Any]) -> ModelSettings:
    try:
        spread = {name: Spread(**value) for name, value in plain["spread"].items()}
        settings = ModelSettings(**{**plain, "spread": spread})
        numbers = settings.image_height, settings.image_width, *chain(*map(astuple, spread.values()))
        in_range = all(0.0 < number < FARTHEST for number in numbers)
        if set(spread) not in map(set, OUTPUTS) or not in_range or not isinstance(settings.sensor, str):
            raise TypeError("sensor is no name, or spread or image size no set of numbers above 0")
        return settings
    except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise FileError(f"{path}: settings do not fit this version ({error})") from error
