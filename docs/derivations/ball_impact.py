"""A soft ball meets a rigid plane without friction or weight, by finite elements: what two balls that meet head-on (chart
`spheres` of docs/precision.md), each the other's mirror image, and case 22 of docs/validation.md are held against.

Axially symmetric, total Lagrangian: four-node elements with 2 x 2 points, lumped masses, explicit central differences.
A node that would pass the plane within a step is put on it. Twice: with elements half as large the second time.

    pip install numpy
    python docs/derivations/ball_impact.py > docs/derivations/ball_impact.txt
"""

import numpy as np

RADIUS, DENSITY, NU = 0.1, 1000.0, 0.3


def mesh(n):
    """Places and elements of a half disc: a block of n by 2 n elements in the middle and n rings around it."""
    middle = 0.5
    # Denser towards the pole that touches.
    across = np.linspace(0, 1, n + 1) ** 1.3
    along = np.linspace(-1, 1, 2 * n + 1)
    u, v = np.meshgrid(middle * across, middle * along, indexing="ij")
    x = [np.stack([u, v], -1).reshape(-1, 2)]
    k = np.arange((n + 1) * (2 * n + 1)).reshape(n + 1, 2 * n + 1)
    quads = [np.stack([k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]], -1).reshape(-1, 4)]
    # Around the block from the lower end of the axis to the upper one.
    ring = np.r_[k[:, 0], k[-1, 1:], k[-2::-1, -1]]
    inner = x[0][ring]
    angle = np.pi / 4 * np.r_[across - 2, along[1:], 2 - across[-2::-1]]
    outer = np.stack([np.cos(angle), np.sin(angle)], -1)
    count = len(x[0])
    for layer in range(1, n + 1):
        share = 1 - (1 - layer / n) ** 1.3
        x.append((1 - share) * inner + share * outer)
        following = count + np.arange(len(ring))
        quads.append(np.stack([ring[:-1], following[:-1], following[1:], ring[1:]], -1))
        count, ring = count + len(ring), following
    x = np.concatenate(x)
    x[np.abs(x[:, 0]) < 1e-12, 0] = 0
    return RADIUS * x, np.concatenate(quads)


def stress(law, f, hoop, lam, mu):
    """First Piola-Kirchhoff stress in the plane and around, and energy density."""
    a, b, c, d = f[..., 0, 0], f[..., 0, 1], f[..., 1, 0], f[..., 1, 1]
    plane = a * d - b * c
    j = plane * hoop
    cofactor = np.stack([np.stack([d, -c], -1), np.stack([-b, a], -1)], -2)
    if law == "neo_hookean":
        log = np.log(j)
        factor = (lam * log - mu) / plane
        p = mu * f + factor[..., None, None] * cofactor
        around = mu * hoop + (lam * log - mu) / hoop
        first = (f * f).sum((-1, -2)) + hoop * hoop
        energy = mu / 2 * (first - 3) - mu * log + lam / 2 * log * log
    else:
        # Rotation of the polar decomposition in the plane.
        x, y = a + d, c - b
        size = np.hypot(x, y)
        x, y = x / size, y / size
        turn = np.stack([np.stack([x, -y], -1), np.stack([y, x], -1)], -2)
        factor = lam * (j - 1) * hoop
        p = 2 * mu * (f - turn) + factor[..., None, None] * cofactor
        around = 2 * mu * (hoop - 1) + lam * (j - 1) * plane
        energy = mu * (((f - turn) ** 2).sum((-1, -2)) + (hoop - 1) ** 2) + lam / 2 * (j - 1) ** 2
    return p, around, energy


