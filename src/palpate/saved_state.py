"""The state of objects as plain data in a file, and back to the last bit.

What is kept is numbers, words, arrays and the fields of palpate's own classes: opening a file runs no code and opens no
pickle. What a program makes anew and does not change, such as factors or networks, is `given` by name and not kept.
The file is an `.npz`: `tree` is JSON that says what is where, the other members are the arrays that it names.
"""

import json
import sys
from collections import deque
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, SettingError
from palpate.files import existing_file, read_arrays, whole_file

VERSION = 9  # files of another version are refused
_HOME = "palpate."
_PLAIN = (bool, int, float, str)
_SEVERAL = {"list": list, "tuple": tuple}


class Unsaved(SettingError):
    """Something that no file can hold; the message says what it is."""


def write_state(path: Path | str, about: dict[str, Any], state: Any, given: dict[str, Any]) -> None:
    """Write a state, and what must be known to read it, whole or not at all; an existing file is replaced.

    Raises Unsaved on what cannot be kept, FileError where the file cannot be written.
    """
    writer = _Writer(given)
    content = {"version": VERSION, "about": about, "state": writer.plain(state)}
    tree = json.dumps({**content, "objects": writer.objects}).encode()
    arrays: dict[str, Any] = {f"a{index}": array for index, array in enumerate(writer.arrays)}
    with whole_file(path, overwrite=True) as part, part.open("wb") as file:
        np.savez_compressed(file, tree=np.frombuffer(tree, np.uint8), **arrays)


class StateFile:
    """An opened file of `write_state`; raises FileError on anything else."""

    def __init__(self, path: Path | str) -> None:
        self.path = existing_file(path)
        self._arrays = read_arrays(self.path)
        try:
            self._content = json.loads(self._arrays.pop("tree").tobytes())
            version = self._content["version"]
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise FileError(f"{self.path}: is no saved state ({type(error).__name__})") from error
        if version != VERSION:
            raise FileError(f"{self.path}: version is {version!r}, this palpate reads {VERSION}")

    @property
    def about(self) -> dict[str, Any]:
        """What must be known to read the state."""
        return self._content["about"]

    def state(self, given: dict[str, Any]) -> Any:
        """Return the state, with what is given by the names it was written with."""
        try:
            return _Reader(self._content["objects"], self._arrays, given).value(self._content["state"])
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, RecursionError) as error:
            raise FileError(f"{self.path}: holds a state that is not of this palpate ({error!r})") from error


class _Writer:
    """Turns values into JSON, arrays aside; what is met again is told once."""

    def __init__(self, given: dict[str, Any]) -> None:
        self.objects: list[Any] = []
        self.arrays: list[NDArray[Any]] = []
        self._given = {id(value): name for name, value in given.items()}
        self._met: dict[int, Any] = {}
        self._kept: list[Any] = []  # so that no id is used again

    def plain(self, value: Any) -> Any:
        if value is None or type(value) in _PLAIN:
            return value
        if id(value) in self._given:
            return {"given": self._given[id(value)]}
        if id(value) in self._met:
            return self._met[id(value)]
        if isinstance(value, np.ndarray):
            return self._remember(value, self._array(value))
        if isinstance(value, np.generic):
            return {"scalar": self._array(np.asarray(value))}
        if type(value) in (list, tuple):
            return self._sequence(value)
        if isinstance(value, deque):
            return {"deque": self.plain(list(value)), "most": value.maxlen}
        if isinstance(value, dict):
            return {"keys": self.plain(list(value)), "values": self.plain(list(value.values()))}
        if isinstance(value, type) and value.__module__.startswith(_HOME):
            return {"class": [value.__module__, value.__qualname__]}
        return self._object(value)

    def _remember(self, value: Any, told: Any) -> Any:
        self._met[id(value)] = told
        self._kept.append(value)
        return told

    def _array(self, array: NDArray[Any]) -> Any:
        if array.dtype.hasobject:
            raise Unsaved("a measurement of your own")  # nothing else in an array is an object
        told: dict[str, Any] = {"array": len(self.arrays)}
        if array.dtype.kind not in "biuf":
            told |= {"kind": np.lib.format.dtype_to_descr(array.dtype), "shape": array.shape}
            array = np.frombuffer(array.tobytes(), np.uint8)
        self.arrays.append(array)
        return told

    def _sequence(self, values: Any) -> Any:
        """A list or tuple; many numbers, or arrays that are alike, are told as one array."""
        kind = type(values).__name__
        if len(values) > 1 and {type(value) for value in values} in ({float}, {bool}):
            return {kind: self._array(np.array(values)), "of": "numbers"}
        if len(values) > 1 and all(type(value) is tuple and 0 < len(value) == len(values[0]) for value in values):
            return {kind: [self.plain(list(column)) for column in zip(*values, strict=True)], "of": "rows"}
        like = values[0] if values else None
        if isinstance(like, np.ndarray) and len(values) > 1 and like.ndim and not like.dtype.hasobject:
            known = like.dtype, like.shape[1:]
            if all(isinstance(value, np.ndarray) and (value.dtype, value.shape[1:]) == known for value in values):
                ends = np.cumsum([len(value) for value in values])
                return {kind: self._array(np.concatenate(values)), "of": "arrays", "ends": self._array(ends)}
        return {kind: [self.plain(value) for value in values]}

    def _object(self, value: Any) -> Any:
        cls = type(value)
        if not cls.__module__.startswith(_HOME):
            raise Unsaved(f"a {cls.__name__}")
        told = self._remember(value, {"object": len(self.objects)})
        self.objects.append(None)
        fields: Any = dict(enumerate(value)) if isinstance(value, tuple) else vars(value)
        kept = {
            str(name): self.plain(field)
            for name, field in fields.items()
            if not isinstance(getattr(cls, str(name), None), cached_property)  # made anew where it is asked for
        }
        self.objects[told["object"]] = [cls.__module__, cls.__qualname__, kept]
        return told


