# SPDX-License-Identifier: MIT
"""Machines that others have published with numbers, redone from their data.

The flexible slider-crank of Simeon and Andrews' squeezing mechanism stand in the test set for IVP
solvers with all their data and with a solution of sixteen digits at one instant. Both are built
here by the public API: the flexible rod once from the published arrays, and once as a mesh.
"""

from typing import Any

from mpi4py import MPI

import numpy as np
import read_arrays
from arrays import moments, rows_of
from jobs import Array, Job, Progress, Results
from numpy.typing import ArrayLike
from report import Study, line, plot
from scipy.integrate import solve_ivp, trapezoid

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, GRAY, GREEN, ORANGE

# %% The flexible slider-crank
PI = 3.1415927  # theirs has eight digits
CRANK, ROD = 0.15, 0.30  # lengths [m]
CRANK_MASS, ROD_MASS, SLIDER = 0.36, 0.151104, 0.075552  # [kg]
CRANK_INERTIA, ROD_INERTIA = 0.002727, 0.0045339259  # about their first ends [kg m^2]
YOUNG, SIDE, DENSITY, SPEED = 0.2e12, 0.008, 7870.0, 150.0  # [Pa], [m], [kg/m^3], [rad/s]
CRANK_END = 0.1  # [s]
#: The elastic coordinates that they start with, and their velocities [m], [m/s]
START = [0.0, 0.0, 0.103339863e-4, 0.169327969e-4]
START_VELOCITY = [0.444896105, 0.463434311e-2, -0.178591076e-5, -0.268938672e-5]
#: Their solution at the end [rad], [m], [N], [N m]; multipliers with the sign of a reaction
CRANK_SOLUTION = {
    "angle of the rod [rad]": -3.311734987910881e-01,
    "place of the slider [m]": 1.697373326718410e-01,
    "first bending coordinate [m]": 1.893192460247178e-04,
    "second bending coordinate [m]": 2.375751865617931e-05,
    "stretch of the middle [m]": -5.323907988763734e-06,
    "stretch of the end [m]": -8.363283141616840e-06,
    "angular velocity of the rod [rad/s]": 6.025346682645789e01,
    "velocity of the slider [m/s]": -8.753116989887888e00,
    "first bending velocity [m/s]": -3.005536801092212e-02,
    "force of the guide [N]": 6.232893262533717e01,
    "moment of the drive [N m]": -2.529853213732781e01,
}

# %% Andrews' squeezing mechanism: masses, inertia, pins, lengths as in the test set
SQUEEZER_END, TORQUE, STIFFNESS, LENGTH = 0.03, 0.033, 4530.0, 0.07785  # [s], [N m], [N/m], [m]
A, B, C = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)  # [m]
#: Mass [kg], moment of inertia about the centre [kg m^2], centre, and points [m]
LINKS: dict[str, tuple[float, float, tuple[float, float], dict[str, tuple[float, float]]]] = {
    "K1": (0.04325, 2.194e-6, (9.2e-4, 0.0), {"O": (0.0, 0.0), "F": (7e-3, 0.0)}),
    "K2": (0.00365, 4.410e-7, (-0.0115, 0.0), {"F": (0.0, 0.0), "E": (-28e-3, 0.0)}),
    "K3": (
        *(0.02373, 5.255e-6, (0.01874, 0.01043)),
        {"B": (0.0, 0.0), "E": (0.0, -35e-3), "D": (0.02, -18e-3)},
    ),
    "K4": (0.00706, 5.667e-7, (0.0, -0.00579), {"H": (0.0, 0.0), "E": (0.0, -0.02)}),
    "K5": (0.07050, 1.169e-5, (0.02308, 9.16e-3), {"A": (0.0, 0.0), "H": (0.04, 0.0)}),
    "K6": (0.00706, 5.667e-7, (0.00579, 0.0), {"G": (0.0, 0.0), "E": (0.02, 0.0)}),
    "K7": (0.05498, 1.912e-5, (0.01228, 4.49e-3), {"A": (0.0, 0.0), "G": (0.0, -0.04)}),
}
#: Pins between two links, and pins on the frame
PINS = [("K2", "K1", "F"), ("K3", "K2", "E"), ("K4", "K2", "E"), ("K6", "K2", "E")]
PINS += [("K4", "K5", "H"), ("K6", "K7", "G")]
FRAME = {"K1": ("O", (0.0, 0.0)), "K3": ("B", B), "K5": ("A", A), "K7": ("A", A)}
#: beta, theta, gamma, phi, delta, omega and epsilon at the start [rad]
ANGLES = [-0.0617138900142764496, 0.0, 0.455279819163070380, 0.222668390165885885]
ANGLES += [0.487364979543842550, -0.222668390165885885, 1.23054744454982119]
#: Their solution at the end: the angles [rad], and forces of the pins at E [N]
SQUEEZER_SOLUTION = {
    "beta [rad]": 0.1581077119629904e2,
    "theta [rad]": -0.1575637105984298e2,
    "gamma [rad]": 0.4082224013073101e-1,
    "phi [rad]": -0.5347301163226948,
    "delta [rad]": 0.5244099658805304,
    "omega [rad]": 0.5347301163226948,
    "epsilon [rad]": 0.1048080741042263e1,
    "force on K3 along x [N]": 0.1991753333731910e3,
    "force on K3 along y [N]": -0.2975531228015052e2,
    "force on K4 along x [N]": 0.2306654119098399e2,
    "force on K6 along x [N]": 0.2264249232082739e2,
}


