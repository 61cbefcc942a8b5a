# SPDX-License-Identifier: MIT
"""What several tests use: bodies, meshes, scenes."""

from __future__ import annotations

from pathlib import Path

#: The source tree.
TOP = Path(__file__).resolve().parents[2]
