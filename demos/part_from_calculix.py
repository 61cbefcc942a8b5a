# SPDX-License-Identifier: MIT
# %% [markdown]
"""# A part that CalculiX has assembled, in motion beside the same part with a mesh.

What you will see: gmsh meshes a flat link with two bores, CalculiX (``calculix-ccx`` of Debian 12)
writes its stiffness and mass, and the link swings on one bore. The body from these matrices, which
has no mesh here, and the body from the mesh file have the same frequencies and the same motion.

**Model.** The matrices K and M of the free part, with the positions of the nodes and the sets of
those on the bores, are reduced by Craig and Bampton's method as those of a mesh are.

Run `python demos/part_from_calculix.py --help`; it takes some seconds, on one processor.
"""

import subprocess
from pathlib import Path
from shutil import which

import gmsh
import numpy as np
from command_line import parse, run, say

import dolfinx_ffr as ffr
from dolfinx_ffr.interchange import read_calculix

# %% Parameters
LENGTH, WIDTH, HEIGHT, RADIUS = 0.2, 0.05, 0.01, 0.012  # [m]
STEEL = ffr.Isotropic(young=210e9, poisson=0.3, density=7850.0)
TIMES = ffr.GeneralizedAlpha(0.3, steps=600)  # of the swing [s]


# %% The mesh, and CalculiX's input file
def write_part(folder: Path, size: float) -> None:
    """Mesh the link by gmsh: ``link.msh`` for us, and ``link.inp`` for CalculiX."""
    gmsh.initialize(["", "-v", "0"])
    occ, mesh = gmsh.model.occ, gmsh.model.mesh
    plate = occ.addRectangle(-WIDTH / 2, -WIDTH / 2, 0.0, LENGTH + WIDTH, WIDTH, roundedRadius=0.02)
    occ.cut([(2, plate)], [(2, occ.addDisk(x, 0.0, 0.0, RADIUS, RADIUS)) for x in (0.0, LENGTH)])
    occ.extrude([(2, plate)], 0.0, 0.0, HEIGHT, numElements=[2], recombine=True)
    occ.synchronize()
    groups, r = {}, 1.1 * RADIUS
    for name, x in (("left", 0.0), ("right", LENGTH)):
        bore = gmsh.model.getEntitiesInBoundingBox(x - r, -r, -r, x + r, r, r, 2)
        groups[name] = 2, gmsh.model.addPhysicalGroup(2, [surface for _, surface in bore])
    for name, group in {**groups, "material": (3, gmsh.model.addPhysicalGroup(3, [1]))}.items():
        gmsh.model.setPhysicalName(*group, name)
    for option, value in (("MeshSizeMax", size), ("RecombineAll", 1), ("SubdivisionAlgorithm", 1)):
        gmsh.option.setNumber(f"Mesh.{option}", value)
    mesh.generate(3)
    mesh.renumberNodes()
    gmsh.write(str(folder / "link.msh"))
    nodes = enumerate(mesh.getNodes()[1].reshape(-1, 3), 1)
    lines = ["*NODE", *(f"{k}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in nodes)]
    cells = enumerate(mesh.getElements(3)[2][0].reshape(-1, 8), 1)
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=ALL", *(", ".join(map(str, (k, *c))) for k, c in cells)]
    for name, group in groups.items():
        on = mesh.getNodesForPhysicalGroup(*group)[0]
        lines += [f"*NSET, NSET={name}", *map("{},".format, on)]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{STEEL.young}, {STEEL.poisson}"]
    lines += ["*DENSITY", f"{STEEL.density}", "*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL"]
    lines += ["*STEP", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "1", "*END STEP", ""]
    (folder / "link.inp").write_text("\n".join(lines))
    gmsh.finalize()


def main(arguments: list[str] | None = None) -> None:
    """Bring the part in, let it swing, and compare."""
    options = parse(arguments, "part_from_calculix", size=0.008)
    comm, output = options.comm, options.output
    if which("ccx") is None:
        raise SystemExit("CalculiX is not installed: apt-get install calculix-ccx")
    if comm.rank == 0:  # CalculiX writes link.sti, link.mas and link.dof
        output.mkdir(parents=True, exist_ok=True)
        write_part(output, options.size)
        subprocess.run(["ccx", "link"], cwd=output, check=True, capture_output=True)
    comm.Barrier()
    domain = ffr.Domain.from_gmsh(comm, output / "link.msh")
    chord = {"frame": ffr.ChordFrame("left", "right"), "modes": 6}
    matrices, ends = read_calculix(output / "link.inp"), ["left", "right"]
    bodies = {
        "mesh": ffr.FlexibleBody(domain, STEEL, **chord).reduce(np.ones(domain.n_cells)).integrals,
        "CalculiX": ffr.reduction.reduce_matrices(matrices, interfaces=ends, **chord),
    }
    pin = ffr.Revolute(("link", "left"), ffr.Ground((0.0, 0.0, 0.0)), name="pin")
    conditions = {"gravity": (0.0, -9.81, 0.0), "damping": {"link": ffr.RayleighDamping(beta=1e-4)}}
    swing = ffr.Mechanism({"link": ffr.Placement((0.0, 0.0, 0.0))}, [pin], **conditions)
    problem = ffr.MechanicalProblem(swing, TIMES, ffr.IntegralCompliance())
    evaluations = {name: problem.value({"link": body}) for name, body in bodies.items()}
    a, b = (np.sqrt(np.diag(body.K)[-6:]) for body in bodies.values())  # circular frequencies
    difference = np.max(np.abs(b / a - 1.0))
    share = abs(evaluations["CalculiX"].psi / evaluations["mesh"].psi - 1.0)
    say(f"fixed-interface frequencies differ by {difference:.1e}, psi by {share:.1e}")
    tip = {n: e.trajectory.marker_path("link", "right") for n, e in evaluations.items()}
    heights = {n: (evaluations[n].trajectory.t, path[:, 1]) for n, path in tip.items()}
    ffr.plotting.plot_curves({"height [m]": heights}, output / "tip.png", xlabel="time [s]")

    # %% The same matrices, the same body
    assert difference < 1e-8 and share < 1e-6, f"the bodies differ: {difference:.1e}, {share:.1e}"


if __name__ == "__main__":
    run(main)
