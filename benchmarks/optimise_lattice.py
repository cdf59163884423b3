"""Make the taps of the lattice method: places, weights and width for every elongation.

The lobe is a Gaussian of variances (s1^2, 1) in the plane; n taps at x_k, of weights w_k with sum 1
and one width tau, stand for it. Light of spectrum 1/|k| sees the difference as ::

    E = sum_r r |sum_k w_k tap(. - x_k) - lobe|_r^2 / sum_r r |lobe|_r^2                  (1)

|.|_r blurred by a Gaussian of width r = 1/4, 1/2, ..., 16. A tap is what a trilinear lookup makes
of a width asked for: a mixture of Gaussians of two neighbouring levels (``glossy.lattice.shade``,
eq. 5), at three places between levels, and 15 % narrower or 18 % wider than asked for, since texels
are no Gaussians. Minimised is the mean of sqrt(E) over elongations 1 ... 16 (13, even in their
logarithm), over polynomials of degree 4 in log2(s1)/4 for the places of half of the taps (the
others mirror them), the logarithms of the weights and of tau. Starts: a hexagonal lattice about the
pole, followed upwards from round lobes, and rows, followed downwards from long ones; the best wins.

No environment map and no random number has a part in this. Tables for all counts take about an hour
of one core; digits beyond 1e-4 depend on the machine's libraries.
"""

import argparse
import math
import pathlib
import sys
import time

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

Array = npt.NDArray[np.float64]

DEGREE = 4
OCTAVES = np.linspace(0.0, 4.0, 13)
BASIS = np.vander(OCTAVES / 4.0, DEGREE + 1, increasing=True)
BLURS = 2.0 ** np.arange(-2.0, 4.1, 1.0)
BETWEEN = (1.0, 1.6, 2.5)  # variance asked for, over that of the level below
AMISS = (0.85, 1.18)  # width that comes, over the width asked for
FLOOR = 1e-6  # of E: below it nothing is to be gained
COUNTS = (*range(1, 33), 40, 48, 64)


def fraction(u: float) -> float:
    """Share of the coarser level for variance u over the finer level's."""
    return (0.3 - 3.0 / ((u + 4.0) * (u + 1.0))) / 0.225


def mixtures() -> tuple[Array, Array, Array, Array]:
    """Shares and variances (of tau^2 = 1) of one tap, averaged over cases, and of pairs of taps."""
    pairs: dict[float, float] = {}
    single: list[tuple[float, float]] = []
    cases = [(u, amiss) for u in BETWEEN for amiss in AMISS]
    for u, amiss in cases:
        parts = [(1.0 - fraction(u), amiss**2 / u), (fraction(u), 4.0 * amiss**2 / u)]
        single += [(share / len(cases), v) for share, v in parts]
        for a, va in parts:
            for b, vb in parts:
                key = round(va + vb, 12)
                pairs[key] = pairs.get(key, 0.0) + a * b / len(cases)
    s = np.array(single)
    return np.array(list(pairs.values())), np.array(list(pairs)), s[:, 0], s[:, 1]


PAIR_SHARE, PAIR_VARIANCE, SHARE, VARIANCE = mixtures()


def misfit(x: Array, w: Array, tau2: float, s1: float) -> tuple[float, Array, Array, float]:
    """E of eq. (1) and its derivatives by x (n, 2), w (n,) and tau^2."""
    blur = BLURS**2
    v = (PAIR_VARIANCE[:, None] * tau2 + blur).ravel()
    scale, rate = (PAIR_SHARE[:, None] * BLURS).ravel(), np.repeat(PAIR_VARIANCE, len(blur))
    d = x[:, None] - x[None]
    r2 = (d**2).sum(-1)[..., None]
    g = np.exp(-0.5 * r2 / v) * (scale / v)
    overlap, slope = g.sum(-1), (g / v).sum(-1)
    by_tau = (g * (r2 / (2.0 * v * v) - 1.0 / v) * rate).sum(-1)
    e = float(w @ overlap @ w)
    dw = 2.0 * overlap @ w
    dx = -2.0 * w[:, None] * ((slope * w)[..., None] * d).sum(1)
    dt = float(w @ by_tau @ w)

    u = (VARIANCE[:, None] * tau2 + blur).ravel()
    scale, rate = (SHARE[:, None] * BLURS).ravel(), np.repeat(VARIANCE, len(blur))
    a, b = s1 * s1 + u, 1.0 + u
    first, second = x[:, :1] ** 2, x[:, 1:] ** 2
    h = np.exp(-0.5 * (first / a + second / b)) * (scale / np.sqrt(a * b))
    e -= 2.0 * float(w @ h.sum(-1))
    dw -= 2.0 * h.sum(-1)
    pull = np.stack([(h / a).sum(-1) * x[:, 0], (h / b).sum(-1) * x[:, 1]], axis=-1)
    dx += 2.0 * w[:, None] * pull
    spread = 0.5 * (first / a**2 + second / b**2) - 0.5 / a - 0.5 / b
    dt -= 2.0 * float(w @ (h * spread * rate).sum(-1))

    own = float((BLURS / np.sqrt((2.0 * s1 * s1 + blur) * (2.0 + blur))).sum())
    return (e + own) / own, dx / own, dw / own, dt / own


