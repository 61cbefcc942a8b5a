# SPDX-License-Identifier: MIT
"""Volume integrals of a body in the floating frame of reference.

A material point of a body is at

    r = R + A w,      w(X, q) = w_0 + sum_j q_j w_j,

with w_0 = X the reference position in the body's frame and w_j the shape functions of the elastic
displacement. The equations of motion need no more of the body than the arrays of
:class:`VolumeIntegrals`; the mechanism never sees a mesh. A rigid body has no shape functions, and
arrays may come from another code.

Of the second moments P_ab = int rho w_a w_b^T the plane needs the two views G and N, and space all,
the Gram matrix of the 3 (modes + 1) components of the fields.

References:
    A. A. Shabana, Dynamics of Multibody Systems, Cambridge University Press, chapter 5,
    doi:10.1017/9781107337213.
    J. Wallrapp, Standardization of flexible body modeling in multibody system codes, Part I:
    definition of standard input data, Mechanics of Structures and Machines 22 (1994),
    doi:10.1080/08905459408905214.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array, summed
from ..documentation import Shown
from ..interchange import (
    MARKERS,
    STIFFENING,
    read_body,
    write_body,
)
from ..mechanism import RayleighDamping
from ..tensors import axial, cross_matrix, theta
from .marker import (
    ASYMMETRY,
    LOADS,
    QUARTER_TURN,
    BodyMarker,
    as_array,
    check_body_marker,
    check_loads,
    inertia_of_point,
    largest_share,
)
from .moments import (
    check_flat_gram_matrix,
    check_gram_matrix,
    check_moments,
    dimension_of_inertia,
    moments_of_rigid_body,
    smallest_scaled_eigenvalue,
    views_of_moments,
)


@dataclass(frozen=True, eq=False, repr=False)
class VolumeIntegrals(Shown):
    """Volume integrals of one body, all that the equations of motion know about it.

    Index a = 0 belongs to the reference position w_0, a = 1..modes to the shape functions w_a;
    J is the rotation by a quarter turn. Shape functions are displacements per unit of their
    elastic coordinate: where they are dimensionless, elastic coordinates are in metres, and the
    units are those given below.

    The same class holds derivatives of a number psi with respect to each entry. Then G and K are
    symmetric and N is antisymmetric too, so that for a perturbation d with that structure
    psi(p + eps d) - psi(p) = eps * bar.dot(d) to first order.

    In space S has three columns, and P with P_ab = P_ba^T is given; G and N follow from it, and
    derivatives are those by P. From another finite-element code with the mass matrix m of one
    component, the nodes W_0 = X and column j of a basis there W_j: mass = 1^T m 1,
    S_a = W_a^T m 1, P_ab = W_a^T m W_b; docs/how_to/arrays.md has a program.

    Attributes:
        mass: Mass [kg].
        S: Int rho w_a, shape (modes + 1, 2), in space (modes + 1, 3) [kg m].
        G: Int rho w_a . w_b, symmetric, shape (modes + 1, modes + 1) [kg m^2].
        N: Int rho (J w_a) . w_b, antisymmetric, shape (modes + 1, modes + 1) [kg m^2]; in space int
            rho w_a x w_b, shape (modes + 1, modes + 1, 3).
        K: Reduced stiffness int sigma(w_i) : eps(w_j), symmetric, shape (modes, modes) [N/m].
        markers: Named points of the body.
        stiffening: Geometric stiffness by unit loads of the body's own inertia, each symmetric;
            none by default. "omega2" by the centrifugal load of the angular velocity about the
            origin of the frame, shape (modes, modes) [kg]; "alpha" by the load of the angular
            acceleration, likewise [kg]; "acceleration" by the load of the frame's acceleration less
            gravity along the body's axes x and y, shape (2, modes, modes) [kg/m]. The elastic
            forces gain omega^2 K_w q + alpha K_al q + a_x K_x q + a_y K_y q. In space "rotation" by
            the loads -rho w_0^l e_k, shape (3, 3, modes, modes), whose factors are those of [alpha]
            + [omega]^2, and "acceleration", shape (3, modes, modes). Forces and point masses at
            markers with geometric stiffness add to them. Inertia, energy and momentum count them
            likewise, see dynamics/kinematics/carried.py.
        P: In space int rho w_a w_b^T, shape (modes + 1, modes + 1, 3, 3) [kg m^2]; None in the
            plane.
    """

    mass: float
    S: Array
    G: Array
    N: Array
    K: Array
    markers: dict[str, BodyMarker] = field(default_factory=dict)
    stiffening: dict[str, Array] = field(default_factory=dict)
    P: Array | None = None

    def __post_init__(self) -> None:
        arrays: dict[str, Any] = {"mass": float(self.mass), "markers": dict(self.markers)}
        arrays["stiffening"] = {load: as_array(array) for load, array in self.stiffening.items()}
        arrays |= {name: as_array(getattr(self, name)) for name in "SGNK"}
        if self.P is not None:
            arrays["P"] = as_array(self.P)
            arrays["G"], arrays["N"] = views_of_moments(arrays["P"])
        for name, value in arrays.items():
            object.__setattr__(self, name, value)

    def _shown(self) -> list[tuple[str, str, str]]:
        modes = f"{self.modes} elastic coordinates" if self.modes else "rigid"
        return [
            ("mass", f"{self.mass:.6g} kg", ""),
            ("kind", f"{modes}, {'in space' if self.dimension == 3 else 'in the plane'}", ""),
            ("markers", ", ".join(self.markers) or "none", ""),
            ("geometric stiffness", ", ".join(self.stiffening) or "none", ""),
        ]

    @property
    def modes(self) -> int:
        """Number of elastic coordinates."""
        return int(self.K.shape[0])

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return 2 if self.P is None else 3

    @staticmethod
    def in_space(
        mass: float,
        S: Array,
        P: Array,
        K: Array,
        markers: Mapping[str, BodyMarker] | None = None,
        stiffening: Mapping[str, Array] | None = None,
    ) -> VolumeIntegrals:
        """Integrals of a body in space, or derivatives with respect to them, unchecked.

        The arguments ``mass``, ``S``, ``P``, ``K``, ``markers`` and ``stiffening`` are the fields.
        """
        none = np.zeros((0, 0))
        return VolumeIntegrals(
            mass, S, none, none, K, dict(markers or {}), dict(stiffening or {}), P
        )

    @property
    def _arrays(self) -> tuple[str, ...]:
        """Names of the arrays from which G and N follow in space."""
        return ("S", "G", "N", "K") if self.P is None else ("S", "P", "K")

    @property
    def stacked_stiffening(self) -> Array:
        """Geometric stiffness by all loads, shape (4, modes, modes); in space (12, ...)."""
        r, stacked = self.modes, []
        for load, shape in LOADS[self.dimension].items():
            by_load = self.stiffening.get(load, np.zeros((*shape, r, r)))
            stacked.append(by_load.reshape(math.prod(shape), r, r))
        return np.concatenate(stacked)

    @staticmethod
    def rigid(
        mass: float,
        center: ArrayLike | None = None,
        inertia: ArrayLike | None = None,
        markers: Mapping[str, ArrayLike | BodyMarker] | None = None,
    ) -> VolumeIntegrals:
        """Integrals of a rigid body; one in space where the inertia is a tensor or three moments.

        Args:
            mass: Mass [kg].
            center: Centre of mass in the body's frame, shape (2,) or (3,) [m]; None is the origin.
            inertia: Moment of inertia about the centre of mass [kg m^2]; in space the tensor, shape
                (3, 3), or its diagonal, shape (3,), in the body's axes. It must be given: without
                it the body has no equation for its angle.
            markers: Position in the body's frame, shape (2,) or (3,) [m], or marker, by name.

        Raises:
            ValueError: If mass or inertia is missing or not positive, if a position is not finite,
                or if a principal moment of inertia exceeds the sum of the two others.
        """
        if inertia is None:
            raise ValueError(
                "rigid body: give its moment of inertia about the centre of mass (a disc has "
                "m r^2 / 2, a slender rod m l^2 / 12; in space the tensor or three moments); a "
                "mass without extent is a PointMass at a marker of another body"
            )
        mass = validation.number("rigid body: mass", mass, above=0.0, unit="kg")
        points = validation.by_name("rigid body: markers", markers or {}, "positions")
        d = dimension_of_inertia(inertia, [center, *points.values()])
        origin = np.zeros(d) if center is None else center
        c = validation.real_array("rigid body: center", origin, (d,), expected=f"{d} components")
        body_markers = {}
        for name, point in points.items():
            if not isinstance(point, BodyMarker):
                position = validation.real_array(f"rigid body: marker {name!r}", point, (d,))
                point = BodyMarker.of_rigid_body(position)
            body_markers[name] = point
        S, K = mass * c[None, :], np.zeros((0, 0))
        if d == 3:
            P = moments_of_rigid_body(mass, c, inertia)
            return VolumeIntegrals.in_space(mass, S, P, K, body_markers)
        moment = validation.number("rigid body: inertia", inertia, above=0.0, unit="kg m^2")
        G = np.array([[moment + mass * c @ c]])
        return VolumeIntegrals(mass, S, G, np.zeros((1, 1)), K, body_markers)

    @staticmethod
    def from_arrays(
        mass: float,
        S: ArrayLike,
        *,
        P: ArrayLike | None = None,
        G: ArrayLike | None = None,
        N: ArrayLike | None = None,
        K: ArrayLike | None = None,
        markers: Mapping[str, BodyMarker | ArrayLike] | None = None,
        stiffening: Mapping[str, ArrayLike] | None = None,
        name: str = "given body",
    ) -> VolumeIntegrals:
        """Integrals of a body given by arrays, checked.

        The second moments come as P, or in the plane as the two views of it that matter there,
        G_ab = tr P_ab and N_ab = (P_ab)_xy - (P_ab)_yx. Derivatives go back the same way:
        the derivative with respect to P_ab is G_bar_ab I + N_bar_ab (e_x e_y^T - e_y e_x^T).

        Args:
            mass: Mass [kg].
            S: Int rho w_a, shape (modes + 1, 2), in space (modes + 1, 3) [kg m].
            P: Int rho w_a w_b^T, shape (modes + 1, modes + 1, 2, 2), in space (..., 3, 3) [kg m^2].
            G: Int rho w_a . w_b, shape (modes + 1, modes + 1) [kg m^2], without P.
            N: Int rho (J w_a) . w_b, shape (modes + 1, modes + 1) [kg m^2], without P.
            K: Reduced stiffness, shape (modes, modes) [N/m]; None for a rigid body.
            markers: Markers by name; for a rigid body the position (2,) or (3,) is enough [m].
            stiffening: Geometric stiffness by load, see the field.
            name: Name of the body for messages.

        Raises:
            ValueError: If neither P nor G and N are given, or both; if an array has the wrong
                shape, holds NaN, or suits no body (see :meth:`validate`).
        """
        moments = {"P": P, "G": G, "N": N}
        moments_given = [key for key, array in moments.items() if array is not None]
        if moments_given not in (["P"], ["G", "N"]):
            raise ValueError(f"body {name!r}: give either P or both G and N, not {moments_given}")
        in_space, second = np.shape(S)[1:] == (3,), None
        if in_space and P is None:
            raise ValueError(f"body {name!r}: S has three columns; in space give P, not G and N")
        if P is not None:
            fields, d, second = np.shape(S)[:1] or (0,), 3 if in_space else 2, as_array(P)
            check_moments(name, second, (*fields, *fields, d, d))
            if not in_space:
                G, N = second[..., 0, 0] + second[..., 1, 1], second[..., 0, 1] - second[..., 1, 0]
                second = None
        stiffness = np.zeros((0, 0)) if K is None else as_array(K)
        if stiffness.ndim != 2:
            raise ValueError(f"body {name!r}: K must be a matrix, not of shape {stiffness.shape}")
        r = stiffness.shape[0]
        if K is None and np.shape(S)[:1] != (1,):
            raise ValueError(
                f"body {name!r}: S has shape {np.shape(S)} of an elastic body, but its stiffness "
                "is missing; give K"
            )
        points = {}
        for key, marker in (markers or {}).items():
            if not isinstance(marker, BodyMarker):
                if r:
                    raise ValueError(
                        f"body {name!r}, marker {key!r}: give a BodyMarker with its shape functions"
                    )
                marker = BodyMarker.of_rigid_body(marker)
            points[key] = marker
        mass = validation.number(f"body {name!r}: the mass", mass, above=0.0, unit="kg")
        loads = {load: as_array(array) for load, array in (stiffening or {}).items()}
        g, n = (np.zeros((0, 0)) if view is None else as_array(view) for view in (G, N))
        body = VolumeIntegrals(mass, as_array(S), g, n, stiffness, points, loads, second)
        body.validate(name)
        if body.P is None:
            check_flat_gram_matrix(name, body.mass, body.S, body.G, body.N)
        return body

    def save(
        self, path: str | Path, *, format: str | None = None, damping: RayleighDamping | None = None
    ) -> None:
        """Write to a file of this package or for another program; docs/interchange.md has a table.

        Args:
            path: Where it goes; an older file is replaced when all is written. Under MPI call it on
                one rank.
            format: A name of the table; by default it follows from the ending of the path, ``.npz``
                for this package's own files, whose keys :mod:`dolfinx_ffr.interchange.numpy_file`
                lists.
            damping: Damping of the elastic coordinates, for formats that hold it.

        Raises:
            ValueError: If the integrals are not valid, the ending is unknown, or the format cannot
                hold the body.
            OSError: If the file cannot be written.

        Warns:
            InterchangeWarning: If the format cannot hold something that the body has.
        """
        path = validation.path("body file", path)
        self.validate(path.stem)
        arrays = self.by_key
        if damping is not None:
            needed = "a RayleighDamping"
            damping = validation.instance("body file: damping", damping, RayleighDamping, needed)
            if not self.modes:
                raise ValueError(
                    "body file: a rigid body has no elastic coordinates to damp; leave the "
                    "damping out"
                )
            arrays["damping"] = damping.alpha * self.G[1:, 1:] + damping.beta * self.K
        write_body(path, arrays, format)

    @property
    def by_key(self) -> dict[str, Any]:
        """The arrays of the file by key."""
        n, r, d = len(self.markers), self.modes, self.dimension
        markers = self.markers.values()
        positions = np.array([marker.position for marker in markers])
        displacements = np.array([marker.displacement for marker in markers])
        rotations = np.array([marker.rotation for marker in markers])
        arrays: dict[str, Any] = {
            "mass": np.float64(self.mass),
            **{key: getattr(self, key) for key in self._arrays},
            **{f"stiffening_{load}": array for load, array in self.stiffening.items()},
            "markers": np.array(list(self.markers), dtype=np.str_),
            "marker_positions": positions.reshape(n, d),
            "marker_displacements": displacements.reshape(n, d, r),
            "marker_rotations": rotations.reshape((n, r) if d == 2 else (n, d, r)),
        }

        # what no marker has is left out; where only some have it, the others get the default
        for key, default in (("stiffening", np.zeros((d, r, r))), ("axes", np.eye(3))):
            values = [getattr(marker, key) for marker in markers]
            if any(value is not None for value in values):
                filled = [default if value is None else value for value in values]
                arrays[f"marker_{key}"] = np.array(filled)
        return arrays

    @staticmethod
    def load(path: str | Path, *, format: str | None = None) -> VolumeIntegrals:
        """Read from a file at a ``path``, of `save` or another code, in a ``format`` as there.

        Numbers are taken from the file exactly.

        Raises:
            ValueError: If the file is damaged, a key is missing or unknown, an array has the wrong
                shape or holds NaN, or the integrals suit no body.
            OSError: If the file cannot be read.
        """
        arrays = read_body(path, format)
        path = Path(path)
        try:
            markers = {}
            for n, name in enumerate(arrays.get("markers", np.zeros(0, dtype=np.str_)).ravel()):
                marker_arrays: list[Any] = [
                    arrays[key][n] if key in arrays else None for key in MARKERS
                ]
                marker = BodyMarker(*marker_arrays)
                if marker.stiffening is not None and not np.any(marker.stiffening):
                    marker = replace(marker, stiffening=None)
                markers[str(name)] = marker
            return VolumeIntegrals.from_arrays(
                float(arrays["mass"]),
                arrays["S"],
                **{key: arrays.get(key) for key in "PGNK"},
                markers=markers,
                stiffening={load: arrays[key] for key, load in STIFFENING.items() if key in arrays},
                name=path.stem,
            )
        except ValueError as error:
            raise ValueError(f"body file {path}: {error}") from error

    def mass_matrix(self) -> Array:
        """Mass matrix of the undeformed body at zero angle, shape (3 + modes, 3 + modes).

        Rows are position [kg], angle [kg m^2] and the elastic coordinates; in space, where the
        shape is (6 + modes, 6 + modes), three each of position and angular velocity.
        """
        S = self.S
        if self.P is None:
            lever = (QUARTER_TURN @ S[0])[:, None]
            inertia = self.G[:1, :1]
            rotation_by_modes = self.N[:1, 1:]
        else:
            lever = -cross_matrix(S[0])
            inertia = theta(self.P[0, 0])
            rotation_by_modes = axial(self.P[1:, 0]).T

        position = [self.mass * np.eye(self.dimension), lever, S[1:].T]
        rotation = [lever.T, inertia, rotation_by_modes]
        elastic = [S[1:], rotation_by_modes.T, self.G[1:, 1:]]
        return np.block([position, rotation, elastic])

    def validate(self, name: str) -> None:
        """Check shapes, symmetry and definiteness; messages call the body by ``name``.

        Raises:
            ValueError: If an array has the wrong shape, holds NaN or infinity, lacks its symmetry,
                if the mass is not positive, or if the mass or stiffness matrix is indefinite.
        """
        r, d = self.modes, self.dimension
        shapes = {"S": (r + 1, d), "K": (r, r)}
        if self.P is None:
            shapes |= {"G": (r + 1, r + 1), "N": (r + 1, r + 1)}
        else:
            check_moments(name, self.P, (r + 1, r + 1, d, d))
        for key, shape in shapes.items():
            validation.real_array(f"body {name!r}: integral {key}", getattr(self, key), shape)
        if not (np.isfinite(self.mass) and self.mass > 0.0):
            raise ValueError(
                f"body {name!r}: the mass must be positive, but it is {self.mass:g} kg"
            )
        diagonal, inertia = np.diag(self.G), np.diag(self.G)[1:]
        # where a shape function has next to no stiffness, a share of the stiffest one's counts
        squares = np.divide(np.diag(self.K), inertia, out=np.zeros(r), where=inertia > 0.0)
        stiffness = np.maximum(np.diag(self.K), 1e-12 * np.max(squares, initial=0) * inertia)
        sizes = {"G": ("", 1.0, diagonal), "N": ("anti", -1.0, diagonal), "K": ("", 1.0, stiffness)}
        for key, (kind, sign, size) in sizes.items():
            array = getattr(self, key)
            defect = largest_share(array - sign * array.T, size) if key in shapes else 0.0
            if defect > ASYMMETRY:
                raise ValueError(
                    f"body {name!r}: integral {key} must be {kind}symmetric, but entries differ by "
                    f"{defect:.1e} relative to the diagonal"
                )
        check_loads(name, self.stiffening, d, r, self.G)
        for marker, point in self.markers.items():
            check_body_marker(f"body {name!r}, marker {marker!r}", point, d, r, self.G)
        smallest = smallest_scaled_eigenvalue(self.mass_matrix())
        if smallest < 1e-14:
            raise ValueError(
                f"body {name!r}: the mass matrix is not positive definite (smallest eigenvalue "
                f"{smallest:.1e} after scaling to unit diagonal); check the inertia, and that no "
                "shape function is a rigid-body motion or a combination of others"
            )
        if self.P is not None:
            check_gram_matrix(name, self.mass, self.S, self.P)
        smallest = smallest_scaled_eigenvalue(self.K)
        if smallest < -1e-9:
            raise ValueError(
                f"body {name!r}: the stiffness K has a negative eigenvalue "
                f"({smallest:.1e} after scaling to unit diagonal)"
            )

    def leading(self, modes: int) -> VolumeIntegrals:
        """Integrals of the same body with its first ``modes`` shape functions alone."""
        if not 0 <= modes <= self.modes:
            raise ValueError(f"the body has {self.modes} shape functions, and not {modes}")
        n = modes + 1
        cuts = {"S": np.s_[:n], "K": np.s_[:modes, :modes]}
        arrays = {key: getattr(self, key)[cuts.get(key, np.s_[:n, :n])] for key in self._arrays}
        return replace(
            self,
            **arrays,
            markers={name: marker.leading(modes) for name, marker in self.markers.items()},
            stiffening={load: a[..., :modes, :modes] for load, a in self.stiffening.items()},
        )

    def extruded(self, thickness: float, moments: ArrayLike) -> VolumeIntegrals:
        """The body in the plane as one in space, that lies in z = 0 and does not bend out of it.

        In its plane it moves as before. If it turns about other axes, its inertia is right, and
        geometric stiffness by omega^2 is shared evenly by the axes in the plane.

        Args:
            thickness: Thickness of the body, half on each side of the plane [m].
            moments: Int rho w_a w_b^T, shape (modes + 1, modes + 1, 2, 2) [kg m^2], of which G and
                N have a part; `FlexibleBody.in_space` knows them.

        Raises:
            ValueError: If the body is in space, or the moments do not fit G and N.
        """
        if self.P is not None:
            raise ValueError("extruded: the body is in space already")
        thickness = validation.number("extruded: thickness", thickness, above=0.0, unit="m")
        n, r = self.modes + 1, self.modes
        flat = validation.real_array("extruded: moments", moments, (n, n, 2, 2))
        views = {"G": np.einsum("abkk->ab", flat), "N": flat[..., 0, 1] - flat[..., 1, 0]}
        for key, view in views.items():
            if largest_share(view - getattr(self, key), np.diag(self.G)) > ASYMMETRY:
                raise ValueError(
                    f"extruded: the moments do not fit {key}; give the moments of this body"
                )
        P, turned = np.zeros((n, n, 3, 3)), np.zeros((3, 3, r, r))
        P[..., :2, :2] = flat
        P[0, 0, 2, 2] = self.mass * thickness**2 / 12.0

        def padded(array: Array, axis: int = 0) -> Array:
            return np.insert(array, 2, 0.0, axis=axis)

        markers = {}
        for name, point in self.markers.items():
            bent = None if point.stiffening is None else padded(point.stiffening)
            turns = np.vstack([np.zeros((2, r)), point.rotation])
            shapes = padded(point.displacement), turns
            markers[name] = BodyMarker(padded(point.position), *shapes, bent)
        loads = {}
        if "acceleration" in self.stiffening:
            loads["acceleration"] = padded(self.stiffening["acceleration"])
        if rates := {"omega2", "alpha"} & set(self.stiffening):
            # [alpha] + [omega]^2 has -omega^2 in 11 and 22, alpha in 21 and -alpha in 12
            for load in rates:
                signs = -np.eye(2) if load == "omega2" else QUARTER_TURN
                turned[:2, :2] += 0.5 * np.multiply.outer(signs, self.stiffening[load])
            loads["rotation"] = turned
        S = padded(self.S, axis=1)
        return VolumeIntegrals.in_space(self.mass, S, P, self.K, markers, loads)

    def zeros_like(self) -> VolumeIntegrals:
        """Integrals of the same shape with all entries zero, the start of a sum of derivatives."""
        return self.scaled(0.0)

    def scaled(self, factor: float) -> VolumeIntegrals:
        """All entries times a ``factor``."""
        return replace(
            self,
            mass=factor * self.mass,
            **{key: factor * getattr(self, key) for key in self._arrays},
            markers={name: marker.scaled(factor) for name, marker in self.markers.items()},
            stiffening={load: factor * array for load, array in self.stiffening.items()},
        )

    def __add__(self, other: VolumeIntegrals) -> VolumeIntegrals:
        """Sum entry by entry; geometric stiffness that one of the two lacks counts as zero."""
        self._require_same_markers(other)
        return replace(
            self,
            mass=self.mass + other.mass,
            **{key: getattr(self, key) + getattr(other, key) for key in self._arrays},
            markers={name: marker + other.markers[name] for name, marker in self.markers.items()},
            stiffening=summed(self.stiffening, other.stiffening),
        )

    def dot(self, other: VolumeIntegrals) -> float:
        """Inner product with ``other`` integrals over all entries of all arrays and markers."""
        self._require_same_markers(other)
        total = self.mass * other.mass
        for key in self._arrays:
            total += float(np.sum(getattr(self, key) * getattr(other, key)))
        total += sum(marker.dot(other.markers[name]) for name, marker in self.markers.items())
        for load in self.stiffening.keys() & other.stiffening.keys():
            total += float(np.sum(self.stiffening[load] * other.stiffening[load]))
        return total

    def with_point_mass(self, marker: str, mass: float) -> VolumeIntegrals:
        """Integrals of the body with a point of a ``mass`` m_P [kg] fixed to a ``marker``.

        With W the reference position and shape functions at the marker, the point adds m_P to the
        mass, m_P W^T to S, m_P W^T W to G and m_P (J W)^T W to N, in space m_P W_a W_b^T to P_ab.
        Where the marker has geometric stiffness T_P, the inertia of the point, at X_P in the body's
        frame, stiffens the body: "omega2" gains m_P X_P . T_P, "alpha" -m_P (J X_P) . T_P, in space
        "rotation" -m_P T_P X_P^T, "acceleration" -m_P T_P.
        """
        point = self.markers[marker]
        basis, stiffening = point.basis, self.stiffening
        if point.stiffening is not None:
            loads = inertia_of_point(point.position, mass)
            shares = {load: np.tensordot(w, point.stiffening, 1) for load, w in loads.items()}
            stiffening = summed(stiffening, shares)
        if self.P is not None:
            moments = {"P": self.P + mass * np.einsum("ka,lb->abkl", basis, basis)}
        else:
            turned = QUARTER_TURN @ basis
            moments = {"G": self.G + mass * basis.T @ basis, "N": self.N + mass * turned.T @ basis}
        total, S = self.mass + mass, self.S + mass * basis.T
        return replace(self, mass=total, S=S, **moments, stiffening=stiffening)

    def point_mass_pullback(
        self, bar: VolumeIntegrals, marker: str, mass: float
    ) -> VolumeIntegrals:
        """Transpose of the derivative of :meth:`with_point_mass` for a ``marker`` and a ``mass``.

        It takes ``bar``, the derivative by the integrals with the point, to the derivative by the
        integrals without it; the marker's shape functions and stiffening collect its share.
        """
        point = self.markers[marker]
        if bar.P is not None:
            moved = np.einsum("abkl,lb->ka", bar.P, point.basis)
        else:
            moved = point.basis @ bar.G + QUARTER_TURN @ point.basis @ bar.N
        basis_bar = mass * (bar.S.T + 2.0 * moved)
        share, position = None, basis_bar[:, 0]
        if point.stiffening is not None:
            share = np.zeros_like(point.stiffening)
            none = inertia_of_point(np.zeros_like(point.position), mass)
            for k, axis in enumerate(np.eye(len(position))):  # the loads are linear in the position
                for load, weights in inertia_of_point(axis, mass).items():
                    if load in bar.stiffening:
                        turned = np.tensordot(weights - none[load], point.stiffening, 1)
                        position[k] += float(np.sum(turned * bar.stiffening[load]))
            for load, weights in inertia_of_point(point.position, mass).items():
                if load in bar.stiffening:
                    axes = list(range(weights.ndim - 1))
                    share += np.tensordot(weights, bar.stiffening[load], (axes, axes))
        point_bar = BodyMarker(position, basis_bar[:, 1:], np.zeros_like(point.rotation), share)
        return replace(bar, markers={**bar.markers, marker: bar.markers[marker] + point_bar})

    def _require_same_markers(self, other: VolumeIntegrals) -> None:
        if self.markers.keys() != other.markers.keys():
            raise ValueError(
                "volume integrals with different markers cannot be combined: "
                f"{sorted(self.markers)} and {sorted(other.markers)}"
            )
