# SPDX-License-Identifier: MIT
"""Scene files: a machine, its bodies and their design in TOML, without a program.

:mod:`.kinds` lists the classes of the public API that a table can describe. Its keys are their
arguments: :mod:`.reading` makes calls of tables, by the type hints of arguments and a table of
units, :mod:`.scene` puts them together, and :mod:`.commands` runs them.
"""

from __future__ import annotations

from .calls import SceneError as SceneError
from .commands import INTERRUPTED as INTERRUPTED
from .commands import check as check
from .commands import design as design
from .commands import new as new
from .scene import Scene as Scene
from .scene import read_scene as read_scene
