"""The one encoding of what the processes of a drive send each other.

A message is a value of any class that states the types of its fields. Its body is MessagePack (msgpack.org), an array
of NumPy's and a column of coded texts are extensions of it, and around it stand a head and a checksum. Decoding any
bytes gives a message or the reason why they are none. The module knows no socket, no process and no class of message.
"""

from __future__ import annotations

import dataclasses
import struct
import zlib
from enum import IntEnum
from typing import Any, Final, Generic, NamedTuple, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from vve_sumo.coded_texts import CodedTexts

VERSION: Final = 4

# Little endian: magic, version, kind; then the body; then the CRC-32 (zlib's) of all bytes before it.
_MAGIC: Final = b"VV"
_HEAD: Final = struct.Struct("<2sBB")
_CRC: Final = struct.Struct("<I")
#: MessagePack's extension for an array of one dimension: the letter of its kind of number (NumPy's), then the numbers
_ARRAY: Final = 1
_NUMBERS: Final = "?bBhHiIlLqQefd"
_LETTERS: Final = {np.dtype(letter): letter.encode() for letter in _NUMBERS}
#: MessagePack's extension for a column of coded texts: in MessagePack again the texts, and the bytes of the codes
_TEXTS: Final = 2
_TEXTS_ENCODER: Final = msgspec.msgpack.Encoder()
_TEXTS_DECODER: Final = msgspec.msgpack.Decoder(tuple[tuple[str, ...], memoryview])

T = TypeVar("T")


class MessageKind(IntEnum):
    """What a message is; no number is ever used for another kind."""

    SETPOINT = 1
    OPERATOR_COMMAND = 2
    FEEDBACK = 3
    CONSOLE = 4
    RECORD = 5
    OUTPUTS = 6
    VIEW = 7
    PEOPLE = 8
    PEOPLE_LINK = 9
    STATIONS_LINK = 10
    SCENE = 11
    SENSE = 12


class MalformedMessage(NamedTuple):
    """Bytes that are no message."""

    reason: str  #: too_short, wrong_crc, wrong_magic, wrong_version, wrong_kind or wrong_content


class MessageCodec(Generic[T]):
    """Encodes messages of one kind, which are values of `content`, and decodes them."""

    def __init__(self, kind: MessageKind, content: Any) -> None:
        """`content` is a class, or a union of tagged ones, whose fields msgspec can tell from each other."""
        self._head = _HEAD.pack(_MAGIC, VERSION, kind)
        self._head_crc = zlib.crc32(self._head)
        self._encoder = msgspec.msgpack.Encoder(enc_hook=_sent)
        self._decoder: msgspec.msgpack.Decoder[T] = msgspec.msgpack.Decoder(content, ext_hook=_came, dec_hook=_array)

    def encode(self, message: T) -> bytes:
        """Return the bytes of a message; half a surrogate pair in a text is sent as a question mark.

        Raises TypeError for a message that holds what MessagePack, dataclasses and NumPy do not know.
        """
        try:
            body = self._encoder.encode(message)
        except UnicodeEncodeError:
            body = self._encoder.encode(_encodable(message))
        return b"".join((self._head, body, _CRC.pack(zlib.crc32(body, self._head_crc))))

    def decode(self, data: bytes) -> T | MalformedMessage:
        """Return the message in `data`, every number of it bit for bit as it was sent."""
        if len(data) < _HEAD.size + _CRC.size:
            return MalformedMessage("too_short")
        if _CRC.unpack(data[-_CRC.size :]) != (zlib.crc32(data[: -_CRC.size]),):
            return MalformedMessage("wrong_crc")
        if not data.startswith(self._head):
            return MalformedMessage(_wrong_head(data))
        try:
            return self._decoder.decode(data[_HEAD.size : -_CRC.size])
        except (msgspec.MsgspecError, ValueError):  # an invalid text is a ValueError
            return MalformedMessage("wrong_content")


def _wrong_head(data: bytes) -> str:
    magic, version, _kind = _HEAD.unpack_from(data)
    if magic != _MAGIC:
        return "wrong_magic"
    return "wrong_kind" if version == VERSION else "wrong_version"


def _encodable(value: Any) -> Any:
    """Return a value all of whose texts UTF-8 can encode; a lab's controller may fail with any text."""
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    if isinstance(value, dict):
        return {_encodable(key): _encodable(content) for key, content in value.items()}
    if isinstance(value, msgspec.Struct):
        names = value.__struct_fields__
        return msgspec.structs.replace(value, **{name: _encodable(getattr(value, name)) for name in names})
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        changed = {field.name: _encodable(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return dataclasses.replace(value, **changed)
    if isinstance(value, np.ndarray) and value.dtype.kind in "OU":
        return _encodable(value.tolist())
    if isinstance(value, CodedTexts):
        return CodedTexts(value.codes, _encodable(value.texts))
    if isinstance(value, (list, tuple, set, frozenset)):
        made = map(_encodable, value)
        return type(value)(*made) if hasattr(value, "_fields") else type(value)(made)
    return value


def _sent(value: Any) -> Any:
    """Return what is sent for a value that MessagePack does not know: NumPy's arrays and numbers, coded texts."""
    if isinstance(value, np.ndarray):
        letter = _LETTERS.get(value.dtype) if value.ndim == 1 else None
        if letter is None:
            return value.tolist()
        numbers: Any = value if value.flags.c_contiguous else value.tobytes()
        return msgspec.msgpack.Ext(_ARRAY, b"".join((letter, numbers)))
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, CodedTexts):
        return msgspec.msgpack.Ext(_TEXTS, _TEXTS_ENCODER.encode((value.texts, value.codes.tobytes())))
    raise TypeError(f"a {type(value).__name__} is no part of a message")


def _came(code: int, data: memoryview) -> NDArray[Any] | CodedTexts:
    if code == _TEXTS:
        texts, codes = _TEXTS_DECODER.decode(data)
        return CodedTexts(np.frombuffer(codes, np.int32), texts)
    if code != _ARRAY or not data or chr(data[0]) not in _NUMBERS:
        raise ValueError("an array is expected")
    return np.frombuffer(data[1:], chr(data[0]))


def _array(kind: Any, value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        raise ValueError("an array is expected")
    return value
