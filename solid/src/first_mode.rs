//! The slowest elastic motion of a solid about rest, by Ritz's method: its displacement is a polynomial of the position
//! (Visscher, Migliori, Bell, Reinert 1991, J. Acoust. Soc. Am. 90, 2154, "On the normal modes of free vibration of inhomogeneous
//! and anisotropic elastic objects").
//!
//! Stiffness and mass of polynomials are moments of the matter's volume, so that no vector of nodes is needed. The frequency is never
//! lower than that of the matter; it is higher where polynomials do not bend as the matter does: in thin limbs of a thick body.

use super::{
    cells::CELLS,
    held::HELD_PART,
    kernel::SolidLaw,
    model::{SolidModel, cell_of_number, stencil},
};

/// Largest degree of displacements.
const DEGREE: usize = 5;
/// Powers of a coordinate in moments: of products of two displacements, and 0.
const POWERS: usize = 2 * DEGREE + 1;
/// Stiffness of a clamp over the modulus times the size of the solid. With much stiffer ones polynomials cannot contract across a clamped
/// end beyond it: a cantilever of 2 x 2 x 32 cells with Poisson's ratio 0.3 is then 5 % too fast. With softer ones short cantilevers are too slow.
const CLAMP: f64 = 2.0;
/// Squared frequency that rigid motion is given over the largest of the elastic ones, so that the slowest is elastic.
const RIGID: f64 = 10.0;
/// Pivot over the diagonal below which a displacement is one of others already.
const DEPENDENT: f64 = 1e-11;
/// Iterations at most, and the change of the squared frequency that ends them.
const ITERATIONS: (usize, f64) = (60, 1e-6);
/// Squared angular frequency of motion without restoring forces over the mean of all.
const NONE: f64 = 1e-10;

/// The slowest elastic motion of a solid.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FirstMode {
    /// Angular frequency [rad/s]; 0 where nothing restores the solid.
    pub omega: f64,
    /// Loss factor: that of each law by its share of the elastic energy (modal strain energy, Johnson and Kienholz 1982).
    pub loss: f64,
}

/// Exponents of the coordinates of a monomial.
type Monomial = [usize; 3];

/// Moments of the volume of one law by the exponents of coordinates.
struct Moments(Vec<f64>);

impl Moments {
    fn number([i, j, k]: Monomial) -> usize {
        (i * POWERS + j) * POWERS + k
    }

    fn get(&self, of: Monomial) -> f64 {
        self.0[Self::number(of)]
    }
}

/// Coordinates in which the solid is between -1 and 1.
struct Scaled {
    middle: [f64; 3],
    /// Half the extent along each axis [cells].
    half: [f64; 3],
}

impl FirstMode {
    /// Of a solid of some laws of which `held` nodes, and places [m], do not move.
    pub fn new(
        model: &SolidModel,
        laws: &[SolidLaw],
        held: &[usize],
        clamped: impl Iterator<Item = [f64; 3]>,
    ) -> Self {
        let cells = moving_cells(model, held);
        let Some((scaled, thickness)) = extent(&cells) else {
            return Self::default();
        };
        let moments: Vec<Moments> = (0..laws.len())
            .map(|part| moments(model, &cells, part, &scaled))
            .collect();
        let monomials = monomials(thickness);
        let mut places: Vec<[f64; 3]> = clamp(model, &cells, held);
        places.extend(clamped.map(|x| model.in_cells(x)));
        let places: Vec<[f64; 3]> = places.into_iter().map(|x| scaled.of(x)).collect();
        let forms = Forms::new(&moments, laws, &monomials, &scaled);
        forms.slowest(&monomials, &scaled, &places, model.dx)
    }
}

/// A cell that moves: the place of its centre [cells], its law and the volumes of its octants [cells].
struct MovingCell {
    at: [f64; 3],
    part: usize,
    volumes: [f32; 8],
    nodes: [usize; 27],
}

/// Cells of which not all nodes are held.
fn moving_cells(model: &SolidModel, held: &[usize]) -> Vec<MovingCell> {
    let mut is_held = vec![false; model.mass.len()];
    held.iter().for_each(|&n| is_held[n] = true);
    let blocks = model.point_blocks.iter().flat_map(|block| {
        let own = model.cells[block.cells.clone()].iter();
        own.map(move |cell| (block, cell))
    });
    let cells = blocks.filter(|(_, cell)| cell.part != HELD_PART);
    let cells = cells.map(|(block, cell)| {
        let first = model.node_blocks[block.nodes[0] as usize];
        let own = cell_of_number(cell.number);
        MovingCell {
            at: std::array::from_fn(|a| f64::from(CELLS * first[a]) + own[a] as f64 + 1.0),
            part: usize::from(cell.part),
            volumes: cell.volumes,
            nodes: stencil(&block.nodes, cell.number, [0.0; 3]).map(|(slot, _)| slot),
        }
    });
    cells
        .filter(|cell| cell.nodes.iter().any(|&n| !is_held[n]))
        .collect()
}

