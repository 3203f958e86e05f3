"""The bytes of states, made in a second process while this one solves for the next.

A run is written to by one process, in order. What takes time before that, spectra and the encoding of a file,
needs a state's record alone. A thread hands each record to the second process, waits for the bytes, and
commits them: it waits nearly always, so that the main thread goes on. The second process has no file of the
run, not even its lock. It ends with its parent, also with one that is killed. Where it ends before, the
thread makes the bytes itself.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import queue
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import BinaryIO, NoReturn, cast

from ribbon_cli.store.summaries import Summary

MOST_WAITING = 3
"""States that may wait for their commit: what a kill can cost beside the stage under way."""
_PR_SET_PDEATHSIG = 1
"""prctl(2): the signal that a process gets when its parent ends."""
_STOPS = {signal.SIGINT, signal.SIGTERM}

Made = tuple[bytes, Summary]
"""A state file's bytes, and what the log says of it."""
Make = Callable[[], Made]
"""Makes them; it is pickled, and gives the same wherever it is called."""


def possible() -> bool:
    """Whether a second process is of use, and safe: there is a core for it, and this one has a single thread,
    so that the copy of it has no lock that another thread was holding."""
    if sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2:
        return False
    return len(os.listdir("/proc/self/task")) == 1


class Beside:
    """Commits states in the order put; `publish` writes one, in a thread and never two at once."""

    def __init__(self, publish: Callable[[int, bytes, Summary], object]) -> None:
        self._publish = publish
        self._process = _Process()
        self._jobs: queue.SimpleQueue[tuple[int, Make] | None] = queue.SimpleQueue()
        self._changed = threading.Condition()
        self._waiting = 0
        self._error: BaseException | None = None
        self._dropped = False
        self._thread = threading.Thread(target=self._work, name="commits", daemon=True)
        self._thread.start()

    def put(self, label: int, make: Make) -> None:
        """Commit a state as soon as those before it are; wait where there are many.

        Raises what went wrong with an earlier one.
        """
        with self._changed:
            self._changed.wait_for(lambda: not self.behind or self._error is not None)
            if self._error is not None:  # told when those behind it are dropped: none may be committed
                self._changed.wait_for(lambda: self._waiting == 0)
            self._raise()
            self._waiting += 1
        self._jobs.put((label, make))

    @property
    def behind(self) -> bool:
        """Whether as many states wait as may."""
        return self._waiting >= MOST_WAITING

    def settle(self) -> None:
        """Wait until all is committed. Raises what went wrong, and then drops the states that followed."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting == 0)
            self._raise()

    def _raise(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error

    def end(self) -> None:
        """End process and thread; what is not committed is dropped, but for a commit under way."""
        # A second signal must not come between: nothing is written once the run's lock is let go of.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _STOPS)
        try:
            self._dropped = True
            self._process.kill()
            self._jobs.put(None)
            self._thread.join()
            self._process.close()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _work(self) -> None:
        """The thread: jobs one after the other, none behind one that failed."""
        while (job := self._jobs.get()) is not None:
            failed: BaseException | None = None
            if self._error is None and not self._dropped:
                label, make = job
                try:
                    made = self._made(make)
                    if made is not None:
                        self._publish(label, *made)
                except BaseException as error:  # noqa: BLE001  (raised again where it is waited for)
                    failed = error
            with self._changed:
                self._error = self._error or failed
                self._waiting -= 1
                self._changed.notify_all()

    def _made(self, make: Make) -> Made | None:
        """What the process makes; what this one does where that fails, and None where all is dropped."""
        with suppress(OSError, EOFError):
            made: Made | None = self._process.ask(make)
            if made is not None:
                return made
        return None if self._dropped else make()


class _Process:
    """A copy of this process that makes what it is asked for; its answer is None where that fails."""

    def __init__(self) -> None:
        questions, self._questions = _pipe()
        self._answers, answers = _pipe()
        # A signal in between would be raised in the copy, which must not do what this process does then.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _STOPS)
        try:
            parent = os.getpid()
            self._pid = os.fork()
            if self._pid == 0:
                _serve(questions, answers, parent)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        questions.close()
        answers.close()

    def ask(self, make: Make) -> Made | None:
        """What a callable makes there. Raises OSError or EOFError where the process has ended."""
        _send(self._questions, make)
        return cast("Made | None", _receive(self._answers))

    def kill(self) -> None:
        """End the process, whatever it does."""
        os.kill(self._pid, signal.SIGKILL)  # not waited for yet, so that its number is nobody else's

    def close(self) -> None:
        """Wait for its end."""
        os.waitpid(self._pid, 0)
        for pipe in (self._questions, self._answers):
            with suppress(OSError):  # what could not be sent
                pipe.close()


def _pipe() -> tuple[BinaryIO, BinaryIO]:
    reading, writing = os.pipe()
    return os.fdopen(reading, "rb"), os.fdopen(writing, "wb")


def _send(pipe: BinaryIO, what: object) -> None:
    data = pickle.dumps(what, protocol=5)
    pipe.write(len(data).to_bytes(8, "big") + data)
    pipe.flush()


def _receive(pipe: BinaryIO) -> object:
    """What was sent. Raises EOFError where nobody sends any more."""
    head = pipe.read(8)
    data = pipe.read(int.from_bytes(head, "big"))
    if len(head) < 8 or len(data) < int.from_bytes(head, "big"):
        raise EOFError
    return pickle.loads(data)


def _serve(questions: BinaryIO, answers: BinaryIO, parent: int) -> NoReturn:
    """The second process: answers questions until there are none."""
    try:
        for number in _STOPS:  # the terminal sends them to both; the first process decides
            signal.signal(number, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOPS)
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        _let_go({questions.fileno(), answers.fileno()})
        while os.getppid() == parent:
            _answer(questions, answers)
    finally:
        os._exit(0)


def _answer(questions: BinaryIO, answers: BinaryIO) -> None:
    make = _receive(questions)
    try:
        made = make() if callable(make) else None
    except Exception:  # noqa: BLE001  (the first process meets it as well, and raises it)
        made = None
    _send(answers, made)


def _let_go(keep: set[int]) -> None:
    """Close all files but those, and put none in the place of the standard streams."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    for name in os.listdir("/proc/self/fd"):
        if int(name) > 2 and int(name) not in keep:
            with suppress(OSError):
                os.close(int(name))
