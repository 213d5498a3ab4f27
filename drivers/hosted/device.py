"""Stand-in for a device that runs in a child process."""

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
    """Stand in for a device in a child process, which can be killed whatever its library does.

    The constructor starts the process and makes the device; exceptions of the factory and of its
    import pass through. `__enter__` enters the device; its exceptions pass through, too. Both raise
    DeviceError and kill the process if there is no reply in time.

    Public methods and attributes are those of the device. They are called and read in the main
    thread of the child process, one at a time; attributes can't be set. A call waits for as long as
    the device takes, up to `reply_timeout`; `kill()` ends it earlier. Arguments and results are
    copies. A callable among a method's arguments (`cancelled`) is polled in this process every
    20 ms; the device gets a substitute, which becomes true after the callable does or when this
    process has ended. A device that has work to do between two calls has a method
    `_attend_until_readable(end)`, which does this work until the descriptor `end` can be read.

    An exception of the device is raised here unchanged if it can be pickled and its class is known
    in this process, and otherwise as DeviceError. Pending and later calls raise DeviceError if the
    child process has ended. If this process ends without leaving the device, the child process
    makes the device safe and leaves it; it has 10 s for that.

    Parameters
    ----------
    surroundings : Surroundings
        Surroundings of real devices.
    model : str
        The device's name in errors.
    factory : str
        "module:attribute" of a callable `factory(surroundings, **options)`, which only the child
        process imports.
    options : mapping
        Keyword arguments of the factory.
    open_timeout : float, default 30.0
        Longest time for making the device, and again for entering it, in seconds.
    reply_timeout : float, default inf
        Longest time for any other call, in seconds.

    Raises
    ------
    ValueError
        If the surroundings are virtual, `factory` isn't of that form, or a timeout isn't positive.
    DeviceError
        If the device isn't made in time, or the child process ends.
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

        It may be called twice, and after kill(). It raises DeviceError if the process has ended in
        another way that no earlier call has reported. A present exception isn't passed on to the
        device.
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
        """Kill the child process at once; from any thread, also repeatedly.

        A pending call of another thread raises DeviceError there. The device isn't made safe.
        `__exit__` must still be called.
        """
        self._lost = True
        self._process.kill()

    @property
    def is_dead(self) -> bool:
        """Whether the child process has ended, and no longer answers."""
        return self._lost or self._process.exit_code() is not None

    def __getattr__(self, name: str) -> Any:
        # An object whose constructor has failed may lack `_names`; reading it directly would call
        # this method again without end.
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
        """Send a request to the child process and return the result."""
        seconds = self._reply_timeout if within is None else within
        return self._exchange(command, pack(CallRequest(command, given)), within=seconds)

    def _call(self, name: str, arguments: Sequence[Any], options: Mapping[str, Any]) -> Any:
        """Call a method of the device; if an argument can't be sent, raise and send nothing."""
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
        """Send the child process one request, and return the result.

        words: the command's name in errors.
        """
        with self._turn(words):
            if self._reply_pending:  # The reply to a call that was interrupted is discarded.
                self._receive(words, within)
            self._channel.lower_flags()
            self._reply_pending = True
            self._process.send(self._channel.write(request))
            try:
                parcel = self._receive(words, within, watched)
            except BaseException:
                # After an exception, for example by Ctrl-C, the device's call is cancelled, too.
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
        """Receive a reply; meanwhile poll the callables that the device watches."""
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
        # A CallResult in place of a parcel's header says that the whole process has failed.
        return pack(note) if isinstance(note, CallResult) else self._channel.read(note)

    def _result(self, words: str, parcel: Parcel) -> Any:
        """Return the value in a reply, or raise the exception in it."""
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
        """End the child process if opening fails.

        Python doesn't call `__exit__()` if the constructor or `__enter__()` raises an exception.
        """
        try:
            yield
        except BaseException as error:
            # After Ctrl-C the process may still be busy, so it is killed. After another exception
            # it waits for a request and ends by itself.
            if not isinstance(error, Exception):
                self.kill()
            with self._lock:
                self._release()
            raise


def _close(channel: SharedMemoryChannel, process: ChildProcess) -> None:
    """End a child process, which first makes its device safe unless that was closed."""
    channel.close()
    process.close()


def _clock_start(surroundings: Surroundings, model: str) -> float:
    """Return when the bench's clock started; ValueError if the bench is virtual."""
    if surroundings.world is None and isinstance(surroundings.clock, RealClock):
        return surroundings.clock.start
    raise ValueError(
        f"{model} can't live in a process of its own: the bench's virtual world and its time "
        "are in this one. Open it in this process, or have only real devices on the bench"
    )