/// Places of held nodes beside nodes that move [cells]: where one layer of them is held, polynomials need no other.
fn clamp(model: &SolidModel, cells: &[MovingCell], held: &[usize]) -> Vec<[f64; 3]> {
    let mut is_held = vec![false; model.mass.len()];
    held.iter().for_each(|&n| is_held[n] = true);
    let mut is_beside = vec![false; model.mass.len()];
    for cell in cells {
        for (n, &node) in cell.nodes.iter().enumerate() {
            let place = [n / 9, n / 3 % 3, n % 3];
            let next = [9, 3, 1].into_iter().zip(place).flat_map(|(stride, at)| {
                let before = (at > 0).then(|| cell.nodes[n - stride]);
                [before, (at < 2).then(|| cell.nodes[n + stride])]
            });
            is_beside[node] |= is_held[node] && next.flatten().any(|other| !is_held[other]);
        }
    }
    let beside = held.iter().filter(|&&n| is_beside[n]);
    beside.map(|&n| model.node_position(n)).collect()
}

/// The box about some cells, and how many there are along each axis; none without cells.
fn extent(cells: &[MovingCell]) -> Option<(Scaled, [usize; 3])> {
    let first = cells.first()?;
    let (mut low, mut high) = (first.at, first.at);
    for cell in cells {
        for a in 0..3 {
            low[a] = low[a].min(cell.at[a]);
            high[a] = high[a].max(cell.at[a]);
        }
    }
    let scaled = Scaled {
        middle: std::array::from_fn(|a| 0.5 * (low[a] + high[a])),
        half: std::array::from_fn(|a| 0.5 * (high[a] - low[a] + 1.0)),
    };
    let count = std::array::from_fn(|a| (high[a] - low[a] + 1.5) as usize);
    Some((scaled, count))
}

impl Scaled {
    fn of(&self, at: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| (at[a] - self.middle[a]) / self.half[a])
    }

    /// Root of the mean square of the half extents [cells].
    fn size(&self) -> f64 {
        let squares: f64 = self.half.iter().map(|x| x * x).sum();
        (squares / 3.0).sqrt()
    }
}

/// Monomials of displacements: along an axis of few cells no more than their octants tell apart.
fn monomials(cells: [usize; 3]) -> Vec<Monomial> {
    let most = cells.map(|n| (2 * n + 1).min(DEGREE));
    let mut all = vec![];
    for i in 0..=most[0] {
        for j in 0..=most[1] {
            for k in 0..=most[2] {
                if i + j + k <= DEGREE {
                    all.push([i, j, k]);
                }
            }
        }
    }
    all
}

/// Means of the powers of a coordinate over an interval about `at` of half width `half`, by three points of Gauss.
fn mean_powers(at: f64, half: f64) -> [f64; POWERS] {
    let mut sums = [0.0; POWERS];
    let far = 0.774_596_669_241_483_4 * half;
    for (x, weight) in [
        (at - far, 5.0 / 18.0),
        (at, 8.0 / 18.0),
        (at + far, 5.0 / 18.0),
    ] {
        let mut power = weight;
        for sum in &mut sums {
            *sum += power;
            power *= x;
        }
    }
    sums
}

fn moments(model: &SolidModel, cells: &[MovingCell], part: usize, scaled: &Scaled) -> Moments {
    let mut sums = vec![0.0; POWERS * POWERS * POWERS];
    let cubed = model.dx.powi(3);
    for cell in cells.iter().filter(|cell| cell.part == part) {
        let at = scaled.of(cell.at);
        let powers: [[[f64; POWERS]; 2]; 3] = std::array::from_fn(|a| {
            let quarter = 0.25 / scaled.half[a];
            [-1.0, 1.0].map(|side| mean_powers(at[a] + side * quarter, quarter))
        });
        for (n, &volume) in cell.volumes.iter().enumerate() {
            let volume = cubed * f64::from(volume);
            let [x, y, z] = [&powers[0][n / 4], &powers[1][n / 2 % 2], &powers[2][n % 2]];
            for i in 0..POWERS {
                for j in 0..POWERS - i {
                    let own = volume * x[i] * y[j];
                    let sums = &mut sums[(i * POWERS + j) * POWERS..];
                    for (sum, z) in sums.iter_mut().zip(&z[..POWERS - i - j]) {
                        *sum += own * z;
                    }
                }
            }
        }
    }
    Moments(sums)
}

