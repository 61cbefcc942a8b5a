# SPDX-License-Identifier: MIT
"""A folder for compiled code of a user whose own cache directory cannot be written."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path


def spare_directory() -> Path | None:
    """A directory of this user alone among the temporary files, None if there can be none."""
    path = Path(tempfile.gettempdir()) / f"dolfinx_ffr-{os.getuid()}"
    try:
        path.mkdir(mode=0o700, exist_ok=True)
        status = path.lstat()
    except OSError:
        return None
    ours = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    others = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return path if ours and not others and os.access(path, os.W_OK | os.X_OK) else None
