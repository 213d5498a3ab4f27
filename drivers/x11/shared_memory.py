"""System V memory that an X server on this machine writes to, by its MIT-SHM extension."""

from __future__ import annotations

import ctypes
from ctypes import c_int, c_size_t, c_void_p

import numpy as np
from numpy.typing import NDArray

from drivers.x11.connection import XConnection, XError


class XSharedMemory:
    """Bytes shared with an X server; XError if that can't be, as on another machine."""

    def __init__(self, x: XConnection, size: int) -> None:
        self._x, self.segment = x, x.new_id()
        libc = ctypes.CDLL(None, use_errno=True)
        libc.shmget.argtypes = (c_int, c_size_t, c_int)
        libc.shmat.restype, libc.shmat.argtypes = c_void_p, (c_int, c_void_p, c_int)
        self._detach = libc.shmdt
        self._detach.argtypes = (c_void_p,)
        # These are constants of Linux' sys/ipc.h.
        ipc_private, ipc_creat, ipc_rmid = 0, 0o1000, 0
        number = libc.shmget(ipc_private, size, ipc_creat | 0o600)
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
            # The segment exists until both processes have detached it, even if one is killed.
            libc.shmctl(number, ipc_rmid, None)
        memory = (ctypes.c_ubyte * size).from_address(self._at)
        self.bytes: NDArray[np.uint8] = np.ctypeslib.as_array(memory)

    def close(self) -> None:
        """Detach the memory; `bytes` must not be used afterwards."""
        self._detach(self._at)

    def _is_visible_to_server(self) -> bool:
        """Return whether the server can access the memory, by having it write one pixel."""
        try:
            self.fetch(0, 0, 1, 1)
        except XError:
            return False
        return True

    def fetch(self, x: int, y: int, width: int, height: int) -> None:
        """Have the server write a rectangle of its root window to this memory."""
        whole, pixmap = 0xFFFFFFFF, 2
        layout, root = "IhhHHIB3xII", self._x.setup.root
        given = (root, x, y, width, height, whole, pixmap, self.segment, 0)
        self._x.query_extension("MIT-SHM", 4, layout, *given)
