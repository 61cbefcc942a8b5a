# SPDX-License-Identifier: MIT
"""Scene files: a machine, its bodies and their design in TOML, without a program.

Keys are those of the classes of the public API, read from their signatures, type hints and
documentation: :mod:`.reading` makes calls of tables, :mod:`.scene` puts them together, and
:mod:`.commands` runs them.
"""

from __future__ import annotations

from .calls import SceneError as SceneError
from .commands import INTERRUPTED as INTERRUPTED
from .commands import check as check
from .commands import design as design
from .commands import new as new
from .scene import Scene as Scene
from .scene import read_scene as read_scene