def published_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one for each machine, and one for the rod as a mesh."""
    steps = [100, 200, 300] if quick else [500, 1000, 2000, 4000, 8000, 16000]
    crank = {"steps": steps, "by_scipy": 1e-4 if quick else 1e-12}
    meshes = [[15, 1]] if quick else [[75, 2], [150, 4], [300, 8]]
    return [
        Job("published", "slider_crank", 10.0, crank),
        Job("published", "squeezer", 10.0, {"steps": steps[:-1]}),
        Job("published", "meshed_rod", 20.0, {"meshes": meshes, "steps": 2 * steps[-3:][0]}),
    ]


def beam(axial_inertia: float = 1.0) -> ffr.VolumeIntegrals:
    """The rod of the test set by its arrays: two bending and two stretching shape functions.

    Those are sin(pi s), sin(2 pi s), 4 s (1 - s) and s (2 s - 1). The inertia of stretching is
    15 times what these give, as in the test set; ``axial_inertia`` is its share of that.
    """
    mass, stiffness = DENSITY * SIDE**2 * ROD, YOUNG * SIDE**2 / ROD
    S, G, N, K = np.zeros((5, 2)), np.zeros((5, 5)), np.zeros((5, 5)), np.zeros((4, 4))
    S[:, 0] = [0.5 * ROD_MASS * ROD, 0.0, 0.0, mass * 2.0 / 3.0, mass / 6.0]
    S[1, 1] = mass * 2.0 / PI
    G[0, 0], G[0, 3:] = ROD_INERTIA, [ROD * mass / 3.0, ROD * mass / 6.0]
    G[3:, 0] = G[0, 3:]
    G[1, 1] = G[2, 2] = 0.5 * mass
    G[3:, 3:] = axial_inertia * mass * np.array([[8.0, 1.0], [1.0, 2.0]])
    N[0, 1:3] = ROD * mass / PI * np.array([1.0, -0.5])
    N[1, 3:] = mass * np.array([-16.0 / PI**3, 8.0 / PI**3 - 1.0 / PI])
    N[2, 4] = 0.5 * mass / PI
    K[0, 0], K[1, 1] = stiffness * PI**4 * (SIDE / ROD) ** 2 * np.array([1 / 24.0, 2 / 3.0])
    K[2:, 2:] = stiffness / 3.0 * np.array([[16.0, -8.0], [-8.0, 7.0]])
    middle, right = np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0]]), np.zeros((2, 4))
    right[0, 3] = 1.0
    slopes = PI / ROD * np.array([[1.0, 2.0, 0, 0], [0.0, -2.0, 0, 0], [-1.0, 2.0, 0, 0]])
    markers = {
        "left": ffr.BodyMarker([0.0, 0.0], np.zeros((2, 4)), slopes[0]),
        "middle": ffr.BodyMarker([0.5 * ROD, 0.0], middle, slopes[1]),
        "right": ffr.BodyMarker([ROD, 0.0], right, slopes[2]),
    }
    return ffr.VolumeIntegrals.from_arrays(ROD_MASS, S, G=G, N=N - N.T, K=K, markers=markers)


def turning(
    rod: ffr.VolumeIntegrals, method: ffr.dynamics.Integrator, start: ffr.mechanism.Start
) -> ffr.dynamics.Trajectory:
    """The motion of the slider-crank with a rod, whose markers are left, middle and right."""
    own = CRANK_INERTIA - CRANK_MASS * CRANK**2 / 4.0
    pins = {"bearing": (0.0, 0.0), "pin": (CRANK, 0.0)}
    crank = ffr.VolumeIntegrals.rigid(CRANK_MASS, (0.5 * CRANK, 0.0), own, pins)
    bearing, pin, end = ("crank", "bearing"), ("crank", "pin"), ("rod", "right")
    at = ffr.Placement((CRANK, 0.0), 0.0, (0.0, CRANK * SPEED), -CRANK / ROD * SPEED)
    mechanism = ffr.Mechanism(
        placements={"crank": ffr.Placement(angular_velocity=SPEED), "rod": at},
        joints=[
            ffr.Revolute(bearing, ffr.Ground(), name="bearing"),
            ffr.PrescribedAngle(bearing, ffr.Motion.polynomial([0.0, SPEED]), name="drive"),
            ffr.Revolute(("rod", "left"), pin, name="pin"),
            ffr.PointOnLine(end, ffr.Ground(), name="guide"),
        ],
        point_masses=[ffr.PointMass(end, SLIDER)],
        start=start,
    )
    return ffr.simulate(mechanism, {"crank": crank, "rod": rod}, method)


def at_the_end(motion: ffr.dynamics.Trajectory) -> Array:
    """What is compared of the slider-crank with the beam, in the order of CRANK_SOLUTION."""
    own, place = motion.model.coordinates("rod"), motion.marker_path("rod", "right")[-1, 0]
    q, angle, v = motion.elastic("rod")[-1], motion.rigid("rod")[-1, 2], motion.v[-1]
    spin, bending = v[own.rotation], v[own.elastic]
    out = v[own.position][0] - (ROD + q[3]) * spin * np.sin(angle)
    slider = out + bending[3] * np.cos(angle)
    forces = [motion.joint_force(name)[-1].item() for name in ("guide", "drive")]
    return np.array([angle, place, *q, spin, slider, bending[0], *forces])


def bending_by_scipy(motion: ffr.dynamics.Trajectory, tolerance: float) -> Array:
    """The rod's elastic coordinates at the end by SciPy, from the same start, (4,)."""
    rod, own, y, v = beam(), motion.model.coordinates("rod"), motion.y[0], motion.v[0]
    flat = rod.extruded(SIDE, 0.5 * moments(rod.G, rod.N)[..., :2, :2])
    machine, turn = rows_of(flat, np.eye(3), plane=True), np.eye(3)
    turn[:2, :2] = rotation(y[own.rotation])
    state = [turn.ravel(), [0.0, 0.0, v[own.rotation], 1.0], y[own.elastic]]
    machine["start"] = np.concatenate([*state, [0.0], v[own.elastic], [0.0]])
    machine |= {"circle": CRANK * np.eye(3)[:2], "angle": np.array([0.0, SPEED])}
    machine |= {"times": np.array([0.0, CRANK_END]), "mass": np.float64(SLIDER)}
    return read_arrays.end_of(flat.by_key, machine, tolerance)[13:17]


