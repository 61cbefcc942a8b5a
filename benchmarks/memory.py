# SPDX-License-Identifier: MIT
"""Peak of the resident memory of this process."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

__all__ = ["peak_memory", "reset_peak_memory"]


def reset_peak_memory() -> float:
    """Begin a new record of the peak memory of this process, and return it [MB]."""
    with contextlib.suppress(OSError):  # then the record goes on, and small meshes show nothing
        Path("/proc/self/clear_refs").write_text("5")
    return peak_memory()


def peak_memory() -> float:
    """The peak of the resident memory of this process [MB].

    The record of `resource.getrusage` would include that of the process that started this one.
    """
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    return float(found[1]) * 1024e-6 if found else float("nan")
