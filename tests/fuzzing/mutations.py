"""Changes to the bytes of real files, the same for the same number."""

import io
import random
import re
import zipfile
from collections.abc import Callable

MOST = 6
"""Changes to one file."""

NUMBERS = (*b"0 -1 1e308 -1e308 1e-308 nan Infinity 1e200 1e8 1.2.3".split(), b"9" * 400, b"")
WORDS = (*b'" { [] null =1+1 \xff \x1b[31m'.split(), b"\r", b"\x00", b"[" * 2000, b"," * 50, b"x" * 150_000)
SIZES = (0, 1, 2**7, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**61, 2**63 - 1, 2**64 - 1)
NUMBER = re.compile(rb"-?\d+\.?\d*(?:e-?\d+)?")

Change = Callable[[bytearray, random.Random], None]


def changed(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    """The bytes of a file after one to MOST changes, some of them within what is packed in it."""
    if data.startswith(b"PK\x03\x04") and rng.random() < 0.8:
        return _in_archive(data, rng)
    found = bytearray(data)
    is_text = b"\x00" not in data[:1000] and data[:1].isascii()
    for _ in range(rng.randint(1, MOST)):
        if not found:
            break
        if others and rng.random() < 0.05:
            _splice(found, rng.choice(others), rng)
        else:
            rng.choice(TEXT if is_text and rng.random() < 0.7 else BYTES)(found, rng)
    return bytes(found)


def _in_archive(data: bytes, rng: random.Random) -> bytes:
    """An archive with changed parts, whose checksums are right."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as archive, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made:
        names = archive.namelist()
        chosen = rng.choice(names)
        for name in names:
            part = bytearray(archive.read(name))
            if name == chosen:
                for _ in range(rng.randint(1, MOST)):
                    # The header is short and says the most.
                    end = min(len(part), 128) if rng.random() < 0.6 else len(part)
                    start = bytearray(part[:end])
                    if start:
                        rng.choice(BYTES + TEXT)(start, rng)
                    part[:end] = start
            made.writestr(name, bytes(part))
    return stream.getvalue()


def _flip(data: bytearray, rng: random.Random) -> None:
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _replace(data: bytearray, rng: random.Random) -> None:
    for _ in range(rng.randint(1, 26)):
        data[rng.randrange(len(data))] = rng.randrange(256)


def _replace_near(data: bytearray, rng: random.Random) -> None:
    start = rng.randrange(len(data))
    for _ in range(rng.randint(1, 8)):
        data[min(start + rng.randrange(64), len(data) - 1)] = rng.randrange(256)


def _size(data: bytearray, rng: random.Random) -> None:
    width, start = rng.choice((1, 2, 4, 8)), rng.randrange(len(data))
    order = "big" if rng.random() < 0.2 else "little"
    written = (rng.choice(SIZES) % 256**width).to_bytes(width, order)
    data[start : start + width] = written[: len(data) - start]


def _cut(data: bytearray, rng: random.Random) -> None:
    del data[rng.randrange(len(data)) :]


def _remove(data: bytearray, rng: random.Random) -> None:
    start = rng.randrange(len(data))
    del data[start : start + rng.randint(1, 64)]


def _repeat(data: bytearray, rng: random.Random) -> None:
    start = rng.randrange(len(data))
    part = data[start : start + rng.randint(1, 200)]
    data[start:start] = part * rng.choice((1, 1, 2, 20))


def _number(data: bytearray, rng: random.Random) -> None:
    found = list(NUMBER.finditer(data))
    if found:
        start, end = rng.choice(found).span()
        data[start:end] = rng.choice(NUMBERS)


def _word(data: bytearray, rng: random.Random) -> None:
    start = rng.randrange(len(data))
    data[start : start + rng.randint(0, 3)] = rng.choice(WORDS)


def _line(data: bytearray, rng: random.Random) -> None:
    lines = data.splitlines(keepends=True)
    rng.shuffle(lines)
    data[:] = b"".join(lines[: rng.randint(1, len(lines))])


def _splice(data: bytearray, other: bytes, rng: random.Random) -> None:
    start = rng.randrange(len(data))
    data[start:] = other[rng.randrange(len(other)) :]


BYTES: tuple[Change, ...] = (_flip, _replace, _replace_near, _replace_near, _size, _size, _cut, _remove, _repeat)
TEXT: tuple[Change, ...] = (_number, _number, _number, _word, _remove, _repeat, _line)
