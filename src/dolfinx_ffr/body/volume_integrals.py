# SPDX-License-Identifier: MIT
"""Volume integrals of a body in the floating frame of reference.

A material point of a body is at

    r = R + A w,      w(X, q) = w_0 + sum_j q_j w_j,

with w_0 = X the reference position in the body's frame and w_j the shape functions of the elastic
displacement. Everything that the equations of motion need to know about the body is the small set
of arrays held by :class:`VolumeIntegrals`; the mechanism never sees a mesh. A rigid body is a body
with no shape functions, and a body may just as well be given by arrays from elsewhere.

In the plane the second moments P_ab = int rho w_a w_b^T count by two views, G and N; in space all
of P does, the Gram matrix of the 3 (modes + 1) components of the fields.

References:
    A. A. Shabana, Dynamics of Multibody Systems, Cambridge University Press, chapter 5,
    doi:10.1017/9781107337213.
    J. Wallrapp, Standardization of flexible body modeling in multibody system codes, Part I:
    definition of standard input data, Mechanics of Structures and Machines 22 (1994),
    doi:10.1080/08905459408905214.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from .file import checked_ending, read_arrays, write_arrays
from .marker import (
    ASYMMETRY,
    QUARTER_TURN,
    BodyMarker,
    as_array,
    check_body_marker,
    check_loads,
    inertia_of_point,
    largest_share,
    rigid_marker,
    stacked_loads,
)
from .moments import (
    check_gram_matrix,
    check_moments,
    mass_matrix_in_space,
    moments_of_rigid_body,
    smallest_scaled_eigenvalue,
    views_of_moments,
)

__all__ = ["QUARTER_TURN", "VolumeIntegrals"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VolumeIntegrals:
    """Volume integrals of one body, all that the equations of motion know about it.

    Index a = 0 belongs to the reference position w_0, a = 1..modes to the shape functions w_a;
    J is the rotation by a quarter turn. Shape functions are displacements per unit of their
    elastic coordinate; with dimensionless shape functions the elastic coordinates are in metres
    and the units are those given below.

    The same class holds derivatives of a number psi with respect to each entry. Then G and K are
    symmetric and N is antisymmetric too, so that for a perturbation d with that structure
    psi(p + eps d) - psi(p) = eps * bar.dot(d) to first order.

    In space S has three columns, and P is given instead of G and N: then it is P alone, with
    P_ab = P_ba^T, of which derivatives are, and G and N are what follows from it.
    """

    #: Mass [kg].
    mass: float
    #: Int rho w_a, shape (modes + 1, 2), in space (modes + 1, 3) [kg m].
    S: Array
    #: Int rho w_a . w_b, symmetric, shape (modes + 1, modes + 1) [kg m^2].
    G: Array
    #: Int rho (J w_a) . w_b, antisymmetric, shape (modes + 1, modes + 1) [kg m^2]; in space
    #: int rho w_a x w_b, shape (modes + 1, modes + 1, 3).
    N: Array
    #: Reduced stiffness int sigma(w_i) : eps(w_j), symmetric, shape (modes, modes) [N/m].
    K: Array
    #: Named points of the body.
    markers: dict[str, BodyMarker] = field(default_factory=dict)
    #: Geometric stiffness by unit loads of the body's own inertia, each symmetric; none by default.
    #: "omega2" by the centrifugal load of the angular velocity about the origin of the frame, shape
    #: (modes, modes) [kg]; "alpha" by the load of the angular acceleration, likewise [kg];
    #: "acceleration" by the load of the frame's acceleration less gravity along the body's axes x
    #: and y, shape (2, modes, modes) [kg/m]. The elastic forces gain omega^2 K_w q + alpha K_al q +
    #: a_x K_x q + a_y K_y q. In space "rotation"
    #: by the loads -rho w_0^l e_k, shape (3, 3, modes, modes), whose factors are those of
    #: [alpha] + [omega]^2, and "acceleration", shape (3, modes, modes). Forces at markers, and the
    #: inertia of point masses, add to them where the markers have geometric stiffness of their own.
    stiffening: dict[str, Array] = field(default_factory=dict)
    #: In space int rho w_a w_b^T, shape (modes + 1, modes + 1, 3, 3) [kg m^2]; None in the plane.
    P: Array | None = None

    def __post_init__(self) -> None:
        """Turn lists and other numbers into arrays."""
        object.__setattr__(self, "mass", float(self.mass))
        for name in ("S", "G", "N", "K"):
            object.__setattr__(self, name, as_array(getattr(self, name)))
        if self.P is not None:
            object.__setattr__(self, "P", as_array(self.P))
            for name, view in zip("GN", views_of_moments(self.P), strict=True):
                object.__setattr__(self, name, view)
        object.__setattr__(self, "markers", dict(self.markers))
        stiffening = {load: as_array(array) for load, array in self.stiffening.items()}
        object.__setattr__(self, "stiffening", stiffening)

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

        Args:
            mass: Mass [kg].
            S: Int rho w_a, shape (modes + 1, 3) [kg m].
            P: Int rho w_a w_b^T, shape (modes + 1, modes + 1, 3, 3) [kg m^2].
            K: Reduced stiffness, shape (modes, modes) [N/m].
            markers: Markers by name.
            stiffening: Geometric stiffness by load.
        """
        none, others = np.zeros((0, 0)), dict(stiffening or {})
        return VolumeIntegrals(mass, S, none, none, K, dict(markers or {}), others, P)

    @property
    def _arrays(self) -> tuple[str, ...]:
        """Names of the arrays of which all others follow."""
        return ("S", "G", "N", "K") if self.P is None else ("S", "P", "K")

    def _combined(
        self,
        mass: float,
        arrays: Mapping[str, Array],
        markers: dict[str, BodyMarker],
        stiffening: dict[str, Array],
    ) -> VolumeIntegrals:
        """Integrals of the same dimension from the arrays of :attr:`_arrays`."""
        none = {"G": np.zeros((0, 0)), "N": np.zeros((0, 0))} if "P" in arrays else {}
        return VolumeIntegrals(mass=mass, **none, **arrays, markers=markers, stiffening=stiffening)

    @property
    def stacked_stiffening(self) -> Array:
        """Geometric stiffness by all loads, shape (4, modes, modes); in space (12, ...)."""
        return stacked_loads(self.stiffening, self.dimension, self.modes)

    @staticmethod
    def rigid(
        mass: float,
        center: ArrayLike | None = None,
        inertia: ArrayLike | None = None,
        markers: Mapping[str, ArrayLike | BodyMarker] | None = None,
    ) -> VolumeIntegrals:
        """Integrals of a rigid body, a body with no elastic coordinates.

        The body is one in space where its inertia is a tensor or the moments about three axes.

        Args:
            mass: Mass [kg].
            center: Centre of mass in the body's frame, shape (2,) or (3,) [m]; None is the origin.
            inertia: Moment of inertia about the centre of mass [kg m^2]; in space the tensor, shape
                (3, 3), or its diagonal, shape (3,), in the body's axes. It must be given, for a
                body without it has no equation for its angle.
            markers: Position in the body's frame, shape (2,) or (3,) [m], or marker, by name.

        Raises:
            TypeError: If an argument is of a wrong kind.
            ValueError: If mass or inertia is missing or not positive, if a position is not finite,
                or if no distribution of mass has the inertia tensor: each principal moment is at
                most the sum of the two others.
        """
        if inertia is None:
            raise ValueError(
                "rigid body: give its moment of inertia about the centre of mass (a disc has "
                "m r^2 / 2, a slender rod m l^2 / 12; in space the tensor or three moments); a "
                "mass without extent is a PointMass at a marker of another body"
            )
        mass = validation.number("rigid body: mass", mass, above=0.0, unit="kg")
        points = validation.by_name("rigid body: markers", markers or {}, "positions")
        d = 2 if validation.is_number(inertia) else 3
        given = np.zeros(d) if center is None else center
        c = validation.real_array("rigid body: center", given, (d,), expected=f"{d} components")
        found = {
            name: rigid_marker(f"rigid body: marker {name!r}", point, d)
            for name, point in points.items()
        }
        if d == 3:
            P = moments_of_rigid_body(mass, c, inertia)
            return VolumeIntegrals.in_space(mass, mass * c[None, :], P, np.zeros((0, 0)), found)
        moment = validation.number("rigid body: inertia", inertia, above=0.0, unit="kg m^2")
        return VolumeIntegrals(
            mass=mass,
            S=mass * c[None, :],
            G=np.array([[moment + mass * c @ c]]),
            N=np.zeros((1, 1)),
            K=np.zeros((0, 0)),
            markers=found,
        )

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
        The body is one in space where S has three columns.

        Args:
            mass: Mass [kg].
            S: Int rho w_a, shape (modes + 1, 2), in space (modes + 1, 3) [kg m].
            P: Int rho w_a w_b^T, shape (modes + 1, modes + 1, 2, 2), in space
                (modes + 1, modes + 1, 3, 3) [kg m^2].
            G: Int rho w_a . w_b, shape (modes + 1, modes + 1) [kg m^2], without P.
            N: Int rho (J w_a) . w_b, shape (modes + 1, modes + 1) [kg m^2], without P.
            K: Reduced stiffness, shape (modes, modes) [N/m]; None for a rigid body.
            markers: Markers by name; for a rigid body the position alone is enough,
                shape (2,) or (3,) [m].
            stiffening: Geometric stiffness by load, "omega2", "alpha" and "acceleration".
            name: Name of the body for messages.

        Raises:
            ValueError: If neither P nor G and N are given, or both; if an array has the wrong
                shape, holds NaN, or is not that of a body (see :meth:`validate`).
        """
        moments = {"P": P, "G": G, "N": N}
        given = [key for key, array in moments.items() if array is not None]
        if given not in (["P"], ["G", "N"]):
            raise ValueError(f"body {name!r}: give either P or both G and N, not {given}")
        if np.shape(S)[1:] == (3,) and P is None:
            raise ValueError(f"body {name!r}: S has three columns; in space give P, not G and N")
        if P is not None:
            second = as_array(P)
            n = as_array(S).shape[0] if np.ndim(S) else 0
            d = 3 if np.shape(S)[1:] == (3,) else 2
            check_moments(name, second, (n, n, d, d))
            if d == 2:
                G = second[..., 0, 0] + second[..., 1, 1]
                N = second[..., 0, 1] - second[..., 1, 0]
        stiffness = np.zeros((0, 0)) if K is None else as_array(K)
        if stiffness.ndim != 2:
            raise ValueError(f"body {name!r}: K must be a matrix, not of shape {stiffness.shape}")
        r = stiffness.shape[0]
        if K is None and np.shape(S)[:1] != (1,):
            raise ValueError(
                f"body {name!r}: S has shape {np.shape(S)}, that of an elastic body; give its "
                "stiffness K"
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
        if P is not None and second.shape[-1] == 3:
            body = VolumeIntegrals.in_space(mass, as_array(S), second, stiffness, points, loads)
        else:
            both = [as_array(view) for view in (G, N) if view is not None]
            body = VolumeIntegrals(mass, as_array(S), both[0], both[1], stiffness, points, loads)
        body.validate(name)
        return body

    def save(self, path: str | Path) -> None:
        """Write to a NumPy file, which `load` reads; :mod:`dolfinx_ffr.body.file` lists its keys.

        Under MPI call it on one rank; the integrals are the same on all.

        Args:
            path: File that ends in ``.npz``; an older one is replaced when all is written.

        Raises:
            ValueError: If the integrals are not valid, or the path has another ending.
            OSError: If the file cannot be written.
        """
        path = checked_ending(path)
        self.validate(path.stem)
        points, n, r, d = self.markers.values(), len(self.markers), self.modes, self.dimension
        rotations = np.array([p.rotation for p in points])
        arrays: dict[str, Any] = {
            "mass": np.float64(self.mass),
            **{key: getattr(self, key) for key in self._arrays},
            **{f"stiffening_{load}": array for load, array in self.stiffening.items()},
            "markers": np.array(list(self.markers), dtype=np.str_),
            "marker_positions": np.array([p.position for p in points]).reshape(n, d),
            "marker_displacements": np.array([p.displacement for p in points]).reshape(n, d, r),
            "marker_rotations": rotations.reshape((n, r) if d == 2 else (n, d, r)),
        }
        if any(point.stiffening is not None for point in points):
            none = np.zeros((d, r, r))
            arrays["marker_stiffening"] = np.array(
                [none if point.stiffening is None else point.stiffening for point in points]
            )
        if any(point.axes is not None for point in points):
            axes = [np.eye(3) if point.axes is None else point.axes for point in points]
            arrays["marker_axes"] = np.array(axes)
        write_arrays(path, arrays)

    @staticmethod
    def load(path: str | Path) -> VolumeIntegrals:
        """Read from a NumPy file that `save` or another code has written.

        :mod:`dolfinx_ffr.body.file` lists the keys. The numbers are exactly those in the file.

        Args:
            path: File that ends in ``.npz``.

        Raises:
            ValueError: If the file is damaged, a key is missing or unknown, an array has the wrong
                shape or holds NaN, or the integrals are not those of a body.
            OSError: If the file cannot be read.
        """
        path = checked_ending(path)
        arrays = read_arrays(path)
        names = [str(name) for name in arrays.get("markers", np.zeros(0, dtype=np.str_)).ravel()]
        stiffening = arrays.get("marker_stiffening", np.zeros((len(names), 1)))
        try:
            return VolumeIntegrals.from_arrays(
                float(arrays["mass"]),
                arrays["S"],
                **{key: arrays.get(key) for key in "PGNK"},
                markers={
                    name: BodyMarker(
                        arrays["marker_positions"][number],
                        arrays["marker_displacements"][number],
                        arrays["marker_rotations"][number],
                        stiffening[number] if np.any(stiffening[number]) else None,
                        arrays["marker_axes"][number] if "marker_axes" in arrays else None,
                    )
                    for number, name in enumerate(names)
                },
                stiffening={
                    load: arrays[f"stiffening_{load}"]
                    for load in ("omega2", "alpha", "rotation", "acceleration")
                    if f"stiffening_{load}" in arrays
                },
                name=path.stem,
            )
        except ValueError as error:
            raise ValueError(f"body file {path}: {error}") from error

    def mass_matrix(self) -> Array:
        """Mass matrix of the undeformed body at zero angle, shape (3 + modes, 3 + modes).

        Rows are position [kg], angle [kg m^2] and the elastic coordinates; in space, where the
        shape is (6 + modes, 6 + modes), three each of position and angular velocity.
        """
        if self.P is not None:
            return mass_matrix_in_space(self.mass, self.S, self.P)
        matrix = np.zeros((3 + self.modes, 3 + self.modes))
        matrix[:2, :2] = self.mass * np.eye(2)
        matrix[:2, 2] = matrix[2, :2] = QUARTER_TURN @ self.S[0]
        matrix[:2, 3:] = self.S[1:].T
        matrix[3:, :2] = self.S[1:]
        matrix[2, 2] = self.G[0, 0]
        matrix[2, 3:] = matrix[3:, 2] = self.N[0, 1:]
        matrix[3:, 3:] = self.G[1:, 1:]
        return matrix

    def validate(self, name: str) -> None:
        """Check shapes, symmetry and definiteness.

        Args:
            name: Name of the body, for the message.

        Raises:
            ValueError: If an array has the wrong shape, holds NaN or infinity, lacks its symmetry,
                if the mass is not positive, or if the mass or stiffness matrix is indefinite.
        """
        r, d = self.modes, self.dimension
        shapes: dict[str, tuple[int, ...]] = {"S": (r + 1, d), "K": (r, r)}
        if self.P is None:
            shapes |= {"G": (r + 1, r + 1), "N": (r + 1, r + 1)}
        for key, shape in shapes.items():
            validation.real_array(f"body {name!r}: integral {key}", getattr(self, key), shape)
        if self.P is not None:
            check_moments(name, self.P, (r + 1, r + 1, d, d))
        if not np.isfinite(self.mass) or self.mass <= 0.0:
            raise ValueError(
                f"body {name!r}: the mass must be positive, but it is {self.mass:g} kg"
            )
        signs = {"G": 1.0, "N": -1.0, "K": 1.0}
        for key, sign in signs.items():
            if key not in self._arrays:
                continue
            array = getattr(self, key)
            diagonal = np.diag(self.G)
            if key == "K":
                # Where a shape function has next to none, a share of the stiffest one's.
                inertia, zeros = diagonal[1:], np.zeros(r)
                squares = np.divide(np.diag(array), inertia, out=zeros, where=inertia > 0.0)
                diagonal = np.maximum(np.diag(array), 1e-12 * np.max(squares, initial=0) * inertia)
            defect = largest_share(array - sign * array.T, diagonal)
            if defect > ASYMMETRY:
                kind = "symmetric" if sign > 0 else "antisymmetric"
                raise ValueError(
                    f"body {name!r}: integral {key} must be {kind}, but entries differ by "
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
        """Integrals of the same body with its first shape functions alone.

        Args:
            modes: Number of shape functions that are kept.

        Raises:
            ValueError: If the body has fewer.
        """
        if not 0 <= modes <= self.modes:
            raise ValueError(f"the body has {self.modes} shape functions, and not {modes}")
        n = modes + 1
        cuts = {"S": np.s_[:n], "K": np.s_[:modes, :modes]}
        arrays = {key: getattr(self, key)[cuts.get(key, np.s_[:n, :n])] for key in self._arrays}
        return self._combined(
            self.mass,
            arrays,
            {name: marker.leading(modes) for name, marker in self.markers.items()},
            {load: array[..., :modes, :modes] for load, array in self.stiffening.items()},
        )

    def zeros_like(self) -> VolumeIntegrals:
        """Integrals of the same shape with all entries zero, the start of a sum of derivatives."""
        return self.scaled(0.0)

    def scaled(self, factor: float) -> VolumeIntegrals:
        """All entries times a factor.

        Args:
            factor: The factor.
        """
        return self._combined(
            factor * self.mass,
            {key: factor * getattr(self, key) for key in self._arrays},
            {name: marker.scaled(factor) for name, marker in self.markers.items()},
            {load: factor * array for load, array in self.stiffening.items()},
        )

    def __add__(self, other: VolumeIntegrals) -> VolumeIntegrals:
        """Sum entry by entry; geometric stiffness that one of the two lacks counts as zero."""
        self._require_same_markers(other)
        return self._combined(
            self.mass + other.mass,
            {key: getattr(self, key) + getattr(other, key) for key in self._arrays},
            {name: marker + other.markers[name] for name, marker in self.markers.items()},
            {
                load: np.sum([b.stiffening[load] for b in (self, other) if load in b.stiffening], 0)
                for load in self.stiffening | other.stiffening
            },
        )

    def dot(self, other: VolumeIntegrals) -> float:
        """Inner product over all entries of all arrays, markers included.

        Args:
            other: Integrals of the same shape.

        Raises:
            ValueError: If the two have different markers.
        """
        self._require_same_markers(other)
        total = self.mass * other.mass
        for key in self._arrays:
            total += float(np.sum(getattr(self, key) * getattr(other, key)))
        total += sum(marker.dot(other.markers[name]) for name, marker in self.markers.items())
        for load in self.stiffening.keys() & other.stiffening.keys():
            total += float(np.sum(self.stiffening[load] * other.stiffening[load]))
        return total

    def with_point_mass(self, marker: str, mass: float) -> VolumeIntegrals:
        """Integrals of the body with a point mass fixed to a marker.

        With W the reference position and shape functions at the marker, the point adds m_P to the
        mass, m_P W^T to S, m_P W^T W to G and m_P (J W)^T W to N, in space m_P W_a W_b^T to P_ab.
        Where the marker has geometric stiffness T_P, the inertia of the point, at X_P in the body's
        frame, stiffens the body: "omega2" gains m_P X_P . T_P, "alpha" -m_P (J X_P) . T_P, in space
        "rotation" -m_P T_P X_P^T, "acceleration" -m_P T_P.

        Args:
            marker: Name of the marker.
            mass: Mass of the point [kg].
        """
        point = self.markers[marker]
        basis, stiffening = point.basis, dict(self.stiffening)
        if point.stiffening is not None:
            for load, weights in inertia_of_point(point.position, mass).items():
                share = np.tensordot(weights, point.stiffening, 1)
                stiffening[load] = stiffening[load] + share if load in stiffening else share
        if self.P is not None:
            return replace(
                self,
                mass=self.mass + mass,
                S=self.S + mass * basis.T,
                P=self.P + mass * np.einsum("ka,lb->abkl", basis, basis),
                stiffening=stiffening,
            )
        return replace(
            self,
            mass=self.mass + mass,
            S=self.S + mass * basis.T,
            G=self.G + mass * basis.T @ basis,
            N=self.N + mass * (QUARTER_TURN @ basis).T @ basis,
            stiffening=stiffening,
        )

    def point_mass_pullback(
        self, bar: VolumeIntegrals, marker: str, mass: float
    ) -> VolumeIntegrals:
        """Transpose of the derivative of :meth:`with_point_mass` at these integrals.

        Args:
            bar: Derivative with respect to the integrals of the body with the point mass.
            marker: Name of the marker.
            mass: Mass of the point [kg].

        Returns:
            Derivative with respect to the integrals of the body without the point mass; the
            marker's shape functions and geometric stiffness collect the share of the point.
        """
        point = self.markers[marker]
        basis = point.basis
        if bar.P is not None:
            basis_bar = mass * (bar.S.T + 2.0 * np.einsum("abkl,lb->ka", bar.P, basis))
        else:
            basis_bar = mass * (bar.S.T + 2.0 * basis @ bar.G + 2.0 * QUARTER_TURN @ basis @ bar.N)
        share = None
        if point.stiffening is not None:
            share = np.zeros_like(point.stiffening)
            for load, weights in inertia_of_point(point.position, mass).items():
                if load in bar.stiffening:
                    axes = list(range(weights.ndim - 1))
                    share += np.tensordot(weights, bar.stiffening[load], (axes, axes))
        none = np.zeros_like(point.position), np.zeros_like(point.rotation)
        still = BodyMarker(none[0], basis_bar[:, 1:], none[1], share)
        return replace(bar, markers={**bar.markers, marker: bar.markers[marker] + still})

    def _require_same_markers(self, other: VolumeIntegrals) -> None:
        if self.markers.keys() != other.markers.keys():
            raise ValueError(
                f"integrals with different markers: {sorted(self.markers)} "
                f"and {sorted(other.markers)}"
            )