/// A symmetric matrix.
#[derive(Clone)]
struct Symmetric {
    n: usize,
    rows: Vec<f64>,
}

impl Symmetric {
    fn zero(n: usize) -> Self {
        let rows = vec![0.0; n * n];
        Self { n, rows }
    }

    fn row(&self, n: usize) -> &[f64] {
        &self.rows[n * self.n..(n + 1) * self.n]
    }

    fn trace(&self) -> f64 {
        self.rows.iter().step_by(self.n + 1).sum()
    }

    fn times(&self, x: &[f64]) -> Vec<f64> {
        (0..self.n).map(|n| dot(self.row(n), x)).collect()
    }

    /// Adds `times` a vector times itself.
    fn add_square(&mut self, times: f64, x: &[f64]) {
        for (row, &own) in self.rows.chunks_exact_mut(self.n).zip(x) {
            if own != 0.0 {
                for (to, other) in row.iter_mut().zip(x) {
                    *to += times * own * other;
                }
            }
        }
    }

    /// Its factor of Cholesky, row by row; rows of 0 where a displacement is one of others.
    fn factor(mut self) -> Self {
        for i in 0..self.n {
            let own = self.rows[i * self.n + i];
            let (before, rest) = self.rows.split_at_mut(i * self.n);
            let row = &mut rest[..self.n];
            for j in 0..i {
                let other = &before[j * self.n..];
                let pivot = other[j];
                let sum = row[j] - dot(&row[..j], &other[..j]);
                row[j] = if pivot > 0.0 { sum / pivot } else { 0.0 };
            }
            let pivot = row[i] - dot(&row[..i], &row[..i]);
            match pivot > DEPENDENT * own {
                true => row[i] = pivot.sqrt(),
                false => row[..=i].fill(0.0),
            }
        }
        self
    }

