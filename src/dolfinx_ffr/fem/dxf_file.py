# SPDX-License-Identifier: MIT
"""Visible curves of DXF files, by ezdxf, in metres."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import BSpline

from ..arrays import Array
from ..limits import MOST_CURVES, check_count
from .curves import Arc, Curve, Drawn, Line, Spline

#: Units by their code in the header: inch, foot, mm, cm, m, yard, micrometre, decimetre [m]
_INSUNITS = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0, 10: 0.9144, 13: 1e-6, 14: 0.1}
#: Entities that draw no outline
_NOTES = {"TEXT", "MTEXT", "DIMENSION", "LEADER", "POINT", "HATCH", "ATTDEF", "VIEWPORT", "IMAGE"}
_NOTES |= {"ACAD_TABLE", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION", "MULTILEADER", "TOLERANCE"}
#: Points by which curves are taken that are neither lines, arcs nor B-splines, as ellipses
_POINTS = 65


def read_dxf(path: Path, scale: float | None, layers: Collection[str] | None) -> list[Drawn]:
    """Read the visible curves in the model space of a DXF file.

    The unit of the file is ``scale`` [m], or that of its header. Other ``layers`` are not looked
    at; None stands for all.
    """
    import ezdxf

    try:
        drawing = ezdxf.readfile(path)
    except Exception as error:  # a damaged file fails anywhere in the reader
        raise ValueError(f"outline {path}: no DXF file that can be read: {error}") from error
    code = int(drawing.header.get("$INSUNITS", 0))
    scale = _INSUNITS.get(code) if scale is None else scale
    if scale is None:
        raise ValueError(
            f"outline {path}: the file does not say its unit ($INSUNITS = {code}); give unit='mm'"
        )
    visible = _Visible(path, drawing, layers)
    drawn: list[Drawn] = []
    for entity, line_type in visible.parts(drawing.modelspace(), "0", ""):
        kind, layer = entity.dxftype(), entity.dxf.layer
        if kind in _NOTES:
            continue
        try:
            curves = _of_entity(entity, scale)
        except Exception as error:  # ezdxf raises many kinds for numbers that make no curve
            raise ValueError(
                f"outline {path}: a {kind} on the layer {layer!r} is damaged ({error}); delete it, "
                "or draw it anew"
            ) from error
        if curves is None:
            raise ValueError(
                f"outline {path}: the layer {layer!r} holds a {kind}, which is no curve in the "
                "plane; delete it, convert it to lines, arcs or splines, or name the layers of the "
                "outline by layers=[...]"
            )
        drawn += [Drawn(curve, frozenset([layer]), line_type) for curve in curves]
    if not drawn:
        _refuse_paper(path, drawing, visible)
    return drawn


def _refuse_paper(path: Path, drawing: Any, visible: _Visible) -> None:
    """Refuse a drawing that is in paper space alone, which may be drawn to any scale."""
    for name in drawing.layouts.names():
        entities = [] if name == "Model" else visible.parts(drawing.layout(name), "0", "")
        kinds = {entity.dxftype() for entity, _ in entities} - _NOTES
        if kinds:
            raise ValueError(
                f"outline {path}: its curves are in paper space, on the layout {name!r}, whose "
                "scale is not known; move them to model space in full size (CHSPACE)"
            )


class _Visible:
    """The visible entities of a drawing, blocks and polylines in parts."""

    def __init__(self, path: Path, drawing: Any, layers: Collection[str] | None) -> None:
        self.path = path
        self.layers = None if layers is None else {name.lower() for name in layers}
        self.line_types = {
            x.dxf.name.lower(): x.dxf.name for x in drawing.linetypes if _has_gaps(x)
        }
        self.of_layers = {x.dxf.name.lower(): x.dxf.linetype for x in drawing.layers}
        # names of layers have no small and large letters
        self.frozen = {x.dxf.name.lower() for x in drawing.layers if x.is_frozen()}
        self.off = {x.dxf.name.lower() for x in drawing.layers if x.is_off()} | self.frozen
        self._check_blocks(drawing)

    def parts(
        self, entities: Iterable[Any], layer_0: str, line_type: str
    ) -> Iterator[tuple[Any, str]]:
        """Entities that are drawn, with the names of line types that have gaps, or "".

        What is on layer 0 of a block is on the layer of its insert, ``layer_0``; what has the line
        type of its block has that of its insert.
        """
        for entity in entities:
            if not entity.is_supported_dxf_attrib("layer"):
                self._refuse(entity, "an unknown kind")
            if entity.dxf.layer == "0" and layer_0 != "0":
                entity.dxf.layer = layer_0
            layer = entity.dxf.layer.lower()
            insert = entity.dxftype() == "INSERT"
            # a block that is off is drawn where it is on other layers
            if entity.dxf.get("invisible", 0) or layer in (self.frozen if insert else self.off):
                continue
            gaps = self._line_type(entity, line_type)
            if insert:
                for single_insert in entity.multi_insert() if entity.mcount > 1 else [entity]:
                    members = single_insert.virtual_entities(skipped_entity_callback=self._refuse)
                    yield from self.parts(members, entity.dxf.layer, gaps)
            elif self.layers is not None and layer not in self.layers:
                continue
            elif entity.dxftype() in ("LWPOLYLINE", "POLYLINE"):
                entity.dxf.linetype = "BYLAYER"  # the sides cannot have one that the file lacks
                for side, _ in self.parts(entity.virtual_entities(), entity.dxf.layer, gaps):
                    yield side, gaps
            else:
                yield entity, gaps

    def _line_type(self, entity: Any, of_block: str) -> str:
        """The name of an entity's line type if it has gaps, or ""."""
        name = entity.dxf.get("linetype", "BYLAYER").lower()
        if name == "byblock":
            return of_block
        if name == "bylayer":
            name = self.of_layers.get(entity.dxf.layer.lower(), "").lower()
        # the table of the file may lack these
        without = name.upper() if name.startswith(("center", "hidden")) else ""
        return self.line_types.get(name, without)

    def _refuse(self, entity: Any, reason: str) -> None:
        if entity.dxftype() not in _NOTES:
            raise ValueError(
                f"outline {self.path}: a {entity.dxftype()} cannot be placed ({reason}); delete "
                "it, or explode the block that holds it"
            )

    def _check_blocks(self, drawing: Any) -> None:
        """Refuse blocks that hold themselves, are not there or clipped, or too many curves."""
        counts: dict[str, int] = {}

        def curves(entities: Iterable[Any], above: tuple[str, ...]) -> int:
            """Number of curves in entities, also on layers that are not drawn."""
            number = 0
            for entity in entities:
                if entity.dxftype() != "INSERT":
                    number += len(entity) if entity.dxftype() in ("LWPOLYLINE", "POLYLINE") else 1
                    continue
                name = entity.dxf.name
                block = drawing.blocks.get(name)
                if block is None or block.block.dxf.flags & 4:
                    raise ValueError(
                        f"outline {self.path}: the block {name!r} is not in the file; bind "
                        "external references in the program that wrote it"
                    )
                if entity.has_extension_dict and "ACAD_FILTER" in entity.get_extension_dict():
                    raise ValueError(
                        f"outline {self.path}: an insert of the block {name!r} is clipped, which "
                        "is not supported; explode it, and trim its curves"
                    )
                if name.lower() in above:
                    raise ValueError(
                        f"outline {self.path}: the block {name!r} contains itself; delete the "
                        "insert in it, or explode it"
                    )
                if name.lower() not in counts:
                    counts[name.lower()] = curves(block, (*above, name.lower()))
                number += entity.mcount * counts[name.lower()]
            return number

        subject, count = f"outline {self.path}", curves(drawing.modelspace(), ())
        remedy = "simplify polylines, or delete blocks that are no outline"
        check_count(subject, count, "curves", remedy, most=MOST_CURVES)


