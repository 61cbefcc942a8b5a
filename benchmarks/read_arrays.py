# SPDX-License-Identifier: MIT
"""psi of a slider-crank by NumPy and SciPy alone, from ROD.npz MACHINE.npz [TOLERANCE]."""

import sys

import numpy as np
from scipy.integrate import solve_ivp

CROSS = np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(
    2, 0, 1
)  # (a x b)_i = C_ijk a_j b_k


def end_of(rod, machine, rtol):
    """The state at the end: the rod's rotation A, its spin w, h = (1, q), h', int q^T K q dt."""
    n, K, rows = len(rod["S"]), np.pad(rod["K"], (1, 0)), machine["rows"]
    times, start, m, H = (machine[key] for key in ("times", "start", "mass", "slider"))
    S, P = rod["S"] + m * H.T, rod["P"] + m * np.einsum("ka,lb->abkl", H, H)
    turn = [np.polynomial.Polynomial(machine["angle"]).deriv(k) for k in range(3)]

    def rate(t, y):
        A, w, h, hv = y[:9].reshape(3, 3), y[9:12], y[12 : 12 + n], y[12 + n : 12 + 2 * n]
        pin = (1j * turn[2](t) - turn[1](t) ** 2) * np.exp(1j * turn[0](t))  # acceleration
        f, W = A.T @ machine["circle"].T @ [pin.real, pin.imag], np.einsum("ijk,j->ik", CROSS, w)
        X, Y = np.tensordot([h, hv], P, 1)
        Q, Z, WW = np.tensordot(h, X, 1), np.tensordot(h, Y, 1), W @ W
        force = np.einsum("kl,alk->a", WW, X) + 2 * np.einsum("kl,alk->a", W, Y) + S @ f + K @ h
        moment = np.einsum("ijk,kj->i", CROSS, np.outer(f, h @ S) + WW @ Q + 2 * W @ Z)
        arm = np.einsum("ijk,ajk->ia", CROSS, X[1:])
        M = np.block([[np.trace(Q) * np.eye(3) - Q, arm], [arm.T, P[1:, 1:].trace(0, 2, 3)]])
        D, c, cv = machine["directions"] @ A, rows @ h, rows @ hv
        C = np.hstack([np.cross(c, D), np.einsum("rk,rkj->rj", D, rows[:, :, 1:])])
        gamma = np.sum(D * (c @ WW.T + 2 * cv @ W.T + np.outer(machine["pinned"], f)), 1)
        matrix = np.block([[M, C.T], [C, np.zeros((len(C), len(C)))]])
        a = np.linalg.solve(matrix, -np.concatenate([moment, force[1:], gamma]))[: 2 + n]
        return np.concatenate([(A @ W).ravel(), a[:3], hv, [0.0], a[3:], [h @ K @ h]])

    return solve_ivp(rate, times, start, "DOP853", rtol=rtol, atol=1e-5 * rtol).y[:, -1]


if __name__ == "__main__":
    rod, machine = (dict(np.load(path)) for path in sys.argv[1:3])
    rtol = float((sys.argv[3:] or ["1e-8"])[0])
    print(f"psi {end_of(rod, machine, rtol)[-1]:.12g}, given {machine['psi']:.12g}")
    for key in "SPK":
        u = 1.0 + 0.5 * np.sin(np.arange(len(rod[key])))  # a share of each entry
        step = (rod[key].T * (u if key == "S" else np.outer(u, u))).T
        ends = (end_of({**rod, key: rod[key] + d * step}, machine, rtol) for d in (1e-4, -1e-4))
        slope, given = np.subtract(*ends)[-1] / 2e-4, np.sum(step * machine[f"by_{key}"])
        print(f"by {key} {slope:.8g}, given {given:.8g}")
