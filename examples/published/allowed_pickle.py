"""Reads arrays from a pickle without running what else it asks for; `digit_pose.py` runs this as a process of its own.

    python -I allowed_pickle.py FILE FIELD

writes an .npz to standard output: the images of a field as 0, 1, ..., and the only field of poses (N, 7) as poses.
"""

import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np

CORES = ("numpy.core", "numpy._core")
ALLOWED = {
    *((f"{core}.multiarray", name) for core in CORES for name in ("_reconstruct", "scalar")),
    *((f"{core}.numeric", "_frombuffer") for core in CORES),
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("_codecs", "encode"),
}
"""What makes arrays, by modules of NumPy 1 and 2."""


class ArrayUnpickler(pickle.Unpickler):
    """A reader of pickles that refuses all classes and functions but those of arrays."""

    def find_class(self, module: str, name: str) -> Any:
        """Return an allowed class or function."""
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"asks for {module}.{name}, which is not allowed: only arrays are read")
        return super().find_class(module, name)


def main(path: Path, field: str) -> None:
    """Write the arrays to standard output; exits with a sentence where that fails."""
    try:
        with path.open("rb") as file:
            data = ArrayUnpickler(file).load()
        others = [np.asarray(each) for name, each in data.items() if not name.startswith("digit_")]
        poses = [each.astype(np.float64) for each in others if each.shape[1:] == (7,)]
        images = [np.frombuffer(each, np.uint8) if isinstance(each, bytes) else each for each in data[field]]
        if len(poses) != 1:
            raise ValueError(f"has {len(poses)} fields of poses (N, 7), expected one")
        named: Any = {str(index): each for index, each in enumerate(images)}
        np.savez(sys.stdout.buffer, poses=poses[0], **named)
    except Exception as error:  # whatever a foreign pickle raises
        sys.exit(f"cannot be read as a sequence: {error or type(error).__name__}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
