//! Boundary conditions: the seven types of the original as colliders, held boxes, prescribed motion, impulses.

use crate::{
    boundary::{Boundary, SurfaceKind, What, corners},
    config::Config,
    notes::{NoteKind, Notes},
    place::Place,
};

/// Layers of cells at each face of the domain that `bounding_box` makes walls of.
const MARGIN: f64 = 3.0;
/// Layers of a release, whatever the configuration says.
const LAYERS: u64 = 50;
/// Substeps for which a `reset` holds everything.
const RESET: f64 = 15.0;

/// TOML of everything that acts from outside, in the order of the configuration, tables separated by empty lines.
pub(super) struct Conditions<'c> {
    config: &'c Config,
    place: &'c Place,
    compat: bool,
    /// What the original's filling adds; none without filling.
    inside: Option<Inside>,
    /// Length of the whole run [s].
    duration: f64,
    blocks: Vec<String>,
}

/// The inside of the object.
struct Inside {
    /// Random points that the original puts into a volume [1/m^3].
    per_volume: f64,
    /// Positions and volumes that stand for it.
    shares: Vec<([f64; 3], f64)>,
}

impl<'c> Conditions<'c> {
    /// Nothing yet. `inside` holds positions and volumes that stand for the filled inside.
    pub fn new(
        config: &'c Config,
        place: &'c Place,
        compat: bool,
        duration: f64,
        inside: Vec<([f64; 3], f64)>,
    ) -> Self {
        let dx = config.dx();
        let inside = config.filling.map(|f| Inside {
            per_volume: f.per_simulation_cell(dx, config.grid_lim) / dx.powi(3),
            shares: inside,
        });
        Self {
            config,
            place,
            compat,
            inside,
            duration,
            blocks: Vec::new(),
        }
    }

    /// Converts all of them.
    pub fn convert(mut self, notes: &mut Notes) -> String {
        let config = self.config;
        for boundary in &config.boundaries {
            self.one(boundary, notes);
        }
        self.blocks.concat()
    }

    fn one(&mut self, b: &Boundary, notes: &mut Notes) {
        let [start, end] = b.time;
        if end <= start || end <= 0.0 {
            notes.ignore(&b.key, end, format!("ends before it starts, at {start} s"));
            return;
        }
        if start >= self.duration {
            notes.ignore(
                &b.key,
                start,
                format!("starts when the run of {} s is over", self.duration),
            );
            return;
        }
        match &b.what {
            What::BoundingBox => self.bounding_box(b),
            What::Cuboid {
                center,
                half_size,
                velocity,
                reset,
            } => {
                self.cuboid(b, *center, *half_size, *velocity);
                if *reset {
                    self.reset(b, notes);
                }
            }
            What::Surface {
                point,
                normal,
                kind,
                friction,
            } => self.surface(b, *point, *normal, (*kind, *friction), notes),
            What::Impulse {
                center,
                half_size,
                force,
                num_dt,
            } => self.impulse(b, *center, *half_size, (*force, *num_dt), notes),
            What::Translation {
                center,
                half_size,
                velocity,
            } => {
                let region = region(*center, *half_size);
                let keys = format!("{region}linear_velocity = {velocity:?}\n");
                self.block("prescribed", b, &keys);
            }
            What::Rotation {
                center,
                normal,
                half_height,
                radius,
                rotation,
                translation,
            } => {
                let cylinder = format!(
                    "cylinder = {{ center = {center:?}, axis = {normal:?}, radius = {radius:?}, half_height = {half_height:?} }}"
                );
                let turning = turning(*center, *normal, *rotation, *translation);
                self.block("prescribed", b, &format!("{cylinder}\n{turning}"));
            }
            What::Release {
                axis,
                start_position,
                end_position,
                num_layers,
            } => self.release(
                b,
                *axis,
                [*start_position, *end_position],
                *num_layers,
                notes,
            ),
        }
    }

    /// A table `[[name]]` with its time span.
    fn block(&mut self, name: &str, b: &Boundary, keys: &str) {
        let span = self.span(b);
        self.blocks
            .push(format!("\n# {}\n[[{name}]]\n{keys}{span}", b.key));
    }

    /// The keys of a time span; what holds for the whole run needs none.
    fn span(&self, b: &Boundary) -> String {
        let [start, end] = b.time;
        let mut keys = String::new();
        if start > 0.0 {
            keys += &format!("start_time = {start:?}\n");
        }
        if end < self.duration {
            keys += &format!("end_time = {end:?}\n");
        }
        keys
    }