def squeezer_scene() -> tuple[ffr.Mechanism, dict[str, ffr.VolumeIntegrals]]:
    """Andrews' squeezing mechanism: seven rigid links, a spring, and a constant moment."""
    rigid = ffr.VolumeIntegrals.rigid
    bodies = {
        name: rigid(mass, center, inertia, points)
        for name, (mass, inertia, center, points) in LINKS.items()
    }
    joints = [
        *(ffr.Revolute((a, pin), (b, pin), name=f"{a} {pin}") for a, b, pin in PINS),
        *(ffr.Revolute((a, pin), ffr.Ground(at), name=a) for a, (pin, at) in FRAME.items()),
    ]
    forces: list[ffr.mechanism.AppliedForce] = [
        ffr.Torque(("K1", "O"), TORQUE),
        ffr.SpringDamper(("K3", "D"), ffr.Ground(C), STIFFNESS, length=LENGTH),
    ]
    placements = {name: ffr.Placement(at, angle) for name, (at, angle) in poses().items()}
    return ffr.Mechanism(placements, joints, forces=forces), bodies


def poses() -> dict[str, tuple[tuple[float, float], float]]:
    """Where the links start: position of the origin [m] and angle [rad]."""
    beta, theta, gamma, phi, delta, omega, epsilon = ANGLES
    angles = [beta, beta + theta, gamma, phi + delta, delta, omega + epsilon, epsilon]
    turned = dict(zip(LINKS, angles, strict=True))
    found = {name: (at, turned[name]) for name, (_, at) in FRAME.items()}
    for name, by, pin in (PINS[0], *PINS[4:]):
        at, turn = found[by]
        x, y = np.add(at, rotation(turn) @ LINKS[by][3][pin])
        found[name] = ((float(x), float(y)), turned[name])
    return {name: found[name] for name in LINKS}


