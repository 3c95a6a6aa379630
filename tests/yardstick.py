"""Time as a ratio to a yardstick that is measured on the same machine in the same moment.

A limit in seconds says as much of the machine, and of who else is on it, as of what is measured.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable


def processor_seconds(call: Callable[[], object]) -> float:
    """Processor time of a call [s], of all threads of this process."""
    begin = time.process_time()
    call()
    return time.process_time() - begin


def ratio(call: Callable[[], object], yardstick: Callable[[], object], times: int = 3) -> float:
    """Processor time of a call over that of a yardstick: the least of several, taken in turns."""
    return ratio_of(
        lambda: processor_seconds(call), lambda: processor_seconds(yardstick), times=times
    )


def ratio_of(one: Callable[[], float], other: Callable[[], float], times: int = 3) -> float:
    """The least of one measurement over the least of another, taken in turns."""
    pairs = [(one(), other()) for _ in range(times)]
    found = min(first for first, _ in pairs) / min(second for _, second in pairs)
    print(f"{found:.2f} times the yardstick")
    return found


def started(code: str, **environment: str) -> subprocess.Popen[str]:
    """A fresh Python that runs some code, with compiled kernels."""
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", code], text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "NUMBA_DISABLE_JIT": "0", **environment},
    )  # fmt: skip


def processor_seconds_of(code: str) -> float:
    """Processor time of a fresh Python that runs some code [s], its start included."""
    process = started(code)
    process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = status
    assert status == 0, process.stderr.read()
    process.stdout.close()
    process.stderr.close()
    return usage.ru_utime + usage.ru_stime
