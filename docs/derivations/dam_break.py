"""Front of a collapsing column of an ideal fluid, by potential flow: what case 14 of docs/validation.md is held against.

A column of width a = 1 and height 2, gravity 1, released at time 0 with no friction anywhere. The potential phi obeys
Laplace's equation in the fluid; on the free surface D phi / Dt = |grad phi|^2 / 2 - y and particles move with grad phi.
Wall and floor are planes of symmetry, so that only the surface from the top of the wall to the toe carries unknowns:
Green's identity with ln r and its three mirror images, linear elements, collocation at nodes, midpoint rule in time,
points spread evenly along the surface again after every step. That smooths: area is lost, and printed. It goes on until the
toe gets thinner than an element, with 120 points at T = 1.3.

    pip install numpy
    python docs/derivations/dam_break.py > docs/derivations/dam_break.txt
"""

import numpy as np

ABSCISSAE, WEIGHTS = np.polynomial.legendre.leggauss(8)
TIMES = [0.849, 1.212, 1.602]  # t sqrt(2 g / a), as in the experiment


def along(points):
    return np.r_[0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]


def respread(points, phi, power):
    """The same surface with points at other places: evenly for power 1, denser towards the toe above."""
    s = along(points)
    h = np.diff(s)
    at = s[-1] * (1 - (1 - np.linspace(0, 1, len(points))) ** power)
    cell = np.clip(np.searchsorted(s, at) - 1, 0, len(h) - 1)
    u = (at - s[cell]) / h[cell]

    def hermite(f):
        m = np.diff(f) / h
        d = np.r_[m[0], (m[1:] * h[:-1] + m[:-1] * h[1:]) / (h[1:] + h[:-1]), m[-1]]
        value = f[cell] * (1 + 2 * u) * (1 - u) ** 2 + f[cell + 1] * u * u * (3 - 2 * u)
        slope = d[cell] * u * (1 - u) ** 2 + d[cell + 1] * u * u * (u - 1)
        return value + h[cell] * slope

    return np.c_[hermite(points[:, 0]), hermite(points[:, 1])], hermite(phi)


def smooth(f):
    inner = (-f[:-4] + 4 * f[1:-3] + 10 * f[2:-2] + 4 * f[3:-1] - f[4:]) / 16
    return np.r_[f[:2], inner, f[-2:]]


def velocity(points, phi):
    n = len(points)
    step = np.diff(points, axis=0)
    length = np.hypot(*step.T)
    outward = np.c_[-step[:, 1], step[:, 0]] / length[:, None]
    single, double = np.zeros((n, n)), np.zeros((n, n))
    i = np.arange(n - 1)
    for mirror in ([1, 1], [1, -1], [-1, 1], [-1, -1]):
        first, along_it, normal = (x * mirror for x in (points[:-1], step, outward))
        for x, w in zip(0.5 * (1 + ABSCISSAE), 0.5 * WEIGHTS):
            r = (first + x * along_it)[None] - points[:, None]
            square = (r**2).sum(2)
            g = 0.5 * np.log(square) * length * w
            h = (r * normal).sum(2) / square * length * w
            # Elements that end in the node, or their mirror images on the planes of symmetry, are added below.
            for part in (g, h):
                if mirror == [1, 1]:
                    part[i, i] = part[i + 1, i] = 0
                elif mirror == [1, -1]:
                    part[n - 1, n - 2] = 0
                elif mirror == [-1, 1]:
                    part[0, 0] = 0
            for to, part in ((single, g), (double, h)):
                to[:, :-1] += part * (1 - x)
                to[:, 1:] += part * x
    near = length * (np.log(length) / 2 - 3 / 4)
    far = length * (np.log(length) / 2 - 1 / 4)
    for a, b in ((i, i + 1), (i + 1, i)):
        np.add.at(single, (a, a), near)
        np.add.at(single, (a, b), far)
    single[-1, -1] += near[-1]
    single[-1, -2] += far[-1]
    single[0, 0] += near[0]
    single[0, 1] += far[0]
    # A constant potential has no flux: that gives the angle at every node.
    flux = np.linalg.solve(single, double @ phi - double.sum(1) * phi)

    def derivative(f, mirror):
        whole = np.concatenate([f[1:2] * mirror[0], f, f[-2:-1] * mirror[1]])
        s = np.r_[length[0], length, length[-1]]
        before, after = s[:-1], s[1:]
        rise = np.diff(whole)
        return (rise[1:] / after * before + rise[:-1] / before * after) / (before + after)

    x = derivative(points[:, 0], [-1, 1])
    y = derivative(points[:, 1], [1, -1])
    tangent = np.c_[x, y] / np.hypot(x, y)[:, None]
    normal = np.c_[-tangent[:, 1], tangent[:, 0]]
    v = tangent * derivative(phi, [1, 1])[:, None] + normal * flux[:, None]
    v[0, 0] = v[-1, 1] = 0
    return v


def collapse(count, power, dt):
    top = np.c_[np.linspace(0, 1, 400), np.full(400, 2.0)]
    side = np.c_[np.ones(800), np.linspace(2, 0, 800)]
    points = np.vstack([top, side[1:]])
    u = 1 - (1 - np.linspace(0, 1, count)) ** power
    s = along(points)
    points = np.c_[np.interp(u * s[-1], s, points[:, 0]), np.interp(u * s[-1], s, points[:, 1])]
    phi, time, fronts = np.zeros(count), 0.0, [(0.0, 1.0)]
    rate = lambda v, x: 0.5 * (v**2).sum(1) - x[:, 1]
    while fronts[-1][0] < TIMES[-1]:
        v = velocity(points, phi)
        middle, phi_middle = points + 0.5 * dt * v, phi + 0.5 * dt * rate(v, points)
        v = velocity(middle, phi_middle)
        points, phi, time = points + dt * v, phi + dt * rate(v, middle), time + dt
        points, phi = np.c_[smooth(points[:, 0]), smooth(points[:, 1])], smooth(phi)
        points, phi = respread(points, phi, power)
        points[0, 0] = points[-1, 1] = 0
        fronts.append((time * 2**0.5, points[-1, 0]))
    area = abs(np.trapezoid(points[:, 1], points[:, 0]))
    found = np.interp(TIMES, *np.array(fronts).T)
    print(f"{count} points, power {power}, dt {dt}: fronts", *(f"{x:.3f}" for x in found), f"area left {area / 2:.4f}")


print("T =", *TIMES)
for case in [(40, 1.0, 0.01), (60, 0.8, 0.005), (60, 1.0, 0.005), (80, 0.9, 0.0025), (80, 1.0, 0.0025)]:
    collapse(*case)