def rotation(angle: float) -> Array:
    """The matrix of a rotation, shape (2, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def relative(angles: ArrayLike) -> Array:
    """The seven angles of the test set from those of the links [rad], shape (..., 7)."""
    k = np.asarray(angles)
    shifts = np.stack([0 * k[..., 0], k[..., 0], 0 * k[..., 0], k[..., 4]], -1)
    return k - np.concatenate([shifts, shifts[..., :1], k[..., 6:], shifts[..., :1]], -1)


def squeezer_by_scipy(tolerance: float) -> Array:
    """The same seven angles at the end by SciPy, from the equations of the links' centres, (7,)."""
    masses, inertia, centers = (np.array([own[k] for own in LINKS.values()]) for k in range(3))
    number = {name: n for n, name in enumerate(LINKS)}
    arms = {
        name: {p: np.subtract(x, own[2]) for p, x in own[3].items()} for name, own in LINKS.items()
    }
    ends = [[(1, a, pin), (-1, b, pin)] for a, b, pin in PINS]
    ends += [[(1, a, pin)] for a, (pin, _) in FRAME.items()]
    mass = np.diag(np.concatenate([masses, masses, inertia]))
    quarter = rotation(0.5 * np.pi)

    def slopes(_: float, state: Array) -> Array:
        y, v = state[:21], state[21:]
        force, C_y, gamma = np.zeros(21), np.zeros((20, 21)), np.zeros(20)
        force[14] = TORQUE
        for row, sides in enumerate(ends):
            for sign, name, pin in sides:
                n, place = number[name], slice(2 * row, 2 * row + 2)
                arm = rotation(y[14 + n]) @ arms[name][pin]
                C_y[place, [n, 7 + n]] = C_y[place, [n, 7 + n]] + sign * np.eye(2)
                C_y[place, 14 + n] += sign * (quarter @ arm)
                gamma[place] += sign * arm * v[14 + n] ** 2
        arm = rotation(y[16]) @ arms["K3"]["D"]
        pull = np.subtract(C, y[[2, 9]] + arm)
        stretched = float(np.linalg.norm(pull))
        pull *= STIFFNESS * (1.0 - LENGTH / stretched)
        force[[2, 9]] += pull
        force[16] += (quarter @ arm) @ pull
        matrix = np.block([[mass, C_y.T], [C_y, np.zeros((20, 20))]])
        return np.concatenate([v, np.linalg.solve(matrix, np.concatenate([force, gamma]))[:21]])

    start = np.array(
        [[*np.add(at, rotation(a) @ centers[n]), a] for n, (at, a) in enumerate(poses().values())]
    )
    found = solve_ivp(
        *(slopes, (0.0, SQUEEZER_END), np.concatenate([start.T.ravel(), np.zeros(21)])),
        **{"method": "DOP853", "rtol": tolerance, "atol": 1e-2 * tolerance},
    )
    return relative(found.y[14:21, -1])


