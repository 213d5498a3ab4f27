"""A device in a process of its own, so that a hung native library can be killed and named.

`Hosted` stands for the device here; `_serve` is the life of the device's process. Objects go
between the two by `_Channel`.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import math
import mmap
import os
import pickle
import pkgutil
import select
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from drivers.clock import RealClock
from drivers.errors import DeviceError

if TYPE_CHECKING:
    from drivers.interfaces import Surroundings

_PATIENCE = 0.02
"""Seconds between looks at whether a call was cancelled."""

_GRACE = 10.0
"""Seconds in which a process that was left alone must have made its device safe and ended."""

_KILLING = 1.0
"""Seconds for which a kill waits for its effect: one stuck in the kernel stays for longer."""

_FLAGS = 64
"""Bytes at the memory's beginning: byte i says that a call's callable i has turned true."""

_IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""They reach a whole process group; a device's process ends by itself, after its parent."""

_REMEDY = "Look at the device and at what its process wrote, and open it again"

_CHILD = (
    "import sys; sys.path[:] = sys.argv[4:]; "
    "from drivers.hosted import _serve; _serve(*sys.argv[1:4])"
)


class Hosted:
    """A device in a process of its own: whatever its library does, it can be killed.

    surroundings: of real devices; ValueError if they are virtual. model: the name in errors.
    factory: "module:attribute" of a callable `factory(surroundings, **options)`, which only
    the device's process imports. opening: seconds that making it may take at most, and
    entering it again.

    The constructor starts the process and makes the device: what the factory raises, or its
    import, comes from here. `__enter__` enters the device: what that raises comes from there.
    Both raise DeviceError, and the process is killed, if there is no answer in time.

    Public methods and attributes are the device's own, called and read there one at a time,
    in the process's main thread; attributes can't be set. A call waits for as long as the
    device takes: whoever can't wait calls `kill()`. Arguments and answers are copies. A
    callable among a method's arguments (`cancelled`) is asked here every 20 ms, and its place
    is taken there by one that turns true after it, or when this process is gone.

    Exceptions come back as themselves if they can be pickled and their class is known here,
    else as DeviceError, which also is what pending and later calls raise when the process has
    ended. A device that isn't left properly, because this process has ended, is made safe and
    left by its own process; it has 10 s for that.
    """

    def __init__(
        self,
        surroundings: Surroundings,
        model: str,
        factory: str,
        options: Mapping[str, Any],
        *,
        opening: float = 30.0,
    ) -> None:
        start = _start_of(surroundings, model)
        if not all(factory.partition(":")):
            raise ValueError(f"factory is {factory!r}; write it as 'module:attribute'")
        if not opening > 0:
            raise ValueError(f"opening is {opening} s; it must be positive")
        self._model, self._opening = model, opening
        self._names: dict[str, bool] = {}
        self._lock = threading.RLock()
        self._busy = self._owed = self._lost = False
        request = _pack(("open", factory, (start, dict(options)), {}))
        self._channel, self._process = _start()
        self._ended = os.pidfd_open(self._process.pid)
        self._release = weakref.finalize(self, _close, self._channel, self._process, self._ended)
        with self._or_ended():
            self._names = self._exchange("open", request, within=opening)

    def __enter__(self) -> Self:
        with self._or_ended():
            self._names = self._ask("enter", within=self._opening)
        return self

    def __exit__(self, *error: object) -> None:
        """Leave the device and end its process.

        May be called twice, and when the process was killed. DeviceError if it has ended
        otherwise, and nobody was told yet. The device isn't told of the exception in hand.
        """
        if not self._release.alive:
            return
        try:
            if not self._lost:
                self._ask("leave")
        finally:
            with self._lock:
                self._release()

    def kill(self) -> None:
        """End the device's process at once; from any thread, and as often as you like.

        A call that another thread waits for raises DeviceError there. The device isn't made
        safe. `__exit__` is to be called all the same.
        """
        self._lost = True
        self._process.kill()
        _reap(self._process, _KILLING)

    def __getattr__(self, name: str) -> Any:
        # Through __dict__: without names, as in a half-made object, this would ask itself.
        names: dict[str, bool] = self.__dict__.get("_names", {})
        if name not in names:
            raise AttributeError(f"{self.__dict__.get('_model', 'a device')} has no {name!r}")
        if not names[name]:
            return self._ask("get", name)

        def forwarded(*arguments: Any, **options: Any) -> Any:
            return self._ask("call", name, arguments, options)

        return forwarded

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_"):
            raise AttributeError(f"{name!r} of a device in another process can't be set")
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._names})

    def _ask(
        self,
        command: str,
        name: str = "",
        arguments: Sequence[Any] = (),
        options: Mapping[str, Any] | None = None,
        within: float = math.inf,
    ) -> Any:
        """What the device answers; what can't be sent raises here, and nothing was sent."""
        watched: list[Callable[[], Any]] = []
        given = tuple(_replaced(value, watched) for value in arguments)
        named = {key: _replaced(value, watched) for key, value in (options or {}).items()}
        if len(watched) > _FLAGS:
            raise ValueError(f"{name}: {len(watched)} callables; {_FLAGS} can be given at most")
        request = _pack((command, name, given, named))
        return self._exchange(name or command, request, watched, within)

    def _exchange(
        self,
        words: str,
        request: _Parcel,
        watched: Sequence[Callable[[], Any]] = (),
        within: float = math.inf,
    ) -> Any:
        """One request and its answer. words: the command's name in errors."""
        with self._turn(words):
            if self._owed:  # to a call that was broken off: nobody wants that answer
                self._wait(words, (), within)
                self._receive(words)
            self._channel.lower()
            self._send(words, request)
            try:
                self._wait(words, watched, within)
            except BaseException:
                # By Ctrl-C, for example: the device, too, needs to wait no longer.
                self._channel.raise_all()
                raise
            return self._answer(words, self._receive(words))

    @contextlib.contextmanager
    def _turn(self, words: str) -> Iterator[None]:
        with self._lock:
            if self._busy:
                raise RuntimeError(f"{self._model}: {words} from within another call of it")
            if not self._release.alive:
                raise DeviceError(self._model, words, "it is closed", "Open it again")
            self._busy = True
            try:
                yield
            finally:
                self._busy = False

    def _send(self, words: str, request: _Parcel) -> None:
        note = self._channel.write(request)
        self._owed = True
        try:
            self._channel.connection.send(note)
        except OSError:
            raise self._death(words) from None

    def _wait(self, words: str, watched: Sequence[Callable[[], Any]], within: float) -> None:
        """Return when there is an answer, or none will come; see `_receive`."""
        late = time.monotonic() + within
        deaf = dict(enumerate(watched))
        while True:
            for index in [i for i, turned_true in deaf.items() if turned_true()]:
                self._channel.raise_flag(index)
                del deaf[index]
            patience = _PATIENCE if deaf or late < math.inf else None
            if wait([self._channel.connection, self._ended], patience):
                return
            if time.monotonic() > late:
                self.kill()
                reply = f"no answer within {within:g} s; its process was killed"
                raise DeviceError(self._model, words, reply, _REMEDY)

    def _receive(self, words: str) -> _Parcel:
        try:
            # An ended process may still have answered; a process of its own that it has
            # left behind may hold the socket open, so that no end of file comes.
            if not self._channel.connection.poll(0):
                raise EOFError
            note = self._channel.connection.recv()
        except (EOFError, OSError):
            raise self._death(words) from None
        self._owed = False
        return self._channel.read(note)

    def _answer(self, words: str, parcel: _Parcel) -> Any:
        """The answer itself, or what it says that went wrong."""
        try:
            good, answer = parcel.unpacked()
        except Exception as error:
            reply = f"its answer can't be read in this process: {error!r}"
            raise DeviceError(self._model, words, reply, _REMEDY) from error
        if good:
            return answer
        failure: _Failure = answer
        raised = failure.known()
        if raised is None:
            raised = DeviceError(self._model, words, failure.said, _REMEDY)
        raised.add_note(f"In the device's process:\n{failure.trace}")
        raise raised

    def _death(self, words: str) -> DeviceError:
        """How the process has ended. One that only has shut its ears is killed."""
        self._lost = True
        code = _reap(self._process, _KILLING)
        if code is None:
            self.kill()
            code = self._process.returncode
        reply = f"its process ended (exit status {code})"
        if code is None:
            reply = "its process was killed, but hangs in the system"
        elif code < 0:
            reply = f"its process ended (signal {-code})"
        return DeviceError(self._model, words, reply, _REMEDY)

    @contextlib.contextmanager
    def _or_ended(self) -> Iterator[None]:
        """What fails to open is never left: nobody else would end its process."""
        try:
            yield
        except BaseException as error:
            # Broken off by Ctrl-C, it may be busy for long; else it waits for a word.
            if not isinstance(error, Exception):
                self.kill()
            with self._lock:
                self._release()
            raise


