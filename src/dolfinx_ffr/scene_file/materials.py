# SPDX-License-Identifier: MIT
"""Elastic constants of some materials, each with its source; measure your own where it matters.

Printed and sintered plastics depend on machine, direction, temperature and moisture.
"""

from __future__ import annotations

#: By name: young [Pa], poisson [-], density [kg/m^3], and where they come from
SOLIDS = {
    "steel": {
        "young": 210e9,
        "poisson": 0.3,
        "density": 7850.0,
        "source": "EN 1993-1-1, 3.2.6; EN 1991-1-1, table A.4",
    },
    "stainless steel": {
        "young": 200e9,
        "poisson": 0.3,
        "density": 7900.0,
        "source": "EN 1993-1-4, 2.1.3; EN 10088-1 (1.4301)",
    },
    "aluminium": {
        "young": 70e9,
        "poisson": 0.3,
        "density": 2700.0,
        "source": "EN 1999-1-1, 3.2.5",
    },
    "titanium": {
        "young": 113.8e9,
        "poisson": 0.342,
        "density": 4430.0,
        "source": "Ti-6Al-4V, annealed: ASM data sheet MTP643",
    },
    "PA12": {
        "young": 1.65e9,
        "poisson": 0.4,
        "density": 930.0,
        "source": "laser-sintered: data sheet of EOS PA 2200; poisson is typical of polyamides",
    },
    "PLA": {
        "young": 3.5e9,
        "poisson": 0.36,
        "density": 1240.0,
        "source": "solid: S. Farah et al., Adv. Drug Deliv. Rev. 107 (2016), "
        "doi:10.1016/j.addr.2016.06.012; printed parts are softer",
    },
}
