# SPDX-License-Identifier: MIT
"""The base class of a flat part and a solid, which a design encloses."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from ..design import Design
from ..documentation import Shown
from ..fem import Domain, ElasticMaterial
from .field import Field
from .widths import Width


class PartWarning(UserWarning):
    """A part is not all of its design, is not held as it should be, or is worth less."""


class LoosePieceWarning(PartWarning):
    """Pieces of a design touch no interface and are left out of its part."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Findings:
    """What rank 0 finds out about a part or a solid, and sends to all ranks."""

    pieces: int  #: Number of connected pieces
    lost_interfaces: list[str]  #: Interfaces without material
    warnings: list[PartWarning]  #: What a user must know, loose pieces first


class Enclosed(Shown, ABC):
    """What a design encloses, to be made: a `Part` in the plane, a `Solid` in space.

    Both have the members below, and `Result.part` gives the one that fits the body.
    """

    kind: ClassVar[str]  #: "part" or "solid", also the name of its files
    elements: ClassVar[str]  #: What its meshes are made of
    #: Largest change of psi from one of its meshes to the next that counts as none, by default
    tolerance: ClassVar[float]
    most: ClassVar[int]  #: Number of meshes that are tried by default
    dimension: ClassVar[int]  #: Of its body
    _findings: Findings

    def _set_arguments(
        self, domain: Domain, field: Field, material: ElasticMaterial | None, attribute: str
    ) -> None:
        """Check the arguments and store them; the material must have the ``attribute``."""
        #: The body that was designed
        self.body = validation.instance(f"{self.kind}: domain", domain, Domain, "a Domain")
        if domain.dimension != self.dimension:
            place, kind = ("space", "Solid") if domain.dimension == 3 else ("the plane", "Part")
            raise ValueError(
                f"{self.kind}: the body is in {place}; take a {kind} for bodies in {place}"
            )
        validation.function(f"{self.kind}: field", field, "positions")
        #: Positive in the material, of positions (n, dimension) [m]
        self.field = field
        if material is not None:
            label = f"{self.kind}: material"
            validation.implementation(label, material, [attribute], "an elastic material")
        #: What it is made of, for its mass
        self.material = material

    @classmethod
    def of(cls, design: Design, variables: ArrayLike, **options: Any) -> Self:
        """What a ``design`` encloses at its ``variables``.

        The boundary of a level set is its zero line or surface. Of densities it is where a smooth
        mean of them is one half (`density_field`). The ``options`` are arguments of the class.
        """
        kinds = "a LevelSet or a DensityDesign"
        validation.instance(f"{cls.kind}: design", design, Design, kinds)
        if design.web:
            options = {"web": design.web, **options}
        validation.keywords(f"{cls.__name__}.of", options, cls)
        field = design.level(design.check(variables))
        return cls(design.domain, field, **options)  # type: ignore[call-arg]

    def _shown(self) -> list[tuple[str, str, str]]:
        """Pieces, mass and warnings, and those widths that have been measured already."""
        rows = [("pieces", f"{self.pieces}", "")]
        if self.weighs:
            rows.append(("mass", f"{self.mass:.5g} kg", ""))
        for name in ("thinnest member", "narrowest gap"):
            width = vars(self).get(name.replace(" ", "_"))
            if width:
                rows.append((name, f"{1e3 * width.value:.3g} mm", ""))
        return rows + [("warning", text, "") for text in self.warnings]

    @property
    def pieces(self) -> int:
        """Number of connected pieces of material."""
        return self._findings.pieces

    @property
    def warnings(self) -> list[str]:
        """The warnings that it was made with."""
        return [str(warning) for warning in self._findings.warnings]

    def _warn(self) -> None:
        """Issue all warnings at the line that makes the part or the solid."""
        for warning in self._findings.warnings:
            warnings.warn(f"{self.kind}: {warning}", type(warning), stacklevel=3)

    @property
    def lost_interfaces(self) -> list[str]:
        """Interfaces that are left without material."""
        return self._findings.lost_interfaces

    @property
    @abstractmethod
    def volume(self) -> float:
        """Volume [m^3]; in the plane area times the thickness of the material."""

    @property
    def mass(self) -> float:
        """Mass [kg]; a ValueError without a material that tells its density."""
        material = self._material_for("its mass")
        if not self.weighs:
            raise ValueError(
                f"{self.kind}: the material {type(material).__name__} needs the attribute density "
                "[kg/m^3] for a mass"
            )
        return self.volume * float(material.density)

    @property
    def weighs(self) -> bool:
        """Whether its mass is known: whether it has a material that tells its density."""
        return getattr(self.material, "density", None) is not None

    def density(self, domain: Domain) -> Array:
        """The density of each cell of a mesh ``domain`` that fits it, (cells,).

        It is one, and in pockets the thickness of their floor as a share of the part's.
        """
        return np.ones(domain.n_cells)

    @property
    @abstractmethod
    def thinnest_member(self) -> Width | None:
        """The thinnest member, by discs or balls that do not fit; None if there is none."""

    @property
    @abstractmethod
    def narrowest_gap(self) -> Width | None:
        """The narrowest gap or hole, by discs or balls that do not fit; None if there is none."""

    def measures(self) -> dict[str, Width | int | None]:
        """Sizes and counts that summaries report, by name."""
        return {"thinnest member": self.thinnest_member, "narrowest gap": self.narrowest_gap}

    def _material_for(self, quantity: str) -> ElasticMaterial:
        """The material; a ValueError if there is none from which a ``quantity`` follows."""
        if self.material is None:
            raise ValueError(
                f"{self.kind}: {quantity} needs a material; make the {self.kind} with "
                f"{type(self).__name__}(..., material=)"
            )
        return self.material

    def write(self, path: str | Path, **options: Any) -> list[Path]:
        """Write it for CAD, printers and machines; rank 0 writes.

        Args:
            path: A file: of a part .svg, .dxf, .step or .stl, of a solid .stl, .ply, .vtp or .obj.
                Or a folder, for "part.svg" and all others of a part, for "solid.stl" of a solid.
            options: ``unit`` of lengths, "mm" (the default) or "m". Files .step are in
                millimetres and say so.

        Returns:
            The files, on every rank.

        Raises:
            ValueError: If kind of file or unit are not known, or a part has no thickness.
            OSError: If a file cannot be written; older ones stay.
        """
        validation.keywords(f"{self.kind}.write", options, self._write)
        return self._write(path, **options)

    @abstractmethod
    def _write(self, path: str | Path, *, unit: str) -> list[Path]:
        """See `write`."""

    @abstractmethod
    def sizes(self, size: float | None, count: int) -> list[float]:
        """Sizes of ``count`` meshes to evaluate it on, each finer than the last [m].

        The first ``size`` is by default one that suits it.
        """

    @abstractmethod
    def domain(self, size: float, order: int = 2) -> Domain:
        """A mesh with cells of a ``size`` [m] that fits it, for displacements of an ``order``.

        It has the interfaces of the body, with the same centres, and its solid regions.
        """

    def resolved(self, size: float, order: int) -> Domain:
        """As `domain` for a ``size`` and ``order``, with smaller cells where the stress is high."""
        return self.domain(size, order)