class _Reader:
    """Makes values of what a _Writer told."""

    def __init__(self, objects: list[Any], arrays: dict[str, NDArray[Any]], given: dict[str, Any]) -> None:
        self._objects, self._arrays, self._given = objects, arrays, given
        self._made: dict[int, Any] = {}
        self._made_arrays: dict[int, NDArray[Any]] = {}

    def value(self, told: Any) -> Any:
        if not isinstance(told, dict):
            return told
        if "given" in told:
            return self._given[told["given"]]
        if "array" in told:
            return self._array(told)
        if "class" in told:
            return _class(*told["class"])
        if "scalar" in told:
            return self.value(told["scalar"])[()]
        if "object" in told:
            return self._object(told["object"])
        if "deque" in told:
            return deque(self.value(told["deque"]), told["most"])
        if "keys" in told:
            return dict(zip(self.value(told["keys"]), self.value(told["values"]), strict=True))
        return self._sequence(told)

    def _array(self, told: Any) -> NDArray[Any]:
        if told["array"] not in self._made_arrays:
            array = self._arrays[f"a{told['array']}"].copy(order="K")
            if "kind" in told:
                kind = _dtype(told["kind"])
                array = np.frombuffer(array, kind).copy() if kind.itemsize else np.empty(told["shape"], kind)
                array = array.reshape(told["shape"])
            self._made_arrays[told["array"]] = array
        return self._made_arrays[told["array"]]

    def _sequence(self, told: Any) -> Any:
        kind = next(kind for kind in _SEVERAL if kind in told)
        inner, of = told[kind], told.get("of")
        if of == "numbers":
            values: Any = self.value(inner).tolist()
        elif of == "rows":
            values = zip(*map(self.value, inner), strict=True)
        elif of == "arrays":
            values = (part.copy() for part in np.split(self.value(inner), self.value(told["ends"])[:-1]))
        else:
            values = map(self.value, inner)
        return _SEVERAL[kind](values)

    def _object(self, index: int) -> Any:
        if index in self._made:
            return self._made[index]
        module, name, fields = self._objects[index]
        cls: Any = _class(module, name)
        if issubclass(cls, tuple):
            made = tuple.__new__(cls, (self.value(field) for field in fields.values()))
            self._made[index] = made
            return made
        made = self._made[index] = cls.__new__(cls)
        for field, told in fields.items():
            object.__setattr__(made, field, self.value(told))
        return made


def _dtype(told: Any) -> np.dtype:
    """A type of numbers, or of records of them."""
    if isinstance(told, str):
        return np.dtype(told)
    return np.dtype([(name, _dtype(kind), *map(tuple, shape)) for name, kind, *shape in told])


def _class(module: str, name: str) -> type:
    """A class of palpate; it is not imported for the file's sake."""
    found = vars(sys.modules[module])[name] if module.startswith(_HOME) else None
    if not isinstance(found, type) or found.__module__ != module:
        raise ValueError(f"{module}.{name} is no class of palpate")
    return found