    /// The solution of a system of which this is the factor.
    fn solve(&self, x: &mut [f64]) {
        for i in 0..self.n {
            let (row, pivot) = (self.row(i), self.row(i)[i]);
            let sum = x[i] - dot(&row[..i], &x[..i]);
            x[i] = if pivot > 0.0 { sum / pivot } else { 0.0 };
        }
        for i in (0..self.n).rev() {
            let row = self.row(i);
            x[i] = if row[i] > 0.0 { x[i] / row[i] } else { 0.0 };
            let (before, own) = x.split_at_mut(i);
            for (x, entry) in before.iter_mut().zip(row) {
                *x -= entry * own[0];
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Elastic energy, loss and kinetic energy of displacements: entry `3 m + a` is the monomial `m` along the axis `a`.
struct Forms {
    stiffness: Symmetric,
    /// Stiffness of each law times its loss factor.
    loss: Symmetric,
    mass: Symmetric,
    /// Largest Young's modulus [Pa].
    modulus: f64,
}

impl Forms {
    fn new(
        moments: &[Moments],
        laws: &[SolidLaw],
        monomials: &[Monomial],
        scaled: &Scaled,
    ) -> Self {
        let n = 3 * monomials.len();
        let (mut stiffness, mut mass) = (Symmetric::zero(n), Symmetric::zero(n));
        let mut loss = Symmetric::zero(n);
        let sum = |weight: &dyn Fn(&SolidLaw) -> f64, of: Monomial| -> f64 {
            let parts = moments.iter().zip(laws);
            parts.map(|(m, law)| weight(law) * m.get(of)).sum()
        };
        for (p, x) in monomials.iter().enumerate() {
            for (q, y) in monomials.iter().enumerate().skip(p) {
                let product: Monomial = std::array::from_fn(|a| x[a] + y[a]);
                let inertia = sum(&|law| law.density, product);
                // Weighted integrals of the slope of one along `a` times that of the other along `b`.
                let slopes = |weight: &dyn Fn(&SolidLaw) -> f64| -> [[f64; 3]; 3] {
                    std::array::from_fn(|a| {
                        std::array::from_fn(|b| {
                            let times = x[a] * y[b];
                            if times == 0 {
                                return 0.0;
                            }
                            let mut of = product;
                            of[a] -= 1;
                            of[b] -= 1;
                            times as f64 * sum(weight, of) / (scaled.half[a] * scaled.half[b])
                        })
                    })
                };
                let energy = |factor: &dyn Fn(&SolidLaw) -> f64| {
                    let bulk = slopes(&|law| factor(law) * law.lambda);
                    let shear = slopes(&|law| factor(law) * law.mu);
                    let trace = shear[0][0] + shear[1][1] + shear[2][2];
                    move |a: usize, b: usize| {
                        let own = if a == b { trace } else { 0.0 };
                        bulk[a][b] + shear[b][a] + own
                    }
                };
                let (elastic, lost) = (energy(&|_| 1.0), energy(&|law| law.loss));
                for a in 0..3 {
                    for b in 0..3 {
                        let (i, j) = (3 * p + a, 3 * q + b);
                        for (to, value) in [
                            (&mut stiffness, elastic(a, b)),
                            (&mut loss, lost(a, b)),
                            (&mut mass, if a == b { inertia } else { 0.0 }),
                        ] {
                            to.rows[i * n + j] = value;
                            to.rows[j * n + i] = value;
                        }
                    }
                }
            }
        }
        let moduli = laws.iter();
        Self {
            stiffness,
            loss,
            mass,
            modulus: moduli.map(SolidLaw::tangent_at_rest).fold(0.0, f64::max),
        }
    }

    /// The slowest motion where places of the solid, in its scaled coordinates, are held, or the slowest elastic one where none are.
    fn slowest(
        &self,
        monomials: &[Monomial],
        scaled: &Scaled,
        places: &[[f64; 3]],
        dx: f64,
    ) -> FirstMode {
        let n = self.mass.n;
        let mut held = self.stiffness.clone();
        if places.is_empty() {
            self.stiffen_rigid_motion(&mut held, monomials, scaled);
        }
        // Slopes are those of displacements over cells: a stiffness [N/m] counts times the squared cell.
        let clamp = CLAMP * self.modulus * scaled.size() * dx.powi(3) / places.len() as f64;
        for &place in places {
            let mut x = vec![0.0; n];
            for a in 0..3 {
                x.fill(0.0);
                for (m, exponents) in monomials.iter().enumerate() {
                    let powers = (0..3).map(|b| place[b].powi(exponents[b] as i32));
                    x[3 * m + a] = powers.product();
                }
                held.add_square(clamp, &x);
            }
        }
        let factor = held.clone().factor();
        let mut x: Vec<f64> = (0..n).map(|n| 1.0 + 0.37 * ((n * n) % 7) as f64).collect();
        let mut squared = 0.0;
        for _ in 0..ITERATIONS.0 {
            x = self.mass.times(&x);
            factor.solve(&mut x);
            let inertia = dot(&x, &self.mass.times(&x));
            if inertia.is_nan() || inertia <= 0.0 {
                return FirstMode::default();
            }
            let now = dot(&x, &held.times(&x)) / inertia;
            let scale = inertia.sqrt().recip();
            x.iter_mut().for_each(|x| *x *= scale);
            let change = (now - squared).abs();
            squared = now;
            if change <= ITERATIONS.1 * now {
                break;
            }
        }
        let elastic = dot(&x, &self.stiffness.times(&x));
        let restores = squared > NONE * self.stiffness.trace() / self.mass.trace();
        if elastic.is_nan() || elastic <= 0.0 || !restores {
            return FirstMode::default();
        }
        FirstMode {
            omega: squared.sqrt() / dx,
            loss: dot(&x, &self.loss.times(&x)) / elastic,
        }
    }

    /// Makes rigid motion faster than elastic one.
    fn stiffen_rigid_motion(&self, to: &mut Symmetric, monomials: &[Monomial], scaled: &Scaled) {
        let n = self.mass.n;
        let find = |of: Monomial| monomials.iter().position(|m| *m == of);
        let linear = |a: usize| std::array::from_fn(|b| usize::from(a == b));
        let mut motions = vec![];
        for a in 0..3 {
            let mut shift = vec![0.0; n];
            if let Some(m) = find([0; 3]) {
                shift[3 * m + a] = 1.0;
            }
            motions.push(shift);
            let (b, c) = ((a + 1) % 3, (a + 2) % 3);
            let mut turn = vec![0.0; n];
            if let (Some(along), Some(across)) = (find(linear(b)), find(linear(c))) {
                turn[3 * along + c] = scaled.half[b];
                turn[3 * across + b] = -scaled.half[c];
            }
            motions.push(turn);
        }
        let fast = RIGID * self.stiffness.trace() / self.mass.trace();
        for motion in motions {
            let momentum = self.mass.times(&motion);
            let inertia = dot(&momentum, &motion);
            if inertia > 0.0 {
                to.add_square(fast / inertia, &momentum);
            }
        }
    }
}
