# SPDX-License-Identifier: MIT
"""A machine with many kinds of parts, from densities to the objective and back."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest

import dolfinx_ffr as ffr
from dolfinx_ffr.verification import assert_taylor_order, taylor_test


def loading_arm(comm: MPI.Intracomm, stiffening: tuple[str, ...] = ()) -> ffr.Problem:
    """Arm that hangs in an elastic bearing, with a cylinder, a carriage and a geared wheel."""
    arm = ffr.FlexibleBody(
        ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(24, 4)),
        ffr.PlaneStress(2e9, 0.3, 1000.0, 0.01),
        frame=ffr.ChordFrame("left", "right"),
        modes=4,
        markers={"middle": (0.2, 0.003), "edge": (0.3, 0.02)},
        stiffening=stiffening,
    )
    ends = {"left": (-0.05, 0.0), "right": (0.05, 0.0)}
    bodies = {
        "arm": arm,
        "carriage": ffr.VolumeIntegrals.rigid(0.2, (0.01, 0.0), 1e-4, ends),
        "wheel": ffr.VolumeIntegrals.rigid(0.1, (0.0, 0.0), 5e-5, ends),
    }
    stroke = ffr.Motion.smooth_step(0.02, 0.05)
    rest = 0.25
    mechanism = ffr.Mechanism(
        placements={
            "arm": ffr.Placement((0.0, 0.0)),
            "carriage": ffr.Placement((0.25, 0.003)),
            "wheel": ffr.Placement((0.45, 0.1)),
        },
        joints=[
            ffr.Translational(("carriage", "left"), ("arm", "middle"), (1.0, 0.0), name="rails"),
            ffr.Distance(("carriage", "right"), ("arm", "right"), name="strut"),
            ffr.Revolute(("wheel", "left"), ffr.Ground((0.4, 0.1)), name="axle"),
            ffr.Gear(("wheel", "right"), ("arm", "edge"), -2.0, name="gear"),
            ffr.Distance(
                ("arm", "edge"),
                ffr.Ground((0.3, 0.02 + rest)),
                ffr.Motion(
                    lambda t: rest - stroke.value(t),
                    lambda t: -np.asarray(stroke.velocity(t)),
                    lambda t: -np.asarray(stroke.acceleration(t)),
                ),
                name="cylinder",
            ),
        ],
        forces=[
            ffr.SpringDamper(("arm", "left"), ffr.Ground(), 5e3, 5.0, length=0.0, name="bearing"),
            ffr.SpringDamper(("arm", "edge"), ffr.Ground((0.5, -0.2)), 200.0, 1.0),
            ffr.TorsionalSpringDamper(("arm", "middle"), ("wheel", "right"), 0.5, 0.01),
            ffr.Force(("arm", "edge"), 1.0, lambda t: 5.0 * np.sin(60.0 * t), follower=True),
            ffr.Torque(("arm", "middle"), lambda t: 0.1 * np.cos(40.0 * t)),
        ],
        gravity=(0.0, -9.81),
        ground_acceleration=(lambda t: 5.0 * np.sin(30.0 * t), 0.0),
        damping={"arm": ffr.RayleighDamping(1.0, 1e-5)},
        start=ffr.StaticEquilibrium(),
    )
    return ffr.Problem(bodies, mechanism, ffr.GeneralizedAlpha(0.1, 100), ffr.IntegralCompliance())


@pytest.mark.mpi
@pytest.mark.parametrize("stiffening", [(), ("omega2", "acceleration")])
def test_gradient(comm: MPI.Intracomm, stiffening: tuple[str, ...]) -> None:
    problem = loading_arm(comm, stiffening)
    c = problem.flexible["arm"].domain.centroids
    density = 0.7 + 0.2 * np.sin(50 * c[:, 0] + 90 * c[:, 1])
    direction = np.cos(80 * c[:, 0] + 200 * c[:, 1])
    gradient = problem.gradient(density).gradient
    assert gradient is not None

    def slope(d: np.ndarray) -> float:
        return comm.allreduce(float(gradient["arm"] @ d))

    result = taylor_test(
        lambda x: problem.value(x).psi,
        slope,
        density,
        direction,
        steps=[2e-2 / 2**k for k in range(4)],
        roundoff=1e-12,
    )
    assert_taylor_order(result)


def test_it_starts_in_equilibrium(comm: MPI.Intracomm) -> None:
    problem = loading_arm(comm)
    n_cells = problem.flexible["arm"].domain.n_cells
    t = problem.value(np.ones(n_cells)).trajectory
    assert t is not None
    np.testing.assert_array_equal(t.v[0], 0.0)
    # Gravity, springs, forces and joints balance, and the stroke begins without a jerk.
    assert np.max(np.abs(t.w[0])) < 1e-6
    assert np.max(np.abs(t.elastic("arm")[0])) > 1e-7