def lines_of(theirs: dict[str, float], ours: Array) -> list[dict[str, Any]]:
    """Lines of a table theirs/ours with all digits."""
    return [
        {"quantity_text": name, "theirs_text": f"{a:.12g}", "ours_text": f"{b:.12g}"}
        | {"error": abs(b - a), "relative": abs(b / a - 1.0)}
        for (name, a), b in zip(theirs.items(), ours, strict=True)
    ]


def slider_crank(
    comm: MPI.Comm, progress: Progress, *, steps: list[int], by_scipy: float
) -> dict[str, Any]:
    """The flexible slider-crank from the published arrays, by more and more steps."""
    start, theirs = ffr.Assembled({"rod": START}, {"rod": START_VELOCITY}), CRANK_SOLUTION
    errors, expected = [], np.array(list(theirs.values()))
    for n in steps:
        motion = turning(beam(), ffr.RadauIIA(CRANK_END, steps=n), start)
        ours = at_the_end(motion)
        bent = motion.elastic("rod")[-1]
        if not errors:
            again = bending_by_scipy(motion, by_scipy)
        errors.append([abs(ours[2] / expected[2] - 1.0), float(abs(bent[0] / again[0] - 1.0))])
        progress(len(errors) / len(steps))
    apart = float(np.abs(again / expected[2:6] - 1.0).max())
    shown = {"t": motion.t[::15].tolist(), "bent": motion.elastic("rod")[::15, 0].tolist()}
    shown |= {"apart": apart, "ours": float(np.abs(bent / again - 1.0).max())}
    return {"rows": lines_of(theirs, ours), "steps": steps, "errors": errors, **shown}


def squeezer(comm: MPI.Comm, progress: Progress, *, steps: list[int]) -> dict[str, Any]:
    """The squeezing mechanism by more and more steps, and by another integrator."""
    mechanism, bodies = squeezer_scene()
    expected, again = np.array(list(SQUEEZER_SOLUTION.values())), squeezer_by_scipy(3e-14)
    errors, every = [], []
    for n in steps:
        motion = ffr.simulate(mechanism, bodies, ffr.RadauIIA(SQUEEZER_END, steps=n))
        angles = relative(np.stack([motion.rigid(name)[:, 2] for name in bodies], -1))
        forces = [motion.joint_force(f"{name} E")[-1] for name in ("K3", "K4", "K6")]
        every.append(np.array([*angles[-1], *forces[0], forces[1][0], forces[2][0]]))
        errors.append([float(np.abs(every[-1][:7] - x).max()) for x in (expected[:7], again)])
        progress(len(errors) / len(steps))
    rows = lines_of(SQUEEZER_SOLUTION, every[-2])
    apart = float(np.abs(again - expected[:7]).max())
    shown = {"t": motion.t[::15].tolist(), "angles": angles[::15].tolist(), "apart": apart}
    return {"rows": rows, "steps": steps, "errors": errors, **shown}