def _has_gaps(line_type: Any) -> bool:
    """Whether a line type has gaps, as centre lines and hidden edges have.

    Code 49 is the length of a dash, or of a gap if it is negative.
    """
    return any(tag.code == 49 and tag.value < 0.0 for tag in line_type.pattern_tags.tags)


def _of_entity(entity: Any, scale: float) -> list[Curve] | None:
    """The curves of an entity, None where it is no curve in the plane."""
    kind = entity.dxftype()
    if kind == "LINE":
        ends = np.array([[*p] for p in (entity.dxf.start, entity.dxf.end)])
        if _leaves_plane(ends):
            return None
        a, b = (scale * end[:2] for end in ends)
        return [] if np.array_equal(a, b) else [Line(a, b)]
    if kind in ("ARC", "CIRCLE"):
        up = np.array([*entity.dxf.extrusion])
        if not np.allclose(up[:2], 0.0, atol=1e-9 * abs(up[2])):
            return None
        center = scale * np.array([*entity.dxf.center])[:2]
        first_angle, sweep = 0.0, 2.0 * np.pi
        if kind == "ARC":
            first_angle = np.radians(entity.dxf.start_angle)
            angle = (entity.dxf.end_angle - entity.dxf.start_angle) % 360.0
            sweep = float(np.radians(angle)) or sweep
        if up[2] < 0.0:  # mirrored: x of its own coordinates is that of the drawing reversed
            center, first_angle, sweep = center * [-1.0, 1.0], np.pi - first_angle, -sweep
        radius, angles = (
            scale * abs(float(entity.dxf.radius)),
            np.array([first_angle, first_angle + sweep]),
        )
        a, b = center + radius * np.column_stack([np.cos(angles), np.sin(angles)])
        return [Arc(a, a if abs(abs(sweep) - 2.0 * np.pi) < 1e-12 else b, center, sweep)]
    if kind == "SPLINE":
        tool = entity.construction_tool()
        control = np.array([[*p] for p in tool.control_points])
        weights = np.array(tool.weights()) if len(tool.weights()) else np.ones(len(control))
        if _leaves_plane(control):
            return None
        return _spline(scale * control[:, :2], np.array(tool.knots()), weights, tool.order - 1)
    if kind == "ELLIPSE":
        tool = entity.construction_tool()
        angles = tool.start_param + np.linspace(0.0, 1.0, _POINTS) * tool.param_span
        points = np.array([[*p] for p in tool.vertices(angles)])
        return None if _leaves_plane(points) else [Spline.through(scale * points[:, :2])]
    return None


