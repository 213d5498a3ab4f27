"""Memory that an X server on this machine writes pictures into (System V, as MIT-SHM wants)."""

from __future__ import annotations

import ctypes
from ctypes import c_int, c_size_t, c_void_p

import numpy as np
from numpy.typing import NDArray

from drivers.x11.connection import XConnection, XError

_PRIVATE, _CREATE, _REMOVE = 0, 0o1000, 0


class XSharedMemory:
    """Bytes shared with a server. XError if it can't see them: it may be another machine's."""

    def __init__(self, x: XConnection, size: int) -> None:
        self._x, self.segment = x, x.new_id()
        libc = ctypes.CDLL(None, use_errno=True)
        libc.shmget.argtypes = (c_int, c_size_t, c_int)
        libc.shmat.restype, libc.shmat.argtypes = c_void_p, (c_int, c_void_p, c_int)
        self._detach = libc.shmdt
        self._detach.argtypes = (c_void_p,)
        number = libc.shmget(_PRIVATE, size, _CREATE | 0o600)
        if number < 0:
            raise XError("no shared memory can be had")
        self._at = libc.shmat(number, None, 0)
        try:
            if self._at == c_void_p(-1).value:
                raise XError("the shared memory can't be reached")
            try:
                x.send_extension_request("MIT-SHM", 1, "IIB3x", self.segment, number, 0)
                if not self._is_visible_to_server():
                    raise XError(f"{x.display} can't see this machine's memory")
            except BaseException:
                self.close()
                raise
        finally:
            # It lives until both have let go, so that nobody who is killed leaves any behind.
            libc.shmctl(number, _REMOVE, None)
        memory = (ctypes.c_ubyte * size).from_address(self._at)
        self.bytes: NDArray[np.uint8] = np.ctypeslib.as_array(memory)

    def close(self) -> None:
        """After it, `bytes` must not be touched any more."""
        self._detach(self._at)

    def _is_visible_to_server(self) -> bool:
        """Whether the server has the memory: it refuses to read a pixel into it if not."""
        try:
            self.fetch(0, 0, 1, 1)
        except XError:
            return False
        return True

    def fetch(self, x: int, y: int, width: int, height: int) -> None:
        """Have the server write a rectangle of its root window's pixels here."""
        whole, pixmap = 0xFFFFFFFF, 2
        layout, root = "IhhHHIB3xII", self._x.setup.root
        given = (root, x, y, width, height, whole, pixmap, self.segment, 0)
        self._x.query_extension("MIT-SHM", 4, layout, *given)