class _Parcel(NamedTuple):
    """A pickled object; its large arrays lie beside it, so that they are copied only once."""

    body: Any
    buffers: Sequence[Any]

    def unpacked(self) -> Any:
        return pickle.loads(self.body, buffers=self.buffers)


def _pack(thing: Any) -> _Parcel:
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(thing, protocol=5, buffer_callback=buffers.append)
    return _Parcel(body, [buffer.raw() for buffer in buffers])


class _Note(NamedTuple):
    """Says that a parcel lies in the memory: the memory's length, and its parts' in bytes."""

    length: int
    sizes: list[int]


class _Channel:
    """One of two ends between which parcels go: they lie in memory that both can see.

    The connection carries notes of them. The memory has no name, so that nothing is left
    behind, whoever is killed. Both speak in turn: a parcel is copied out before the next.
    """

    def __init__(self, end: int, memory: int) -> None:
        self.connection = Connection(end)
        self._memory = mmap.mmap(memory, 0)
        os.close(memory)

    def close(self) -> None:
        self.connection.close()
        # Not while the traceback of a failed read still holds a part of it.
        with contextlib.suppress(BufferError):
            self._memory.close()

    def write(self, parcel: _Parcel) -> _Note:
        parts = (parcel.body, *parcel.buffers)
        sizes = [memoryview(part).nbytes for part in parts]
        self._reach(_FLAGS + sum(sizes))
        offset = _FLAGS
        for part, size in zip(parts, sizes, strict=True):
            self._memory[offset : offset + size] = part
            offset += size
        return _Note(len(self._memory), sizes)

    def read(self, note: _Note) -> _Parcel:
        # Only here, for it starts threads: the device's process forks its guard before.
        import numpy as np

        self._reach(note.length)
        parts = []
        offset = _FLAGS
        for size in note.sizes:
            parts.append(np.frombuffer(self._memory, np.uint8, size, offset).copy())
            offset += size
        return _Parcel(parts[0], parts[1:])

    def _reach(self, length: int) -> None:
        """Memory only grows: fresh memory for each picture takes longer than the picture."""
        if length > len(self._memory):
            self._memory.resize(length)

    def lower(self) -> None:
        self._memory[:_FLAGS] = bytes(_FLAGS)

    def raise_flag(self, index: int) -> None:
        self._memory[index] = 1

    def raise_all(self) -> None:
        self._memory[:_FLAGS] = bytes([1]) * _FLAGS

    def raised(self, index: int) -> bool:
        return self._memory[index] != 0

    def abandoned(self) -> bool:
        """Whether the other end has been closed."""
        return bool(_hang_up(self.connection.fileno()).poll(0))


