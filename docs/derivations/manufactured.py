"""Body forces of the manufactured solutions, derived from nothing but the motion and the material.

    pip install sympy
    python docs/derivations/manufactured.py > docs/derivations/manufactured.txt

A motion x(X, t) is chosen; F = dx/dX, the first Piola-Kirchhoff stress of the neo-Hookean law in docs/model.md is
P = tau F^-T with tau = mu (F F^T - 1) + lambda ln J 1, and momentum balance at rest, rho0 x'' = Div P + rho0 b, gives
the force per mass b that makes the motion exact. The forms printed by other codes are then checked against it, and the
formulas are printed as scene files spell them.
"""

import mpmath
import sympy as sp

X, Y, Z, t = sp.symbols("X Y Z t", real=True)
rho, lam, mu, A, c = sp.symbols("rho lambda mu A c", positive=True)
REST = sp.Matrix([X, Y, Z])


def body_force(motion):
    """b(X, t) of a motion, and its deformation gradient."""
    f = motion.jacobian(REST)
    j = f.det()
    back = f.inv().T
    stress = mu * (f - back) + lam * sp.log(j) * back
    div = sp.Matrix([sum(sp.diff(stress[i, k], REST[k]) for k in range(3)) for i in range(3)])
    return motion.diff(t, 2) - div / rho, f


def vanishes(expression, values, points):
    """Largest magnitude of an expression at some points, computed with 40 digits."""
    with_numbers = sp.sympify(expression).subs(values)
    value = sp.lambdify((X, Y, Z, t), with_numbers, modules="mpmath")
    with mpmath.workdps(40):
        exact = [[mpmath.mpf(point[v].p) / point[v].q for v in (X, Y, Z, t)] for point in points]
        return max(abs(value(*point)) for point in exact)


def places(n):
    """Points inside the cube (or the ring) and moments, the same in every run."""
    rationals = [sp.Rational(k, 37) for k in (3, 11, 17, 23, 31, 7, 29, 13)]
    return [
        {
            X: rationals[i % 8],
            Y: rationals[(3 * i + 1) % 8],
            Z: rationals[(5 * i + 2) % 8],
            t: rationals[(i + 4) % 8] / 50,
        }
        for i in range(n)
    ]


print("AXIS-ALIGNED, u_i = A sin(pi X_i) sin(pi (c t + phi_i))")
PHASES = [0, 1, 1]
u = [A * sp.sin(sp.pi * x) * sp.sin(sp.pi * (c * t + phi)) for x, phi in zip(REST, PHASES)]
b, f = body_force(REST + sp.Matrix(u))
log_j = sp.log(f[0, 0] * f[1, 1] * f[2, 2])
VALUES = {A: sp.Rational(1, 20), c: 100, rho: 1, lam: sp.Rational(75000, 13), mu: sp.Rational(50000, 13)}
for name, form in [
    (
        "Uintah, MPM/MMS/MMS.cc",
        lambda i: sp.pi**2 * u[i] * (mu / rho - c**2 - (lam * (log_j - 1) - mu) / (rho * f[i, i] ** 2)),
    ),
    (
        "Karamelo, examples/Manufactured_solutions (there E = rho c^2)",
        lambda i: sp.pi**2
        * u[i]
        / rho
        * (lam / f[i, i] ** 2 * (1 - log_j) + mu * (1 + 1 / f[i, i] ** 2) - rho * c**2),
    ),
]:
    worst = max(vanishes(b[i] - form(i), VALUES, places(8)) for i in range(3))
    print(f"  {name}: differs by at most {float(worst):.1e} of {float(VALUES[A] * (sp.pi * 100) ** 2):.0f} m/s^2")

NAMES = ["X", "Y", "Z"]
print("  with A = 0.05, E = 1e4, nu = 0.3, rho = 1, c = 100, phases 0, 1, 1:")
SIGNS = ["", "-", "-"]
stretch = [
    "(1 + 0.05*pi*cos(pi*X)*sin(100*pi*t))",
    "(1 - 0.05*pi*cos(pi*Y)*sin(100*pi*t))",
    "(1 - 0.05*pi*cos(pi*Z)*sin(100*pi*t))",
]
ln_j = "ln(" + "*".join(stretch) + ")"
FORCES = []
for i, name in enumerate(NAMES):
    move = f"{SIGNS[i]}0.05*sin(pi*{name})*sin(100*pi*t)"
    FORCES.append(
        f"{SIGNS[i]}0.05*pi^2*sin(pi*{name})*sin(100*pi*t)"
        f"*(50000/13 - 10000 - (75000/13*({ln_j} - 1) - 50000/13)/{stretch[i]}^2)"
    )
    print(f"    position   {name} {'+ ' + move if not SIGNS[i] else '- ' + move[1:]}")
    print(f"    velocity   {SIGNS[i]}5*pi*sin(pi*{name})")
    print(f"    body_force {FORCES[i]}")
    spelled = sp.sympify(FORCES[i].replace("^", "**").replace("ln(", "log("), locals={"X": X, "Y": Y, "Z": Z, "t": t})
    worst = vanishes(spelled - b[i].subs(VALUES), {}, places(8))
    print(f"    which differs from the derived one by at most {float(worst):.1e} m/s^2")

