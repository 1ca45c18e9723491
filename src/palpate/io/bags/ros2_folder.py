"""The folder of a ROS 2 bag: its files one after the other, which are unpacked where the recorder packed them."""

import re
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

from palpate.errors import FileError
from palpate.files import existing_file
from palpate.io.bags.mcap_file import mcap_messages
from palpate.io.bags.raw import CutShort, RawMessage
from palpate.io.bags.sqlite_file import database_messages
from palpate.io.bags.unpack import unpacked, unpacked_files

LARGEST_METADATA = 10**6
"""[bytes] of metadata.yaml; a recorder writes some thousand."""


def bag_files(folder: Path, packed: str = "") -> list[Path]:
    """The MCAP files of a folder, or else its databases, which a recorder numbers where it splits a bag.

    Their names end in `packed` where they are packed as a whole.
    """
    found = [*folder.glob(f"*.mcap{packed}")] or [*folder.glob(f"*.db3{packed}")]
    return sorted(found, key=lambda file: ([int(digits) for digits in re.findall(r"\d+", file.stem)], file.name))


def folder_messages(folder: Path) -> Iterator[RawMessage]:
    """The messages of a bag, file by file. Raises CutShort where one of them ends too early, FileError if it is none.

    Nothing but the way of packing is believed of what metadata.yaml says.
    """
    mode = _compression_mode(folder)
    files = [existing_file(file) for file in bag_files(folder, ".zstd" if mode == "file" else "")]
    if not files:
        raise FileError(f"{folder}: has a metadata.yaml and no .mcap or .db3 file, or none that is packed as it says")
    cut: CutShort | None = None
    with unpacked_files(files) if mode == "file" else nullcontext(files) as plain:
        for file, each in zip(files, plain, strict=True):
            try:
                for raw in mcap_messages(each) if each.suffix == ".mcap" else database_messages(each):
                    yield _unpacked(raw, each) if mode == "message" else raw
            except FileError as error:
                raise FileError(str(error).replace(str(each), str(file))) from error
            except CutShort as error:  # the files after it may be whole
                cut = CutShort(str(error).replace(str(each), str(file)))
    if cut is not None:
        raise cut


def _compression_mode(folder: Path) -> str:
    """What the recorder packed: "message" by message, "file" by file, or "" for neither."""
    path = folder / "metadata.yaml"
    if path.stat().st_size > LARGEST_METADATA:
        raise FileError(f"{path}: has {path.stat().st_size} bytes, allowed are {LARGEST_METADATA}")
    text = path.read_bytes().decode("utf-8", errors="replace")
    found = re.search(r"compression_mode['\"]?:[ '\"]*(message|file)\b", text, re.IGNORECASE)
    return found[1].lower() if found else ""


def _unpacked(raw: RawMessage, file: Path) -> RawMessage:
    import zstandard

    try:
        return raw._replace(data=unpacked("zstd", raw.data))
    except FileError as error:
        raise FileError(f"{file}: {error}") from error
    except zstandard.ZstdError as error:
        raise CutShort(f"{file}: is damaged from a message of {raw.channel.topic} on") from error
