# SPDX-License-Identifier: MIT
"""The element ``FlexibleFfrBody`` of an XML file of MBSim.

Its integrals are ours, by axes i, j: ``positionShapeFunctionIntegralArray`` holds int rho X_i w_k,
``shapeFunctionShapeFunctionIntegralArray`` int rho w_k^i w_l^j; the geometric stiffness is that of
`sid`, by acceleration, angular acceleration (3) and products of angular velocities (6, in the order
11, 22, 33, 12, 23, 13), and by forces at nodes with the sign of a factor of the displacement. Nodes
are the markers in the order of the comment; ``nodalRelativeOrientationArray`` has their axes.
"""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..files import replace_file
from .format import (
    FEATURES,
    SEAL,
    Arrays,
    axial,
    centrifugal,
    elastic,
    markers,
    of_parts,
    sealed,
    unsealed,
)

_BODY = "{http://www.mbsim-env.de/MBSimFlexibleBody}"
_VALUES = "{http://www.mbsim-env.de/MBXMLUtils}"
_GEOMETRIC = "geometricStiffnessMatrixDueTo{}Array"


class MBSim:
    """Files .mbsx with a body of MBSim."""

    name = "mbsim"
    endings: tuple[str, ...] = (".mbsx", ".mbsim.xml")
    holds: tuple[str, ...] = tuple(FEATURES)
    readable = True

    def write(self, path: Path, arrays: Arrays) -> None:
        mass, S, P, K = elastic(arrays)
        r, (names, at) = len(S) - 1, markers(arrays)
        ElementTree.register_namespace("", _BODY[1:-1])
        ElementTree.register_namespace("v", _VALUES[1:-1])
        body = ElementTree.Element(f"{_BODY}FlexibleFfrBody", {"name": path.name.split(".")[0]})
        ElementTree.SubElement(body, f"{_BODY}mass", {"unit": "kg"}).text = repr(float(mass))
        _add(body, "positionIntegral", S[0])
        _add(body, "positionPositionIntegral", P[0, 0])
        if r:
            pairs = P[1:, 1:].transpose(2, 3, 0, 1)
            _add(body, "shapeFunctionIntegral", S[1:].T)
            _add(body, "positionShapeFunctionIntegralArray", P[0, 1:].transpose(1, 2, 0))
            _add(body, "shapeFunctionShapeFunctionIntegralArray", pairs)
            _add(body, "stiffnessMatrix", K)
            if "damping" in arrays:
                _add(body, "dampingMatrix", arrays["damping"])
        if "stiffening_acceleration" in arrays:
            _add(body, _GEOMETRIC.format("Acceleration"), arrays["stiffening_acceleration"])
        if "stiffening_rotation" in arrays:
            turned = np.moveaxis(arrays["stiffening_rotation"], (0, 1), (2, 3))
            for kind, part in (("Acceleration", axial), ("Velocity", centrifugal)):
                _add(body, _GEOMETRIC.format(f"Angular{kind}"), np.moveaxis(part(turned), 2, 0))
        if names:
            _add(body, "nodeNumbers", np.arange(1.0, len(names) + 1.0))
            _add(body, "nodalRelativePositionArray", at["positions"])
            _add(body, "nodalRelativeOrientationArray", at["axes"])
        if names and r:
            _add(body, "nodalShapeMatrixOfTranslationArray", at["displacements"])
            _add(body, "nodalShapeMatrixOfRotationArray", at["rotations"])
            if np.any(at["stiffening"]):
                _add(body, "nodalGeometricStiffnessMatrixDueToForceArray", -at["stiffening"])
        told = json.dumps(names).replace("--", "-\\u002d")  # two hyphens would end the comment
        text = ElementTree.tostring(body, encoding="unicode")
        text = f'<?xml version="1.0" encoding="UTF-8"?>\n<!-- {SEAL} markers={told} -->\n{text}\n'
        replace_file(path, sealed(text))

    def read(self, path: Path) -> dict[str, Any]:
        text = unsealed(path)
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise ValueError("the file declares entities, which bodies do not need")
        try:
            root = ElementTree.fromstring(text.encode())
        except ElementTree.ParseError as error:
            raise ValueError(f"the file is damaged or no XML: {error}") from None
        body = next(root.iter(f"{_BODY}FlexibleFfrBody"), None)
        if body is None:
            raise ValueError("the file has no FlexibleFfrBody")
        found = {child.tag.removeprefix(_BODY): child for child in body}

        def get(name: str, *default: Array) -> Array:
            if name not in found and default:
                return default[0]
            if name not in found:
                raise ValueError(f"the element {name} is missing")
            return _values(name, found[name])

        P00, first = get("positionPositionIntegral"), get("positionIntegral")
        K = get("stiffnessMatrix", np.zeros((0, 0)))
        r = len(K)
        mixed = get("positionShapeFunctionIntegralArray", np.zeros((3, 3, r)))
        S = np.vstack([first[None], get("shapeFunctionIntegral", np.zeros((3, r))).T])
        P = np.zeros((r + 1, r + 1, 3, 3))
        P[0, 0], P[0, 1:] = P00, mixed.transpose(2, 0, 1)
        P[1:, 0] = P[0, 1:].transpose(0, 2, 1)
        second = get("shapeFunctionShapeFunctionIntegralArray", np.zeros((3, 3, r, r)))
        P[1:, 1:] = second.transpose(2, 3, 0, 1)
        arrays: dict[str, Any] = {"mass": get("mass"), "S": S, "P": P, "K": K}
        if (name := _GEOMETRIC.format("Acceleration")) in found:
            arrays["stiffening_acceleration"] = get(name)
        rates = [_GEOMETRIC.format(f"Angular{kind}") for kind in ("Velocity", "Acceleration")]
        if any(name in found for name in rates):
            none = (np.zeros((6, r, r)), np.zeros((3, r, r)))
            parts = (np.moveaxis(get(n, zero), 0, 2) for n, zero in zip(rates, none, strict=True))
            arrays["stiffening_rotation"] = np.moveaxis(of_parts(*parts), (2, 3), (0, 1))
        if "nodalRelativePositionArray" in found:
            n = len(get("nodalRelativePositionArray"))
            told = re.search(r"markers=(\[.*?\]) -->", text)
            numbers = get("nodeNumbers", np.arange(1.0, n + 1)).astype(int).tolist()
            names = json.loads(told[1]) if told else numbers
            arrays["markers"] = np.array([str(name) for name in names], dtype=np.str_)
            shapes, nodal = np.zeros((n, 3, r)), "nodalShapeMatrixOf{}Array"
            arrays["marker_positions"] = get("nodalRelativePositionArray")
            arrays["marker_displacements"] = get(nodal.format("Translation"), shapes)
            arrays["marker_rotations"] = get(nodal.format("Rotation"), shapes)
            axes = get("nodalRelativeOrientationArray", np.broadcast_to(np.eye(3), (n, 3, 3)))
            if np.any(axes != np.eye(3)):
                arrays["marker_axes"] = axes
            if (name := "nodalGeometricStiffnessMatrixDueToForceArray") in found:
                arrays["marker_stiffening"] = -get(name)
        return arrays