VORTEX = {A: sp.Rational(1, 2), rho: 1000, mu: sp.Rational(5000, 13)}
RING = [
    {X: sp.Rational(n, 10), Y: sp.Rational(m, 10), Z: sp.Rational(0), t: sp.Rational(s, 40)}
    for n, m, s in [(9, 1, 1), (-7, 5, 4), (2, -10, 7), (8, -8, 10), (-3, 9, 20), (6, 6, 33)]
]

print()
print("GENERALISED VORTEX, a = A sin(pi t) h(R), h = (16 (R - 1)^2 - 1)^2, x = rotation by a of X")
R = sp.sqrt(X**2 + Y**2)
h_of = lambda r: (16 * (r - 1) ** 2 - 1) ** 2
g = A * sp.sin(sp.pi * t)
a = g * h_of(R)
motion = sp.Matrix([X * sp.cos(a) - Y * sp.sin(a), X * sp.sin(a) + Y * sp.cos(a), Z])
f = motion.jacobian(REST)
print(f"  J - 1 is at most {float(vanishes(f.det() - 1, VORTEX, RING)):.1e}")
# J = 1, so that the inverse is the adjugate, and ln J does not show up.
back = f.adjugate().T
stress = mu * (f - back)
div = sp.Matrix([sum(sp.diff(stress[i, k], REST[k]) for k in range(2)) for i in range(2)])
derived = [motion[i].diff(t, 2) - div[i] / rho for i in range(2)]
r = sp.symbols("r", positive=True)
h1, h2 = [sp.diff(h_of(r), r, n).subs(r, R) for n in (1, 2)]
h = h_of(R)
k = mu / rho
g1, g2 = g.diff(t), g.diff(t, 2)
p = k * (3 * g * h1 + R * g * h2) - R * g2 * h
q = k * R * (g * h1) ** 2 - R * (g1 * h) ** 2
cos, sin = X / R, Y / R
# In the polar frame at rest: b_R = p sin a + q cos a, b_theta = -p cos a + q sin a.
b_r, b_t = p * sp.sin(a) + q * sp.cos(a), -p * sp.cos(a) + q * sp.sin(a)
at_rest = [b_r * cos - b_t * sin, b_r * sin + b_t * cos]
# In the polar frame that turned by a, as Uintah has it, with sin(c pi t) and c = 1.
poly = 64 * (96 * R**3 - 240 * R**2 + 188 * R - 45)
turned_r = -R * (g1 * h) ** 2 + k * 4096 * R * (g * (4 * R - 5) * (R - 1) * (4 * R - 3)) ** 2
turned_t = -g * (R * sp.pi**2 * h + k * poly)
cb, sb = cos * sp.cos(a) - sin * sp.sin(a), sin * sp.cos(a) + cos * sp.sin(a)
turned = [cb * turned_r - sb * turned_t, sb * turned_r + cb * turned_t]
for name, form in [("polar frame at rest", at_rest), ("Uintah, polar frame that turned with the matter", turned)]:
    worst = max(vanishes(form[i] - derived[i], VORTEX, RING) for i in range(2))
    print(f"  {name}: differs by at most {float(worst):.1e} m/s^2")

s_r = "sqrt(X^2 + Y^2)"
s_h = f"(16*({s_r} - 1)^2 - 1)^2"
s_h1 = f"(64*({s_r} - 1)*(16*({s_r} - 1)^2 - 1))"
s_h2 = f"(64*(48*({s_r} - 1)^2 - 1))"
s_g = "(0.5*sin(pi*t))"
s_g1 = "(0.5*pi*cos(pi*t))"
s_a = f"({s_g}*{s_h})"
s_p = f"(5/13*{s_g}*(3*{s_h1} + {s_r}*{s_h2}) + {s_r}*pi^2*{s_g}*{s_h})"
s_q = f"({s_r}*(5/13*({s_g}*{s_h1})^2 - ({s_g1}*{s_h})^2))"
# cos and sin of the angle at rest are X/R and Y/R.
s_x = f"(({s_p}*sin{s_a} + {s_q}*cos{s_a})*X + ({s_p}*cos{s_a} - {s_q}*sin{s_a})*Y)/{s_r}"
s_y = f"(({s_p}*sin{s_a} + {s_q}*cos{s_a})*Y - ({s_p}*cos{s_a} - {s_q}*sin{s_a})*X)/{s_r}"
print("  with A = 0.5, E = 1000, nu = 0.3, rho = 1000:")
print(f"    position   X*cos{s_a} - Y*sin{s_a}")
print(f"    position   X*sin{s_a} + Y*cos{s_a}")
print(f"    velocity   -Y*0.5*pi*{s_h}")
print(f"    velocity   X*0.5*pi*{s_h}")
for i, spelled in enumerate([s_x, s_y]):
    print(f"    body_force {spelled}")
    value = sp.sympify(spelled.replace("^", "**"), locals={"X": X, "Y": Y, "Z": Z, "t": t})
    worst = vanishes(value - derived[i].subs(VORTEX), {}, RING)
    print(f"    which differs from the derived one by at most {float(worst):.1e} m/s^2")
