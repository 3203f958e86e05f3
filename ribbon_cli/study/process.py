"""What holds for a whole process that solves: one thread of BLAS, and signals as an exception.

The exception releases locks on its way out, and keeps what is committed.
"""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import NoReturn

ONE_THREAD = dict.fromkeys(
    (
        "OPENBLAS_NUM_THREADS",
        "OMP_NUM_THREADS",
        "MKL_NUM_THREADS",
        "BLIS_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMEXPR_NUM_THREADS",
    ),
    "1",
)
"""Environment for BLAS, which reads it when it is loaded: the number of threads decides the order of
summation, hence the bytes of the results."""
_MOMENT = 0.01
"""Seconds, enough to be out of a callback."""


class Stopped(BaseException):
    """SIGINT or SIGTERM arrived; not an Exception, so that nothing on the way takes it for a failure."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def heed(*numbers: int) -> None:
    """Raise `Stopped` in the main thread when one of these signals arrives.

    Where a caller ignores a signal (nohup, a background job), it stays ignored.
    """
    for number in numbers:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, stop)
    sys.unraisablehook = unraised


def stop(number: int, frame: FrameType | None) -> NoReturn:
    """End what is under way by an exception, so that locks are released and the terminal is put in order."""
    raise Stopped(number)


def unraised(info: sys.UnraisableHookArgs) -> None:
    """Where a signal arrives in a callback that cannot raise, as h5py has them, stop a moment later."""
    stopped = info.exc_value
    if not isinstance(stopped, Stopped):
        sys.__unraisablehook__(info)
        return
    signal.signal(signal.SIGALRM, lambda number, frame: stop(stopped.number, frame))
    signal.setitimer(signal.ITIMER_REAL, _MOMENT)