class Ball:
    def __init__(self, n, law, young):
        self.law = law
        self.mu = young / (2 * (1 + NU))
        self.lam = young * NU / ((1 + NU) * (1 - 2 * NU))
        self.x0, self.quads = mesh(n)
        g = 1 / np.sqrt(3)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        shapes, gradients, weights, radii = [], [], [], []
        place = self.x0[self.quads]
        for point in corners * g:
            shape = np.prod(1 + corners * point, axis=1) / 4
            local = np.stack([corners[:, 0] * (1 + corners[:, 1] * point[1]),
                              corners[:, 1] * (1 + corners[:, 0] * point[0])], -1) / 4
            jacobian = np.einsum("eka,kb->eab", place, local)
            gradients.append(np.einsum("kb,eba->eka", local, np.linalg.inv(jacobian)))
            radius = place[:, :, 0] @ shape
            radii.append(radius)
            shapes.append(shape)
            weights.append(2 * np.pi * radius * np.linalg.det(jacobian))
        self.shape = np.array(shapes)
        self.gradient = np.stack(gradients, 1)
        self.weight = np.stack(weights, 1)
        self.radius = np.stack(radii, 1)
        share = DENSITY * np.einsum("eg,gk->ek", self.weight, self.shape)
        self.mass = np.bincount(self.quads.ravel(), share.ravel(), len(self.x0))
        edges = place - np.roll(place, 1, axis=1)
        shortest = np.sqrt((edges ** 2).sum(-1)).min()
        self.dt = 0.8 * shortest / np.sqrt((self.lam + 2 * self.mu) / DENSITY)

    def force(self, x):
        place = x[self.quads]
        f = np.einsum("eka,egkb->egab", place, self.gradient, optimize=True)
        hoop = place[:, :, 0] @ self.shape.T / self.radius
        p, around, energy = stress(self.law, f, hoop, self.lam, self.mu)
        p *= self.weight[..., None, None]
        pull = np.einsum("egab,egkb->eka", p, self.gradient, optimize=True)
        pull[:, :, 0] += (around * self.weight / self.radius) @ self.shape
        count = len(x)
        ids = self.quads.ravel()
        force = np.stack([-np.bincount(ids, pull[:, :, a].ravel(), count) for a in range(2)], -1)
        return force, (energy * self.weight).sum()

    def meet(self, speed, height, duration):
        """Time, height and velocity of the centre of mass, energy; from `height` above the plane at `speed`."""
        x = self.x0 + [0, height]
        v = np.zeros_like(x)
        v[:, 1] = -speed
        axis = self.x0[:, 0] == 0
        total = self.mass.sum()
        rows = []
        steps = int(np.ceil(duration / self.dt))
        dt = duration / steps
        for n in range(steps + 1):
            force, elastic = self.force(x)
            v += dt * (0.5 if n == 0 else 1.0) * force / self.mass[:, None]
            v[axis, 0] = 0
            deep = x[:, 1] + dt * v[:, 1] < 0
            v[deep, 1] = -x[deep, 1] / dt
            kinetic = 0.5 * (self.mass[:, None] * v * v).sum()
            # Velocities belong to the middle of the step to come.
            rows.append([n * dt, self.mass @ x[:, 1] / total, (n + 0.5) * dt, self.mass @ v[:, 1] / total, kinetic + elastic])
            x += dt * v
        return np.array(rows)


def passes(t, values, level):
    k = np.flatnonzero((values[:-1] < level) & (values[1:] >= level))[0]
    return t[k] + (level - values[k]) / (values[k + 1] - values[k]) * (t[k + 1] - t[k])


def hertz(speed, young):
    """Approach and contact time."""
    modulus = young / (1 - NU * NU)
    mass = 4 / 3 * np.pi * RADIUS ** 3 * DENSITY
    approach = (15 * mass * speed ** 2 / (16 * np.sqrt(RADIUS) * modulus)) ** 0.4
    return approach, 2.9432 * approach / speed


# Share of the contact time in which Hertz's velocity goes from -0.99 to 0.99 of the speed: 2.5248 / 2.9432.
STEEP = 2.5248 / 2.9432


def main():
    print("two balls, neo-Hookean, E = 30 kPa, 0.25 m/s each, 0.015 m from the plane between them at first")
    for n in (20, 40):
        rows = Ball(n, "neo_hookean", 3e4).meet(0.25, RADIUS + 0.015, 0.35)
        t, y, half, v, energy = rows.T
        print(f"# elements along the radius {n}: least height {y.min():.6f} m, turns at {passes(half, v, 0):.5f} s, "
              f"speed kept {v[-1] / 0.25:.5f}, energy lost {1 - energy[-1] / energy[0]:.5f}")
    print("time [s], height of the centre of mass over the plane [m]")
    for k in range(22):
        print(f"{k / 60:.6f}, {np.interp(k / 60, t, y):.7f}")
    print("case 22, fixed corotated, E = 100 kPa: speed [m/s], elements, contact time and approach over Hertz's, speed kept")
    for speed, n in [(0.1251, 20), (0.1251, 40), (0.1251 / 4, 40), (0.1251 / 16, 40)]:
        approach, time = hertz(speed, 1e5)
        rows = Ball(n, "fixed_corotated", 1e5).meet(speed, RADIUS + 0.1 * approach, 1.4 * time)
        t, y, half, v, energy = rows.T
        away = v[-1]
        lasted = (passes(half, v, 0.99 * away) - passes(half, v, -0.99 * speed)) / STEEP
        print(f"{speed:.6f}, {n}, {lasted / time:.4f}, {(RADIUS - y.min()) / approach:.4f}, {away / speed:.5f}", flush=True)


if __name__ == "__main__":
    main()