def _spline(control: Array, knots: Array, weights: Array, k: int) -> list[Curve]:
    """A B-spline, also a rational one, or one that does not end in its control points.

    Its control points are (n, 2), its knots (n + k + 1,) and its weights (n,), for the degree k.
    A rational one becomes splines through its points.
    """
    low, high = knots[k], knots[-k - 1]
    inner_knots = (knots[(knots > low) & (knots < high)] - low) / (high - low)
    curve = BSpline(knots, np.column_stack([control * weights[:, None], weights]), k)

    def at(t: Array) -> Array:
        """Points at parameters from 0 to 1."""
        homogeneous = curve(low + t * (high - low))
        return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])

    if np.ptp(weights) == 0.0:
        end_knots = np.ones(k + 1)
        return [Spline.of(at, np.concatenate([0.0 * end_knots, inner_knots, end_knots]), k)]

    # where knots coincide, a rational one may bend sharply
    places, multiplicity = np.unique(inner_knots, return_counts=True)
    ends = np.concatenate([[0.0], places[multiplicity > 1], [1.0]])
    return [Spline.through(at(np.linspace(a, b, 2 * _POINTS))) for a, b in pairwise(ends)]


def _leaves_plane(x: Array) -> bool:
    """Whether points differ in z."""
    return bool(x.shape[1] > 2 and np.ptp(x[:, 2]) > 1e-9 * max(float(np.ptp(x[:, :2])), 1e-300))
