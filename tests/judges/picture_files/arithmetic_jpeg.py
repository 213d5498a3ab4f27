"""A grey JPEG of sequential DCT with arithmetic coding (SOF9), from ITU-T T.81 annexes D and F."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn

_QUANTISER = 4

# Table D.3 of T.81: Qe, next state after LPS, after MPS, whether the sense is exchanged.
_STATES = [
    (0x5A1D, 1, 1, 1), (0x2586, 14, 2, 0), (0x1114, 16, 3, 0), (0x080B, 18, 4, 0),
    (0x03D8, 20, 5, 0), (0x01DA, 23, 6, 0), (0x00E5, 25, 7, 0), (0x006F, 28, 8, 0),
    (0x0036, 30, 9, 0), (0x001A, 33, 10, 0), (0x000D, 35, 11, 0), (0x0006, 9, 12, 0),
    (0x0003, 10, 13, 0), (0x0001, 12, 13, 0), (0x5A7F, 15, 15, 1), (0x3F25, 36, 16, 0),
    (0x2CF2, 38, 17, 0), (0x207C, 39, 18, 0), (0x17B9, 40, 19, 0), (0x1182, 42, 20, 0),
    (0x0CEF, 43, 21, 0), (0x09A1, 45, 22, 0), (0x072F, 46, 23, 0), (0x055C, 48, 24, 0),
    (0x0406, 49, 25, 0), (0x0303, 51, 26, 0), (0x0240, 52, 27, 0), (0x01B1, 54, 28, 0),
    (0x0144, 56, 29, 0), (0x00F5, 57, 30, 0), (0x00B7, 59, 31, 0), (0x008A, 60, 32, 0),
    (0x0068, 62, 33, 0), (0x004E, 63, 34, 0), (0x003B, 32, 35, 0), (0x002C, 33, 9, 0),
    (0x5AE1, 37, 37, 1), (0x484C, 64, 38, 0), (0x3A0D, 65, 39, 0), (0x2EF1, 67, 40, 0),
    (0x261F, 68, 41, 0), (0x1F33, 69, 42, 0), (0x19A8, 70, 43, 0), (0x1518, 72, 44, 0),
    (0x1177, 73, 45, 0), (0x0E74, 74, 46, 0), (0x0BFB, 75, 47, 0), (0x09F8, 77, 48, 0),
    (0x0861, 78, 49, 0), (0x0706, 79, 50, 0), (0x05CD, 48, 51, 0), (0x04DE, 50, 52, 0),
    (0x040F, 50, 53, 0), (0x0363, 51, 54, 0), (0x02D4, 52, 55, 0), (0x025C, 53, 56, 0),
    (0x01F8, 54, 57, 0), (0x01A4, 55, 58, 0), (0x0160, 56, 59, 0), (0x0125, 57, 60, 0),
    (0x00F6, 58, 61, 0), (0x00CB, 59, 62, 0), (0x00AB, 61, 63, 0), (0x008F, 61, 32, 0),
    (0x5B12, 65, 65, 1), (0x4D04, 80, 66, 0), (0x412C, 81, 67, 0), (0x37D8, 82, 68, 0),
    (0x2FE8, 83, 69, 0), (0x293C, 84, 70, 0), (0x2379, 86, 71, 0), (0x1EDF, 87, 72, 0),
    (0x1AA9, 87, 73, 0), (0x174E, 72, 74, 0), (0x1424, 72, 75, 0), (0x119C, 74, 76, 0),
    (0x0F6B, 74, 77, 0), (0x0D51, 75, 78, 0), (0x0BB6, 77, 79, 0), (0x0A40, 77, 48, 0),
    (0x5832, 80, 81, 1), (0x4D1C, 88, 82, 0), (0x438E, 89, 83, 0), (0x3BDD, 90, 84, 0),
    (0x34EE, 91, 85, 0), (0x2EAE, 92, 86, 0), (0x299A, 93, 87, 0), (0x2516, 86, 71, 0),
    (0x5570, 88, 89, 1), (0x4CA9, 95, 90, 0), (0x44D9, 96, 91, 0), (0x3E22, 97, 92, 0),
    (0x3824, 99, 93, 0), (0x32B4, 99, 94, 0), (0x2E17, 93, 86, 0), (0x56A8, 95, 96, 1),
    (0x4F46, 101, 97, 0), (0x47E5, 102, 98, 0), (0x41CF, 103, 99, 0), (0x3C3D, 104, 100, 0),
    (0x375E, 99, 93, 0), (0x5231, 105, 102, 0), (0x4C0F, 106, 103, 0), (0x4639, 107, 104, 0),
    (0x415E, 103, 99, 0), (0x5627, 105, 106, 1), (0x50E7, 108, 107, 0), (0x4B85, 109, 103, 0),
    (0x5597, 110, 109, 0), (0x504F, 111, 107, 0), (0x5A10, 110, 111, 1), (0x5522, 112, 109, 0),
    (0x59EB, 112, 111, 1), (0x5A1D, 113, 113, 0),
]  # fmt: skip


class _Coder:
    """The encoder of annex D.1, with the byte output of figures D.8 to D.15."""

    def __init__(self) -> None:
        self.a, self.c, self.ct = 0x10000, 0, 11
        self.stack, self.out = 0, bytearray(b"\0")
        # The sign of a coefficient is taken to be even, for good (state 113).
        self.state: dict[tuple[str, int], tuple[int, int]] = {("even", 0): (113, 0)}

    def code(self, place: tuple[str, int], bit: int) -> None:
        """One decision in a context."""
        index, likely = self.state.get(place, (0, 0))
        qe, after_lps, after_mps, exchange = _STATES[index]
        self.a -= qe
        if bit == likely:
            if self.a >= 0x8000:
                return
            if self.a < qe:
                self.c, self.a = self.c + self.a, qe
            self.state[place] = (after_mps, likely)
        else:
            if self.a >= qe:
                self.c, self.a = self.c + self.a, qe
            self.state[place] = (after_lps, likely ^ exchange)
        while self.a < 0x8000:
            self._shift()

    def _shift(self) -> None:
        self.a, self.c, self.ct = self.a << 1, self.c << 1, self.ct - 1
        if self.ct == 0:
            self._byte_out()
            self.ct = 8

    def _byte_out(self) -> None:
        t = self.c >> 19
        if t > 0xFF:
            self.out[-1] += 1
            if self.out[-1] == 0xFF:
                self.out.append(0)
            self.out += bytes(self.stack)
            self.stack = 0
            self.out.append(t & 0xFF)
        elif t == 0xFF:
            self.stack += 1
        else:
            self.out += b"\xff\0" * self.stack
            self.stack = 0
            self.out.append(t)
        self.c &= 0x7FFFF

    def end(self) -> bytes:
        """Flush (figure D.15): as many trailing zeros as can be."""
        t = (self.c + self.a - 1) & 0xFFFF0000
        self.c = t + 0x8000 if t < self.c else t
        self.c <<= self.ct
        self._byte_out()
        self.c <<= 8
        self._byte_out()
        return bytes(self.out[1:]).rstrip(b"\0")


def arithmetic_jpeg(levels: NDArray[np.uint8]) -> bytes:
    """The whole file of grey levels (rows, columns)."""
    rows, columns = levels.shape
    padded = np.pad(levels, ((0, -rows % 8), (0, -columns % 8)), "edge").astype(float) - 128
    coder, before, context = _Coder(), 0, 0
    for i in range(0, padded.shape[0], 8):
        for j in range(0, padded.shape[1], 8):
            block = np.rint(dctn(padded[i : i + 8, j : j + 8], norm="ortho") / _QUANTISER)
            zigzag = [int(block[y, x]) for y, x in _ZIGZAG]
            context = _code_dc(coder, zigzag[0] - before, context)
            before = zigzag[0]
            _code_ac(coder, zigzag)
    head = b"\xff\xd8\xff\xdb" + struct.pack(">HB", 67, 0) + bytes([_QUANTISER]) * 64
    head += b"\xff\xc9" + struct.pack(">HBHHB3B", 11, 8, rows, columns, 1, 1, 0x11, 0)
    head += b"\xff\xda" + struct.pack(">HB2B3B", 8, 1, 1, 0, 0, 63, 0)
    return head + coder.end() + b"\xff\xd9"


def _code_dc(coder: _Coder, value: int, context: int) -> int:
    """F.1.4.1; returns the context of the next difference (table F.4, L = 0 and U = 1)."""
    first = 4 * context
    coder.code(("dc", first), int(value != 0))
    if value == 0:
        return 0
    negative = int(value < 0)
    coder.code(("dc", first + 1), negative)
    _code_magnitude(coder, "dc", abs(value) - 1, [first + 2 + negative, *range(20, 34)])
    large = 2 * int(abs(value) > 2)
    return 1 + negative + large


def _code_ac(coder: _Coder, zigzag: list[int]) -> None:
    """F.1.4.2: end of block, zeros, sign, and magnitude of each coefficient."""
    end = max((k for k in range(1, 64) if zigzag[k]), default=0)
    k = 1
    while k <= end:
        coder.code(("ac", 3 * (k - 1)), 0)
        while zigzag[k] == 0:
            coder.code(("ac", 3 * (k - 1) + 1), 0)
            k += 1
        own = 3 * (k - 1) + 2
        coder.code(("ac", own - 1), 1)
        coder.code(("even", 0), int(zigzag[k] < 0))
        begin = 189 if k <= 5 else 217
        # The second decision of the size shares the first one's context.
        _code_magnitude(coder, "ac", abs(zigzag[k]) - 1, [own, own, *range(begin, begin + 14)])
        k += 1
    if k < 64:
        coder.code(("ac", 3 * (k - 1)), 1)


def _code_magnitude(coder: _Coder, table: str, less_one: int, places: list[int]) -> None:
    """The number of bits in unary, a context each (F.1.4.3), then the bits below the highest."""
    count = less_one.bit_length()
    for place in places[:count]:
        coder.code((table, place), 1)
    coder.code((table, places[count]), 0)
    for shift in range(count - 2, -1, -1):
        coder.code((table, places[count] + 14), less_one >> shift & 1)


_ZIGZAG = sorted(
    ((y, x) for y in range(8) for x in range(8)),
    key=lambda p: (p[0] + p[1], p[1] if (p[0] + p[1]) % 2 == 0 else p[0]),
)