def meshed_rod(
    comm: MPI.Comm, progress: Progress, *, meshes: list[list[int]], steps: int
) -> dict[str, Any]:
    """The deflection of the middle with the rod as a mesh, beside the beam's: straight at first."""
    method, start = ffr.RadauIIA(CRANK_END, steps=steps), ffr.Assembled()

    def row(name: str, rod: ffr.VolumeIntegrals) -> dict[str, Any]:
        motion = turning(rod, method, start)
        bent = motion.elastic("rod") @ rod.markers["middle"].displacement[1]
        squares = np.linalg.eigvals(np.linalg.solve(rod.G[1:, 1:], rod.K)).real
        first = float(np.sqrt(squares.min())) / (2 * np.pi)
        found = {"rod_text": name, "modes": rod.modes, "frequency": first}
        found |= {"deflection": 1e3 * float(np.abs(bent).max())}
        found |= {"rms": 1e3 * float(np.sqrt(trapezoid(bent**2, motion.t) / CRANK_END))}
        return {**found, "t": motion.t[::15].tolist(), "bent": bent[::15].tolist()}

    slight = "their arrays, inertia of stretching / 15"
    rows = [row("their arrays", beam()), row(slight, beam(1 / 15))]
    steel = ffr.PlaneStress(YOUNG, 0.3, DENSITY, SIDE)
    for elements in meshes:
        domain = ffr.Domain.rectangle(comm, ROD, SIDE, elements=tuple(elements), order=2)
        frame, middle = ffr.ChordFrame("left", "right"), {"middle": (0.5 * ROD, 0.0)}
        body = ffr.FlexibleBody(domain, steel, frame=frame, modes=4, markers=middle)
        name = f"a mesh of {' x '.join(map(str, elements))} elements"
        rows.append(row(name, body.reduce(np.ones(domain.n_cells)).integrals))
        progress((len(rows) - 1) / (len(meshes) + 1))
    return {"rows": rows}


def report_published(study: Study, results: Results) -> None:
    """Tables and picture."""
    crank, squeezed, meshed = (found for _, found in results)
    words = {"steps": f"{crank['steps'][-1]:,}", "apart": f"{crank['apart']:.1e}"}
    study.table("published_slider_crank", crank["rows"], ours=f"{crank['ours']:.1e}", **words)
    study.table("published_rod", meshed["rows"])
    apart = f"{squeezed['apart']:.2e}"
    ours, twice = (f"{errors[1]:.1e}" for errors in squeezed["errors"][-2:])
    words = {"steps": f"{squeezed['steps'][-2]:,}", "apart": apart, "ours": ours, "twice": twice}
    study.table("published_squeezer", squeezed["rows"], **words)
    caption = "Published solutions, marked by crosses, and what is computed here"
    low, ms = {"scales": "", "legend": "upper left"}, 1e3
    with study.picture(caption, 1, 3, (12.0, 3.6)) as (bending, angles, errors):
        beside = (meshed["rows"][-1], GRAY, 0.8, "as a mesh, straight at first")
        for found, color, width, label in ((crank, BLUE, 1.8, "from their arrays"), beside):
            t, bent = ms * np.array(found["t"]), 1e3 * np.array(found["bent"])
            bending.plot(t, bent, color=color, lw=width, label=label)
        theirs = CRANK_SOLUTION["first bending coordinate [m]"]
        bending.plot(ms * CRANK_END, 1e3 * theirs, "x", color=ORANGE, ms=9, mew=2)
        words = ("flexible slider-crank", "time [ms]", "deflection of the middle [mm]")
        plot(bending, *words, room=0.3, **low)
        t, turns = ms * np.array(squeezed["t"]), np.array(squeezed["angles"])
        for number, (name, end) in list(enumerate(SQUEEZER_SOLUTION.items()))[2:7]:
            (drawn,) = angles.plot(t, turns[:, number], label=name.partition(" ")[0])
            angles.plot(ms * SQUEEZER_END, end, "x", color=drawn.get_color(), ms=9, mew=2)
        plot(angles, "squeezing mechanism", "time [ms]", "angle [rad]", room=0.7, **low)
        looks = iter([(BLUE, "o-"), (GREEN, "v-"), (GRAY, "s-"), (ORANGE, "^-")])
        for what, found in (("slider-crank: bending", crank), ("squeezer: angles", squeezed)):
            for column, other in enumerate(("the published", "SciPy's")):
                color, mark = next(looks)
                pairs = zip(found["steps"], found["errors"], strict=True)
                rows = [{"n": n, "e": each[column]} for n, each in pairs]
                line(errors, rows, "n", "e", mark, color, label=f"{what}, to {other}")
        words = ("differences", "steps of Radau IIA", "relative; of angles [rad]")
        plot(errors, *words, room=0.45, legend="upper right")
