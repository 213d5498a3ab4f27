"""What stands here for a device in another process."""

from __future__ import annotations

import contextlib
import math
import mmap
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.hosted.calls import CallRequest, CallResult
from drivers.hosted.child_process import ChildProcess, ProcessEnded
from drivers.hosted.flags import replace_callable
from drivers.hosted.parcels import Parcel, pack
from drivers.hosted.shared_memory_channel import FLAG_COUNT, SharedMemoryChannel

if TYPE_CHECKING:
    from typing import Self

    from drivers.interfaces import Surroundings

_REMEDY = "Look at the device and at what its process wrote, and open it again"


class HostedDevice:
    """A device in a process of its own: whatever its library does, it can be killed.

    surroundings: of real devices; ValueError if they are virtual. model: the name in errors.
    factory: "module:attribute" of a callable `factory(surroundings, **options)`, which only
    the device's process imports. open_timeout: seconds that making it may take at most, and
    entering it again. reply_timeout: seconds that any other call may take at most; for ever if
    it isn't given.

    The constructor starts the process and makes the device: what the factory raises, or its
    import, comes from here. `__enter__` enters the device: what that raises comes from there.
    Both raise DeviceError, and the process is killed, if there is no answer in time.

    Public methods and attributes are the device's own, called and read there one at a time,
    in the process's main thread; attributes can't be set. A call waits for as long as the
    device takes, unless `reply_timeout` says otherwise: whoever can't wait calls `kill()`.
    Arguments and answers are copies. A callable among a method's arguments (`cancelled`) is
    asked here every 20 ms, and its place is taken there by one that turns true after it, or
    when this process is gone. A device that has something to do between two calls has a
    method `_attend_until_readable(end)`: it does it until that descriptor can be read.

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
        open_timeout: float = 30.0,
        reply_timeout: float = math.inf,
    ) -> None:
        began = _clock_start(surroundings, model)
        if not all(factory.partition(":")):
            raise ValueError(f"factory is {factory!r}; write it as 'module:attribute'")
        for word, seconds in (("open_timeout", open_timeout), ("reply_timeout", reply_timeout)):
            if not seconds > 0:
                raise ValueError(f"{word} is {seconds} s; it must be positive")
        self._model, self._open_timeout, self._reply_timeout = model, open_timeout, reply_timeout
        self._names: dict[str, bool] = {}
        self._lock = threading.RLock()
        self._busy = self._reply_pending = self._lost = False
        request = pack(CallRequest("open", (factory, began, dict(options))))
        self._process = ChildProcess("drivers.hosted.serving:serve", memory=mmap.PAGESIZE)
        self._channel = SharedMemoryChannel(self._process.line)
        self._release = weakref.finalize(self, _close, self._channel, self._process)
        with self._close_on_failure():
            self._names = self._exchange("open", request, within=open_timeout)

    def __enter__(self) -> Self:
        with self._close_on_failure():
            self._names = self._ask("enter", within=self._open_timeout)
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

    @property
    def is_dead(self) -> bool:
        """Whether the device's process has ended, or is about to, and answers no more."""
        return self._lost or self._process.exit_code() is not None

    def __getattr__(self, name: str) -> Any:
        # Through __dict__: without names, as in a half-made object, this would ask itself.
        names: dict[str, bool] = self.__dict__.get("_names", {})
        if name not in names:
            raise AttributeError(f"{self.__dict__.get('_model', 'a device')} has no {name!r}")
        if not names[name]:
            return self._exchange(
                name, pack(CallRequest("get", (name,))), within=self._reply_timeout
            )

        def forward_call(*arguments: Any, **options: Any) -> Any:
            return self._call(name, arguments, options)

        return forward_call

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_"):
            raise AttributeError(f"{name!r} of a device in another process can't be set")
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._names})

    def _ask(self, command: str, *given: Any, within: float | None = None) -> Any:
        """What the device's process answers."""
        seconds = self._reply_timeout if within is None else within
        return self._exchange(command, pack(CallRequest(command, given)), within=seconds)

    def _call(self, name: str, arguments: Sequence[Any], options: Mapping[str, Any]) -> Any:
        """What the device answers; what can't be sent raises here, and nothing was sent."""
        watched: list[Callable[[], Any]] = []
        given = [replace_callable(value, watched) for value in arguments]
        named = {key: replace_callable(value, watched) for key, value in options.items()}
        if len(watched) > FLAG_COUNT:
            raise ValueError(f"{name}: {len(watched)} callables; {FLAG_COUNT} can be given at most")
        request = pack(CallRequest("call", (name, given, named)))
        return self._exchange(name, request, watched, self._reply_timeout)

    def _exchange(
        self,
        words: str,
        request: Parcel,
        watched: Sequence[Callable[[], Any]] = (),
        within: float = math.inf,
    ) -> Any:
        """One request and its answer. words: the command's name in errors."""
        with self._turn(words):
            if self._reply_pending:  # to a call that was broken off: nobody wants that answer
                self._receive(words, within)
            self._channel.lower_flags()
            self._reply_pending = True
            self._process.send(self._channel.write(request))
            try:
                parcel = self._receive(words, within, watched)
            except BaseException:
                # By Ctrl-C, for example: the device, too, needs to wait no longer.
                self._channel.raise_all_flags()
                raise
            return self._result(words, parcel)

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

    def _receive(
        self, words: str, within: float, watched: Sequence[Callable[[], Any]] = ()
    ) -> Parcel:
        deaf = dict(enumerate(watched))

        def look() -> None:
            for index in [i for i, turned_true in deaf.items() if turned_true()]:
                self._channel.raise_flag(index)
                del deaf[index]

        try:
            note = self._process.receive(within, look if deaf else None)
        except ProcessEnded as error:
            self._lost = True
            raise DeviceError(self._model, words, str(error), _REMEDY) from None
        self._reply_pending = False
        # An answer without a note is the last one: the whole process has failed.
        return pack(note) if isinstance(note, CallResult) else self._channel.read(note)

    def _result(self, words: str, parcel: Parcel) -> Any:
        """The answer itself, or what it says that went wrong."""
        try:
            answer: CallResult = parcel.unpack()
        except Exception as error:
            reply = f"its answer can't be read in this process: {error!r}"
            raise DeviceError(self._model, words, reply, _REMEDY) from error
        failure = answer.failure
        if failure is None:
            return answer.value
        raised = failure.to_exception()
        if raised is None:
            raised = DeviceError(self._model, words, failure.message, _REMEDY)
        raised.add_note(f"In the device's process:\n{failure.trace}")
        raise raised

    @contextlib.contextmanager
    def _close_on_failure(self) -> Iterator[None]:
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


def _close(channel: SharedMemoryChannel, process: ChildProcess) -> None:
    """Let the process end, which makes its device safe first if it was never left."""
    channel.close()
    process.close()


def _clock_start(surroundings: Surroundings, model: str) -> float:
    """When the bench's clock started; ValueError if it can't be shown in another process."""
    if surroundings.world is None and isinstance(surroundings.clock, RealClock):
        return surroundings.clock.start
    raise ValueError(
        f"{model} can't live in a process of its own: the bench's virtual world and its time "
        "are in this one. Open it in this process, or have only real devices on the bench"
    )