def _hang_up(end: int) -> select.poll:
    """What tells that the other end of a socket has been closed, and nothing else."""
    closed = select.poll()
    closed.register(end, select.POLLRDHUP)
    return closed


class _Flag:
    """Stands for a callable of the other process; true as well when that is gone.

    Its word holds for one call: afterwards it is true, so that whoever still asks may go.
    """

    def __init__(self, index: int) -> None:
        self._index = index
        self._channel: _Channel | None = None

    def __call__(self) -> bool:
        channel = self._channel
        return channel is None or channel.raised(self._index) or channel.abandoned()

    @contextlib.contextmanager
    def heard(self, channel: _Channel) -> Iterator[None]:
        self._channel = channel
        try:
            yield
        finally:
            self._channel = None


def _replaced(value: Any, watched: list[Callable[[], Any]]) -> Any:
    """A flag in place of a callable. A class is a value: np.uint16 isn't asked anything."""
    if not callable(value) or isinstance(value, type):
        return value
    watched.append(value)
    return _Flag(len(watched) - 1)


class _Failure(NamedTuple):
    """An exception on its way: pickled if it can be, in words, and how it came about."""

    pickled: bytes | None
    said: str
    trace: str

    @staticmethod
    def of(error: BaseException) -> _Failure:
        pickled = None
        # SystemExit and its kind would end the process that asked.
        if isinstance(error, Exception):
            with contextlib.suppress(Exception):
                pickled = pickle.dumps(error)
                # Many can be pickled but not made again, for want of their arguments.
                if type(pickle.loads(pickled)) is not type(error):
                    pickled = None
        return _Failure(pickled, repr(error), "".join(traceback.format_exception(error)))

    def known(self) -> Exception | None:
        """The exception itself; None if nobody here could expect it."""
        with contextlib.suppress(Exception):
            return None if self.pickled is None else _Known(io.BytesIO(self.pickled)).load()
        return None


class _Known(pickle.Unpickler):
    """Makes only what this process knows: a library's own errors would load the library."""

    def find_class(self, module: str, name: str) -> Any:
        if module not in sys.modules:
            raise pickle.UnpicklingError(f"{module} isn't loaded")
        return super().find_class(module, name)


def _start_of(surroundings: Surroundings, model: str) -> float:
    """When the bench's clock started; ValueError if it can't be shown in another process."""
    if surroundings.world is None and isinstance(surroundings.clock, RealClock):
        return surroundings.clock.start
    raise ValueError(
        f"{model} can't live in a process of its own: the bench's virtual world and its time "
        "are in this one. Open it in this process, or have only real devices on the bench"
    )


