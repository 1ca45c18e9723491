"""Decoding of a message of a bag, whichever way it is serialised."""

from typing import Any

from palpate.errors import FileError
from palpate.io.foxglove_messages import as_ros
from palpate.io.ros_messages import RawMessage, ros_types, types_by_definition


def decoded(raw: RawMessage, is_own: bool = False) -> Any:
    """Return the message with its fields as attributes. Raises FileError that names its topic if it is damaged.

    Of palpate's own files the definition in the file is taken: the types of all messages take 50 ms to load.
    """
    topic, type_, encoding = raw.channel
    try:
        if raw.channel.is_foxglove:
            return as_ros(raw)
        if is_own:
            return types_by_definition(type_, raw.schema).deserialize_cdr(raw.data, type_)
        if encoding == "cdr":
            return ros_types(encoding).deserialize_cdr(raw.data, type_)
        return ros_types(encoding).deserialize_ros1(raw.data, type_)
    except Exception as error:  # damaged bytes can raise anything in the decoder
        time = f"{raw.log_time * 1e-9:.9f} s"
        raise FileError(f"{topic}: the message recorded at {time} does not decode as {type_}") from error
