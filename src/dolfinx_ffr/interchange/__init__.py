# SPDX-License-Identifier: MIT
"""Files of bodies for other multibody programs, and from finite-element programs.

A body is here what its file holds, arrays by key in SI units (`numpy_file` lists them). A new kind
of file is one class with a name, endings, what it can hold, `write` and `read` (`Format`), in one
module, and a line in `FORMATS`. Matrices of a finite-element program become a body by
`reduction.reduce_matrices`.
"""

from __future__ import annotations

from .abaqus import read_abaqus as read_abaqus
from .abaqus import read_calculix as read_calculix
from .assembled import AssembledMatrices as AssembledMatrices
from .files import FORMATS as FORMATS
from .files import read_body as read_body
from .files import write_body as write_body
from .format import Arrays as Arrays
from .format import Format as Format
from .format import InterchangeWarning as InterchangeWarning
from .nastran import read_nastran as read_nastran
from .numpy_file import MARKERS, STIFFENING, write_all
from .sid import read_terms as read_terms
from .sid import sid_terms as sid_terms