def _add(parent: ElementTree.Element, name: str, values: Array) -> None:
    """An element with a vector, a matrix, or an array of one or two dimensions of these."""
    _nest(ElementTree.SubElement(parent, f"{_BODY}{name}"), values, name.endswith("Array"))


def _nest(at: ElementTree.Element, values: Array, array: bool) -> None:
    if array and values.ndim > 3:  # rows of elements
        for row in values:
            _nest(ElementTree.SubElement(at, f"{_BODY}row"), row, True)
    elif array:
        for each in values:
            _nest(ElementTree.SubElement(at, f"{_BODY}ele"), each, False)
    elif values.ndim == 1:
        _write_row(ElementTree.SubElement(at, f"{_VALUES}xmlVector"), values)
    else:
        matrix = ElementTree.SubElement(at, f"{_VALUES}xmlMatrix")
        for row in values:
            _write_row(ElementTree.SubElement(matrix, f"{_VALUES}row"), row)


def _write_row(at: ElementTree.Element, values: Sequence[Any] | Array) -> None:
    for value in values:
        ElementTree.SubElement(at, f"{_VALUES}ele").text = repr(value.item())


def _values(name: str, at: ElementTree.Element) -> Array:
    """The numbers of an element, nested as its children; formulas of MBSim are not evaluated."""

    def nested(element: ElementTree.Element) -> Any:
        children = list(element)
        if not children:
            return float((element.text or "").strip())
        inside = [nested(child) for child in children]
        held = children[0].tag
        return inside[0] if held in (f"{_VALUES}xmlVector", f"{_VALUES}xmlMatrix") else inside

    try:
        found = np.array(nested(at), dtype=np.float64)
    except (RecursionError, ValueError):
        raise ValueError(
            f"the element {name} holds no numbers, or rows of different length"
        ) from None
    return found