    fn bounding_box(&mut self, b: &Boundary) {
        let dx = self.config.dx();
        // Half a cell beyond the last node that is a wall, so that rounding cannot add or lose a layer.
        let low = (MARGIN - 0.5) * dx;
        let high = (self.config.n_grid as f64 - MARGIN - 0.5) * dx;
        for (axis, name) in ["x", "y", "z"].iter().enumerate() {
            for (side, at, sign) in [("low", low, 1.0), ("high", high, -1.0)] {
                let (mut point, mut normal) = ([0.0; 3], [0.0; 3]);
                point[axis] = at;
                normal[axis] = sign;
                let keys = format!(
                    "name = \"{} {side} {name}\"\nshape = \"half_space\"\npoint = {point:?} # {MARGIN} cells inside \
                     the domain\nnormal = {normal:?}\nsurface = \"separate\"\n",
                    b.key
                );
                self.block("colliders", b, &keys);
            }
        }
    }

    fn cuboid(&mut self, b: &Boundary, center: [f64; 3], half: [f64; 3], velocity: [f64; 3]) {
        let dx = self.config.dx();
        let moves = velocity != [0.0; 3];
        // The original's box is open: a face that meets a layer of nodes is drawn in, so that it does not hold them.
        let drawn_in = |face: f64, inwards: f64| {
            let cells = face / dx;
            let on_nodes = !moves && (cells - cells.round()).abs() < 1e-6;
            if on_nodes {
                face + 1e-3 * dx * inwards
            } else {
                face
            }
        };
        let (min, max) = corners(center, half);
        let (min, max) = (
            min.map(|face| drawn_in(face, 1.0)),
            max.map(|face| drawn_in(face, -1.0)),
        );
        let mut keys = format!("min = {min:?} # point - size\nmax = {max:?} # point + size\n");
        if moves {
            keys += &format!("velocity = {velocity:?}\n");
        }
        self.block("pinned_regions", b, &keys);
    }

    /// `reset`: the original zeroes all velocities before the start and for some substeps after the end.
    fn reset(&mut self, b: &Boundary, notes: &mut Notes) {
        let [start, end] = b.time;
        let after = end + RESET * self.config.substep_dt;
        let key = format!("{}.reset", b.key);
        if start <= 0.0 && end >= self.duration {
            notes.ignore(
                key,
                true,
                "acts after the end, which is after the end of the run",
            );
            return;
        }
        if !self.compat {
            notes.add(
                NoteKind::Corrected,
                key,
                true,
                false,
                "the original stops everything everywhere before the start and for 15 substeps after the end; --compat \
                 repeats that",
            );
            return;
        }
        notes.add(
            NoteKind::Reproduced,
            key,
            true,
            true,
            "everything is held at rest before the start and for 15 of the original's substeps after the end",
        );
        let dx = self.config.dx();
        let (low, high) = (-dx, self.config.grid_lim + dx);
        for (from, to) in [(0.0, start), (end, after)] {
            if to > from && from < self.duration {
                self.blocks.push(format!(
                    "\n# {}: reset\n[[pinned_regions]]\nmin = {:?}\nmax = {:?}\nstart_time = {from:?}\n\
                     end_time = {to:?}\n",
                    b.key, [low; 3], [high; 3]
                ));
            }
        }
    }

    fn surface(
        &mut self,
        b: &Boundary,
        point: [f64; 3],
        normal: [f64; 3],
        (kind, friction): (SurfaceKind, f64),
        notes: &mut Notes,
    ) {
        let key = format!("{}.surface", b.key);
        let stated = match kind {
            SurfaceKind::Sticky => "sticky",
            SurfaceKind::Slip => "slip",
            SurfaceKind::Cut => "cut",
            SurfaceKind::Separate => "separate",
        };
        let corrected = if kind == SurfaceKind::Cut {
            "separate"
        } else {
            stated
        };
        let surface = if self.compat { "sticky" } else { corrected };
        match (kind, self.compat) {
            (SurfaceKind::Sticky, _) => {}
            (SurfaceKind::Cut, false) => notes.add(
                NoteKind::Corrected,
                key,
                stated,
                surface,
                "the original's cut has heights of one scene (0.4 and 0.53) built in: sticky outside of them, slowed \
                 to three tenths between",
            ),
            (SurfaceKind::Cut, true) => notes.add(
                NoteKind::Corrected,
                key,
                stated,
                surface,
                "the original's cut is sticky but for a slab between the heights 0.4 and 0.53, where it slows to three \
                 tenths: that part cannot be repeated",
            ),
            (_, false) => notes.add(
                NoteKind::Corrected,
                key,
                stated,
                surface,
                "the original works this out and then sets the velocity to zero all the same: everything sticks; \
                 --compat repeats that",
            ),
            (_, true) => notes.add(
                NoteKind::Reproduced,
                key,
                stated,
                surface,
                "in the original every surface sticks, whatever it says",
            ),
        }
        let mut keys = format!(
            "name = \"{}\"\nshape = \"half_space\"\npoint = {point:?}\nnormal = {normal:?}\nsurface = \"{surface}\"\n",
            b.key
        );
        if surface != "sticky" {
            keys += &format!("friction = {friction:?}\n");
        }
        self.block("colliders", b, &keys);
    }

