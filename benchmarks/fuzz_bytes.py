"""Mutations of bytes, of words in a line, and of a list of pieces.

A piece is a tag and bytes. The tag says how the piece itself is mutated (``INNER``, a line of words
unless a format says otherwise) and what ``join`` of its format makes of it.
"""

import random
import re
import struct
import zlib
from collections.abc import Callable, Sequence
from typing import Literal

Piece = tuple[str, bytes]
Pieces = list[Piece]

NUMBERS = (0, 1, 2, 3, 4, 7, 8, 9, 16, 17, 63, 100, 127, 128, 255, 256, 1000, 32767, 32768, 65535,
           65536, 2**24, 2**30, 2**31 - 1, 2**31, 2**32 - 1, 2**53, 2**63 - 1, 2**63,
           2**64 - 1)  # fmt: skip
FLOATS = (0.0, -0.0, -1.0, 1e-45, 1e-38, 3e38, 1e300, 5e-324, float("inf"), float("-inf"),
          float("nan"))  # fmt: skip
WORDS = (
    b"nan", b"inf", b"-inf", b"1e999", b"-1", b"0", b"1", b"2", b"-0", b"1e30", b"1e-320", b"1e308",
    b"0x10", b"1_0", b"+3", b"1.5", b"4294967295", b"9223372036854775808", b"1" * 30, b"9" * 400,
    b"9" * 5000, b"true", b"null", b"[", b"]", b"{", b"}", b'"', b"'", b"\\", b"=", b":", b",",
    b"#", b"\n", b"\r\n", b"\r", b"\t", b"\x0b", b"\x0c", b"\x1c", b"\x00", b"\xff\xfe",
    b"\xef\xbb\xbf", "\u2028".encode(), "\u0663".encode(), b"\xc2\x85", b"%s", b"..", b"/dev/zero",
    b"", b" ", b"/", b"1/1/1", b"-1//-1",
)  # fmt: skip
LONGEST = 1 << 16  # bytes of a mutant


def mutate_bytes(data: bytes, draw: random.Random, near: int = 400) -> bytes:
    """One random change: a bit, a byte, a number, a cut, a copy, a word; many near the start."""
    b = bytearray(data)
    at = draw.randrange(len(b)) if b else 0
    if b and draw.random() < 0.5:
        at = draw.randrange(min(len(b), near))
    kind = draw.randrange(11)
    if not b or kind == 0:
        b[at:at] = draw.choice(WORDS) * draw.choice((1, 1, 1, 300))
    elif kind == 1:
        b[at] ^= 1 << draw.randrange(8)
    elif kind == 2:
        b[at] = draw.choice((0, 1, 2, 3, 4, 0x7F, 0x80, 0xFE, 0xFF, draw.randrange(256)))
    elif kind in (3, 4, 5):
        size = draw.choice((2, 4, 4, 4, 8))
        at = at // size * size if draw.random() < 0.7 else at
        order: Literal["little", "big"] = "big" if draw.random() < 0.3 else "little"
        old = int.from_bytes(b[at : at + size], order)
        new = draw.choice((draw.choice(NUMBERS), old + draw.choice((-1, 1)), -1, old * 2, -old))
        b[at : at + size] = (new % 2 ** (8 * size)).to_bytes(size, order)
    elif kind == 6:
        code = draw.choice(["<f", "<d", ">f"])
        value = draw.choice(FLOATS)
        value = min(max(value, -3e38), 3e38) if code[1] == "f" and abs(value) < 1e301 else value
        part = struct.pack(code, value)
        at = at // len(part) * len(part)
        b[at : at + len(part)] = part
    elif kind == 7:
        del b[at:]
    elif kind == 8:
        del b[at : at + draw.choice((1, 2, 4, draw.randrange(1, 64)))]
    elif kind == 9:
        b[at:at] = b[at : at + draw.randrange(1, 64)] * draw.choice((1, 1, 1, 50))
    else:
        other, size = draw.randrange(len(b)), draw.randrange(1, 16)
        b[at : at + size] = b[other : other + size]
    return bytes(b[:LONGEST])


def mutate_line(line: bytes, draw: random.Random) -> bytes:
    """A change of one word of a line: another word, none, two, or a change of its bytes."""
    words = re.split(rb"(\s+|[=,:/(){}\[\]])", line)
    k = draw.randrange(len(words))
    kind = draw.randrange(6)
    if kind < 2:
        words[k] = draw.choice(WORDS)
    elif kind == 2:
        words[k] = words[draw.randrange(len(words))]
    elif kind == 3:
        words[k] = b""
    elif kind == 4:
        words[k] += draw.choice((b" ", b"")) + words[draw.randrange(len(words))]
    else:
        words[k] = mutate_bytes(words[k], draw)
    return b"".join(words)


def mutate_zlib(data: bytes, draw: random.Random) -> bytes:
    """A change of packed bytes: of what they unpack to, mostly."""
    try:
        plain = zlib.decompressobj().decompress(data, LONGEST)
    except zlib.error:
        return mutate_bytes(data, draw)
    return zlib.compress(mutate_bytes(plain, draw), draw.choice((0, 1, 9)))


def mutate_packed(data: bytes, draw: random.Random) -> bytes:
    """The same where packed bytes may follow 8 bytes of a chunk's place and length."""
    packed = mutate_zlib(data[8:], draw)
    return data[:4] + struct.pack("<I", len(packed)) + packed


Inner = Callable[[bytes, random.Random], bytes]
INNER: dict[str, Inner] = {
    "line": mutate_line,
    "zlib": mutate_zlib,
    "chunk": lambda data, draw: (mutate_packed if draw.random() < 0.3 else mutate_bytes)(
        data, draw
    ),
}


def mutate_pieces(pieces: Pieces, draw: random.Random, others: Sequence[Piece] = ()) -> None:
    """One random change of a list in place: drop, repeat, swap, take another's, change one."""
    if not pieces:
        pieces.append(("line", draw.choice(WORDS)))
    k, other = draw.randrange(len(pieces)), draw.randrange(len(pieces))
    kind = draw.randrange(12)
    if kind == 0:
        del pieces[k]
    elif kind == 1:
        pieces[other:other] = [pieces[k]] * draw.choice((1, 1, 2, 100))
    elif kind == 2:
        pieces[k], pieces[other] = pieces[other], pieces[k]
    elif kind == 3 and others:
        pieces[k:k] = [draw.choice(others)]
    elif kind == 4:
        pieces[k] = (pieces[k][0], pieces[other][1])
    else:
        tag, data = pieces[k]
        pieces[k] = (tag, INNER.get(tag.partition(":")[0], mutate_bytes)(data, draw))
