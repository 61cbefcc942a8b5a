# SPDX-License-Identifier: MIT
"""The .mat file with the arguments of Simscape's block Reduced Order Flexible Solid.

``origins`` (n, 3) are those of the interface frames, whose axes are those of the body, ``K`` and
``M`` the matrices of the degrees of freedom Tx, Ty, Tz, Rx, Ry, Rz of each, then of the modes;
``names`` are the names of the interfaces, and ``C`` is damping, if the body has any.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import scipy.io

from ..files import replace_file
from .format import Arrays
from .superelement import superelement


class Simscape:
    """Files .mat."""

    name = "simscape"
    endings: tuple[str, ...] = (".mat",)
    holds: tuple[str, ...] = ("rotations of markers",)

    def write(self, path: Path, arrays: Arrays) -> None:
        body, content = superelement(arrays), io.BytesIO()
        variables = {
            "origins": body.positions,
            "K": body.stiffness,
            "M": body.mass,
            "names": np.array(body.names, dtype=object),
        }
        scipy.io.savemat(content, variables, do_compression=True)
        replace_file(path, content.getvalue())
