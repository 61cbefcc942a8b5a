# SPDX-License-Identifier: MIT
"""The static limit in pyMOTO: compliance of a plate and its gradient.

pyMOTO (A. Delissen, https://github.com/aatmdelissen/pyMOTO, on PyPI as ``pymoto``) is topology
optimisation by modules: each has a response and a sensitivity. The plate consists of bilinear
quadrilaterals in plane stress. Its left edge is clamped, its right edge can only slide upwards or
downwards, as a rigid piece, under a force F:

    c(x) = F u = F^2 / k(x),     k = u^T K(x) u  at a unit displacement of the right edge.
"""

import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
from jobs import Array, beyond
from peer_packages import use_peers

#: Stiffness of void relative to the solid, and exponent of SIMP.
FLOOR, EXPONENT = 1e-6, 3
#: Factorisations: SciPy's, which pyMOTO takes without being told, and CVXOPT's.
SOLVERS = ("SuperLU", "CHOLMOD")


@dataclass(frozen=True)
class Plate:
    """What is loaded; one metre high."""

    elements: tuple[int, int]  #: Squares along and across
    young: float = 210e9  #: [Pa]
    poisson: float = 0.3  #: [-]
    thickness: float = 0.01  #: [m]
    force: float = 1e4  #: At the right edge [N]

    @property
    def element(self) -> float:
        """Length of an element's side [m]."""
        return 1.0 / self.elements[1]


def random_density(elements: tuple[int, int]) -> Array:
    """A density of its own for each element, row after row, shape (elements,)."""
    return 0.3 + 0.7 * np.random.default_rng(0).random(elements[0] * elements[1])


class PymotoPlate:
    """Compliance and gradient by pyMOTO with one of the `SOLVERS`."""

    def __init__(self, plate: Plate, solver: str) -> None:
        use_peers()
        import pymoto as pym

        nx, ny = plate.elements
        size = plate.element
        domain = pym.VoxelDomain(nx, ny, unitx=size, unity=size, unitz=plate.thickness)
        rows = np.arange(ny + 1)
        left, right = domain.get_nodenumber(0, rows), domain.get_nodenumber(nx, rows)
        held = np.concatenate([2 * left, 2 * left + 1, 2 * right, 2 * right + 1])
        free = np.setdiff1d(np.arange(2 * domain.nnodes), held)
        unit = np.zeros(len(held))
        unit[-len(rows) :] = 1.0
        self.variables = pym.Signal("x", state=np.ones(domain.nel))
        solvers = {
            "SuperLU": pym.solvers.SolverSparseLU,
            "CHOLMOD": pym.solvers.SolverSparseCholeskyCVXOPT,
        }
        kwargs: dict[str, Any] = {"hermitian": True, "solver": solvers[solver]()}
        with pym.Network() as self.network:
            simp = f"{FLOOR} + {1.0 - FLOOR}*inp0^{EXPONENT}"
            stiffness = pym.MathExpression(simp)(self.variables)
            matrix = pym.AssembleStiffness(
                domain, e_modulus=plate.young, poisson_ratio=plate.poisson, plane="stress",
                matrix_type=scipy.sparse.csc_matrix,
            )(stiffness)  # fmt: skip
            displacement, load = pym.SystemOfEquations(free=free, prescribed=held, **kwargs)(
                matrix, pym.Signal("load", np.zeros(len(free))), pym.Signal("held", unit)
            )
            energy = pym.EinSum("i,i->")(displacement, load)
            self.compliance = pym.MathExpression(f"{plate.force**2}/inp0")(energy)

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Compliance and gradient at the density of each element, row after row, (elements,)."""
        with warnings.catch_warnings():  # CVXOPT's solver gets its matrices in another format
            warnings.simplefilter("ignore")
            self.network.reset()
            self.variables.state = np.array(x)
            self.network.response()
            self.compliance.sensitivity = 1.0
            self.network.sensitivity()
        return float(self.compliance.state), np.array(self.variables.sensitivity)


def memory_of_pymoto(
    comm: Any, progress: Callable[[float], None], *, elements: list[int], solver: str
) -> dict[str, float]:
    """Measure the peak of memory of one value and gradient, in a process without DOLFINx."""
    if "dolfinx" in sys.modules:
        raise RuntimeError("the process has loaded DOLFINx")

    def run(nx: int, ny: int) -> None:
        PymotoPlate(Plate((nx, ny)), solver).gradient(random_density((nx, ny)))

    return beyond(lambda: run(6, 2), lambda: run(*elements))