    fn impulse(
        &mut self,
        b: &Boundary,
        center: [f64; 3],
        half: [f64; 3],
        (force, num_dt): ([f64; 3], u64),
        notes: &mut Notes,
    ) {
        let start = b.time[0].max(0.0);
        let dt = self.config.substep_dt;
        let duration = num_dt as f64 * dt;
        let key = format!("{}.force", b.key);
        if num_dt == 0 || force == [0.0; 3] {
            notes.ignore(key, force.to_vec(), "no force, or for no time");
            return;
        }
        let each = force.map(|f| f * duration);
        let count = self.count_inside(center, half);
        let region = region(center, half);
        let span = if num_dt == 1 {
            String::new()
        } else {
            format!("duration = {duration:?} # num_dt substeps\n")
        };
        let begin = if start > 0.0 {
            format!("start_time = {start:?}\n")
        } else {
            String::new()
        };
        let (strength, kind, message) = if self.compat {
            (
                format!("impulse_per_particle = {each:?} # force num_dt substep_dt\n"),
                NoteKind::Reproduced,
                "per particle as in the original, so that the whole grows with the number of particles; shared out as \
                 one change of velocity, where the original gives light particles more"
                    .to_owned(),
            )
        } else {
            let total = each.map(|i| i * count);
            (
                format!(
                    "impulse = {total:?} # force num_dt substep_dt, times {count:.0} particles of the original\n"
                ),
                NoteKind::Corrected,
                format!(
                    "the original applies the force to every particle: {count:.0} of them by its rules. The same \
                     impulse [N s] as a whole, shared out as one change of velocity, so that it no longer depends on \
                     their number"
                ),
            )
        };
        let written = if self.compat {
            each.to_vec()
        } else {
            each.map(|i| i * count).to_vec()
        };
        notes.add(kind, key, force.to_vec(), written, message);
        self.blocks.push(format!(
            "\n# {}\n[[impulses]]\n{region}{strength}{begin}{span}",
            b.key
        ));
    }

    /// Particles that the original has within a box: its Gaussians and, on average, the random points inside.
    fn count_inside(&self, center: [f64; 3], half: [f64; 3]) -> f64 {
        let inside = |p: &[f64; 3]| (0..3).all(|a| (p[a] - center[a]).abs() < half[a]);
        let gaussians = self.place.simulated.iter().filter(|p| inside(p)).count();
        let filled = match &self.inside {
            Some(Inside { per_volume, shares }) => {
                let volumes = shares.iter().filter(|(p, _)| inside(p)).map(|(_, v)| v);
                volumes.sum::<f64>() * per_volume
            }
            None => 0.0,
        };
        (gaussians as f64 + filled).round()
    }

    fn release(
        &mut self,
        b: &Boundary,
        axis: usize,
        [first, last]: [f64; 2],
        num_layers: u64,
        notes: &mut Notes,
    ) {
        let layers = if self.compat { LAYERS } else { num_layers };
        if num_layers != LAYERS {
            let key = format!("{}.num_layers", b.key);
            let (kind, message) = if self.compat {
                (NoteKind::Reproduced, "the original always uses 50 layers")
            } else {
                (
                    NoteKind::Corrected,
                    "the original always uses 50 layers, whatever is asked for",
                )
            };
            notes.add(kind, key, num_layers, layers, message);
        }
        if b.time[0] > 0.0 {
            notes.add(
                NoteKind::Corrected,
                format!("{}.start_time", b.key),
                b.time[0],
                b.time[0],
                "the layers are let go between start and end; the original spaces them from time 0",
            );
        }
        let mut normal = [0.0; 3];
        normal[axis] = 1.0;
        let [start, end] = b.time;
        let begin = if start > 0.0 {
            format!("start_time = {start:?}\n")
        } else {
            String::new()
        };
        self.blocks.push(format!(
            "\n# {}\n[[releases]]\naxis = {normal:?}\nstart_position = {first:?}\nend_position = {last:?}\n\
             layers = {layers} # num_layers\n{begin}end_time = {end:?}\n",
            b.key
        ));
    }
}

/// The selecting key of a box given by centre and half size.
fn region(center: [f64; 3], half: [f64; 3]) -> String {
    let (min, max) = corners(center, half);
    format!("box = {{ min = {min:?}, max = {max:?} }} # point -+ size, at rest\n")
}

/// The keys of a turn about an axis; the original turns left about its normal, by the right-hand rule: along -normal.
fn turning(center: [f64; 3], normal: [f64; 3], rotation: f64, translation: f64) -> String {
    let angular = normal.map(|n| -rotation * n + 0.0);
    let linear = normal.map(|n| translation * n + 0.0);
    format!(
        "linear_velocity = {linear:?} # translation_scale\n\
         angular_velocity = {angular:?} # rotation_scale, clockwise seen along -normal\n\
         center = {center:?}\n"
    )
}