def _start() -> tuple[_Channel, subprocess.Popen[bytes]]:
    """A device's process that has not been told yet which."""
    ours, theirs = socket.socketpair()
    memory = os.memfd_create("labapp-device")
    os.ftruncate(memory, mmap.PAGESIZE)
    channel = _Channel(ours.detach(), os.dup(memory))
    given = (theirs.fileno(), memory)
    command = [sys.executable, "-u", "-X", "faulthandler", "-c", _CHILD]
    command += [str(number) for number in (*given, _GRACE)] + sys.path
    # Blocked until the child ignores them: Ctrl-C must not find it half awake.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _IGNORED)
    try:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=2, pass_fds=given)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
        os.close(memory)
    return channel, process


def _close(channel: _Channel, process: subprocess.Popen[bytes], ended: int) -> None:
    """Let the process end, which makes its device safe first if it was never left."""
    channel.close()
    if _reap(process, _GRACE) is None:
        process.kill()
        _reap(process, _KILLING)
    os.close(ended)


def _reap(process: subprocess.Popen[bytes], patience: float) -> int | None:
    """The process's exit status; None if it hasn't ended after `patience` seconds."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.wait(patience)
    return None


# What follows runs in the device's process.


def _serve(end: str, memory: str, grace: str) -> None:
    """Do what is asked at `end` of a socket, until it is closed; then leave the device safe.

    end, memory: file descriptors. grace: seconds for that. All three from a command line,
    which isn't the device's: some libraries read it.
    """
    for number in _IGNORED:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _IGNORED)
    del sys.argv[1:]
    for descriptor in (int(end), int(memory)):
        os.set_inheritable(descriptor, False)
    _guard(int(end), float(grace))
    _Host(_Channel(int(end), int(memory))).run()


def _guard(end: int, grace: float) -> None:
    """Make a process that kills this one if it doesn't end in time after its parent has.

    A thread couldn't: a library that hangs may hold the interpreter's lock. It is forked, so
    this is to be called before there are threads; and it is nobody's child, for a library
    that waits for its own children must not find it.
    """
    device = os.pidfd_open(os.getpid())
    between = os.fork()
    if between:
        os.close(device)
        os.waitpid(between, 0)
        return
    try:
        if not os.fork():
            _watch(device, end, grace)
    finally:
        os._exit(0)


def _watch(device: int, end: int, grace: float) -> None:
    either = _hang_up(end)
    either.register(device, select.POLLIN)
    either.poll()
    if not select.select([device], [], [], grace)[0]:
        signal.pidfd_send_signal(device, signal.SIGKILL)


class _Host:
    """Where the device lives."""

    def __init__(self, channel: _Channel) -> None:
        self._channel = channel
        self._device: Any = None
        # What is to be done before this process ends, the last first.
        self._duties = contextlib.ExitStack()
        self._left = False

    def run(self) -> None:
        with self._duties, contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
            while not self._left:
                request = self._channel.read(self._channel.connection.recv())
                self._channel.connection.send(self._reply(request))

    def _reply(self, request: _Parcel) -> _Note:
        try:
            answer = self._obey(*request.unpacked())
        except BaseException as error:
            return self._channel.write(_pack((False, _Failure.of(error))))
        try:
            return self._channel.write(_pack((True, answer)))
        except Exception as error:
            said = f"its answer can't leave its process: {error!r}"
            failure = _Failure(None, said, "".join(traceback.format_exception(error)))
            return self._channel.write(_pack((False, failure)))

    def _obey(
        self, command: str, name: str, arguments: Sequence[Any], options: Mapping[str, Any]
    ) -> Any:
        match command:
            case "open":
                return self._open(name, *arguments)
            case "enter":
                return self._enter()
            case "leave":
                self._left = True
                self._duties.pop_all()
                self._manager.__exit__(None, None, None)
                return None
            case "get":
                return getattr(self._device, name)
        with contextlib.ExitStack() as heard:
            for value in (*arguments, *options.values()):
                if isinstance(value, _Flag):
                    heard.enter_context(value.heard(self._channel))
            return getattr(self._device, name)(*arguments, **options)

    def _open(self, factory: str, start: float, options: Mapping[str, Any]) -> dict[str, bool]:
        from drivers.interfaces import Surroundings

        self._manager = pkgutil.resolve_name(factory)(Surroundings(RealClock(start)), **options)
        self._device = self._manager
        return _public(self._device)

    def _enter(self) -> dict[str, bool]:
        self._device = self._manager.__enter__()
        self._duties.push(self._manager.__exit__)
        self._duties.callback(self._device.make_safe)
        return _public(self._device)


def _public(device: Any) -> dict[str, bool]:
    """The names that others may use, and whether each is a method; no property is read."""
    names = {}
    for name in dir(device):
        if not name.startswith("_"):
            thing = inspect.getattr_static(device, name, None)
            method = callable(thing) or isinstance(thing, classmethod)
            names[name] = method and not isinstance(thing, type)
    return names