def at_one(p: Array, n: int, s1: float) -> tuple[float, Array]:
    """sqrt(E + FLOOR) and its gradient for parameters (log weights, places, log2 tau)."""
    half, odd = n // 2, n % 2
    logs, z, log_tau = p[: half + odd], p[half + odd : -1].reshape(half, 2), p[-1]
    every = np.concatenate([logs[odd:], logs[odd:], logs[:odd]])
    w = np.exp(every - every.max())
    w /= w.sum()
    stretch = np.array([s1, 1.0])
    x = np.concatenate([z, -z, np.zeros((odd, 2))]) * stretch
    tau2 = 4.0**log_tau
    e, dx, dw, dt = misfit(x, w, tau2, s1)
    dlog = w * (dw - w @ dw)
    to_logs = np.concatenate([dlog[2 * half :], dlog[:half] + dlog[half : 2 * half]])
    to_z = (dx[:half] - dx[half : 2 * half]) * stretch
    gradient = np.concatenate([to_logs, to_z.ravel(), [dt * tau2 * math.log(4.0)]])
    root = math.sqrt(max(e, 0.0) + FLOOR)
    return root, gradient * 0.5 / root


def at_all(q: Array, n: int) -> tuple[float, Array]:
    """Mean over the elongations for the coefficients of the polynomials, and its gradient."""
    p = BASIS @ q.reshape(DEGREE + 1, -1)
    parts = [at_one(p[j], n, 2.0**t) for j, t in enumerate(OCTAVES)]
    gradient = BASIS.T @ np.array([g for _, g in parts])
    return sum(f for f, _ in parts) / len(parts), gradient.ravel() / len(parts)


def starts(n: int) -> list[tuple[bool, Array]]:
    """(from round lobes upwards?, parameters)."""
    half, odd = n // 2, n % 2
    j, i = np.mgrid[-9:10, -12:13]
    lattice = np.stack([i + 0.5 * (j % 2), j * math.sqrt(0.75)], axis=-1).reshape(-1, 2)
    found = []
    for phase in [(0.0, 0.0)] if odd else [(0.5, 0.0), (0.25, math.sqrt(3.0) / 4.0)]:
        for turn in (0.0, 0.5 * math.pi):
            c, s = math.cos(turn), math.sin(turn)
            g = (lattice + phase) @ np.array([[c, s], [-s, c]])
            right = (g[:, 0] > 1e-9) | ((np.abs(g[:, 0]) < 1e-9) & (g[:, 1] > 1e-9))
            g = g[right]
            a = 2.0 * math.sqrt(3.63 / n)
            z = g[np.argsort((g**2).sum(1), kind="stable")][:half] * a
            logs = np.concatenate([np.zeros(odd), -0.8 * (z**2).sum(1)])
            found.append((True, np.concatenate([logs, z.ravel(), [math.log2(0.55 * a)]])))
    k = np.arange(half) + (1.0 if odd else 0.5)
    for zigzag in (0.0, 0.4, 0.8):
        z = np.stack([k * 3.6 / n, zigzag * (-1.0) ** np.arange(half)], axis=-1)
        logs = np.concatenate([np.zeros(odd), -0.5 * z[:, 0] ** 2])
        found.append((False, np.concatenate([logs, z.ravel(), [0.0]])))
    return found


def descend(function: object, start: Array, arguments: tuple[float, ...], steps: int) -> Array:
    """The point that L-BFGS reaches."""
    options = {"maxiter": steps}
    done = minimize(function, start, arguments, jac=True, method="L-BFGS-B", options=options)
    return np.asarray(done.x)


def solve(n: int) -> Array:
    """Coefficients (DEGREE + 1, parameters) for n taps."""
    best: tuple[float, Array] | None = None
    for upwards, p in starts(n):
        path = np.empty((len(OCTAVES), len(p)))
        order = range(len(OCTAVES)) if upwards else range(len(OCTAVES) - 1, -1, -1)
        for turn, j in enumerate(order):
            p = descend(at_one, p, (n, 2.0 ** OCTAVES[j]), 120 if turn else 400)
            path[j] = p
        fitted = np.asarray(np.linalg.lstsq(BASIS, path, rcond=None)[0])
        q = descend(at_all, fitted.ravel(), (n,), 120)
        value = at_all(q, n)[0]
        if best is None or value < best[0]:
            best = value, q
    assert best is not None
    return descend(at_all, best[1], (n,), 400).reshape(DEGREE + 1, -1)


def main(arguments: list[str] | None = None) -> int:
    raw = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS, metavar="N")
    parser.add_argument("-o", "--output", default="taps.npz", help="tables; others in it are kept")
    args = parser.parse_args(arguments)
    target = pathlib.Path(args.output)
    tables: dict[str, Array] = {}
    if target.exists():
        with np.load(target) as stored:
            tables = {name: stored[name] for name in stored.files}
    for n in args.counts:
        begin = time.perf_counter()
        q = solve(n)
        p = BASIS @ q
        errors = [at_one(p[j], n, 2.0**t)[0] for j, t in enumerate(OCTAVES)]
        text = " ".join(f"{e:.3f}" for e in errors[::3])
        print(f"n = {n:2d}: error {text} at 1, 2, 4, 8, 16; {time.perf_counter() - begin:.0f} s")
        tables[f"n{n}"] = q
        scratch = target.with_suffix(".part.npz")
        with scratch.open("wb") as stream:
            np.savez(stream, allow_pickle=False, **dict(sorted(tables.items())))
        scratch.replace(target)
    return 0


if __name__ == "__main__":
    sys.exit(main())
