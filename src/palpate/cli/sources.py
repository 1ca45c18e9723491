"""Sources of recordings: files in any known format, bags, folders of images with tables, datasets of LeRobot."""

from dataclasses import dataclass
from pathlib import Path

import palpate
from palpate.cli.console import progress_bar
from palpate.cli.options import Bag
from palpate.errors import FileError, SettingError, kept_warnings
from palpate.types.choices import TableChoices


@dataclass(frozen=True)
class Source:
    """Options by which paths are read as recordings."""

    bag: Bag
    tables: TableChoices = TableChoices()
    """Tables of a folder of images."""
    episode: int = 0
    """Episode of a dataset of LeRobot."""

    def read(self, path: Path) -> "palpate.BagReading":
        """Return a path as a recording, and the plane of its push. Raises PalpateError."""
        from palpate.io.image_folder import image_files
        from palpate.io.lerobot import is_lerobot
        from palpate.io.rosbag_reader import is_bag
        from palpate.types.space import flat

        if is_lerobot(path):
            return palpate.BagReading(self._dataset(path), flat())
        is_folder = path.is_dir() and not is_bag(path) and bool(image_files(path))
        if self.tables != TableChoices() or is_folder:
            return palpate.BagReading(self._folder(path), flat())
        with progress_bar(f"reading {path.name}"):
            return self.bag.read(path)

    def _dataset(self, folder: Path) -> "palpate.Recording":
        """Return an episode of a dataset of LeRobot."""
        from palpate.io.lerobot import read_lerobot
        from palpate.types.sensor_file import known_sensor

        bag = self.bag
        with kept_warnings() as warnings:
            shape = bag.shape and palpate.load_shape(bag.shape, bag.shape_unit, bag.shape_layer)
            sensor = known_sensor(bag.sensor)
            with progress_bar(f"reading {folder.name}") as bar:
                recording = read_lerobot(folder, self.episode, shape or None, bag.choices, self.tables, sensor, bar)
        return recording.warned(warnings)

    def _folder(self, folder: Path) -> "palpate.Recording":
        """Return a folder of images with tables."""
        from palpate.io.image_folder import image_files, read_folder
        from palpate.types.sensor_file import known_sensor

        bag = self.bag
        if not folder.is_dir():
            raise FileError(f"{folder}: is no folder; --poses and its options are for a folder of images")
        if bag.shape is None:
            raise SettingError("--shape NAME|AxB|FILE is missing: a folder of images holds no outline of the object")
        with kept_warnings() as warnings:
            shape = palpate.load_shape(bag.shape, bag.shape_unit, bag.shape_layer)
            with progress_bar(f"reading {folder.name}", len(image_files(folder))) as bar:
                recording = read_folder(folder, shape, bag.choices, self.tables, known_sensor(bag.sensor), bar)
        return recording.warned(warnings)
