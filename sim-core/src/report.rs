//! `StepReport`: what one step did, for people and machines.

pub use crate::ledger::{Contact, ContactPartner};

/// Result of stepping one frame.
#[derive(Clone, Debug, Default)]
pub struct StepReport {
    /// Frames stepped since the world was made; the first report says 1.
    pub step: u64,
    /// Simulated time at the end of the frame [s].
    pub sim_time: f64,
    /// Size of the last substep [s].
    pub dt: f64,
    /// Smallest substep of the frame [s].
    pub dt_min: f64,
    /// What limited `dt_min`.
    pub dt_limit: DtLimit,
    /// Object whose material or motion limited `dt_min`, if one did.
    pub dt_object: Option<usize>,
    /// Substeps taken.
    pub substeps: u32,
    /// Substeps rolled back and retried with a smaller `dt`.
    pub rollbacks: u32,
    /// Particle-substeps executed.
    pub particle_updates: u64,
    /// Particle-substeps of modelling every particle with MPM; the substeps of those at rest where none was taken.
    pub particle_updates_full: u64,
    /// Kinetic energy that objects lost in this frame because they are modelled with less [J].
    pub fidelity_loss: f64,
    /// Energy that solids lost in this frame as their matter vibrates, by its loss factor [J].
    pub lost_in_matter: f64,
    /// Work that springs did on the patches that they hold [J].
    pub spring_work: f64,
    /// Energy that edits brought into the world: what objects have after them less what they had [J].
    pub edit_energy: f64,
    /// Mass that edits brought into the world [kg].
    pub edit_mass: f64,
    /// Particles that left the domain in this frame (indices into the scene's particles).
    pub left_domain: Vec<u32>,
    /// Whether the frame was undone because those particles would have left the domain: time did not advance.
    pub stopped: bool,
    /// Particles frozen in this frame because their state stayed bad after retries.
    pub quarantined: Vec<u32>,
    /// Kinetic energy incl. the affine part [J].
    pub kinetic_energy: f64,
    /// Elastic energy, that which contacts of solids hold with it [J].
    pub elastic_energy: f64,
    /// Potential energy in the current gravity, zero at the world origin [J].
    pub potential_energy: f64,
    /// Total linear momentum [kg m/s].
    pub linear_momentum: [f64; 3],
    /// Total angular momentum about the world origin incl. the affine part [kg m^2/s].
    pub angular_momentum: [f64; 3],
    /// One entry per object of the scene.
    pub objects: Vec<ObjectState>,
    /// Contacts between deformable objects that ended in this frame, or turned out to last, in the order it happened.
    pub contacts: Vec<ContactEpisode>,
    /// Solids on grids of their own that went over to the spatial grid at the start of this frame, in the order of their numbers.
    pub gone_over: Vec<GoneOver>,
    /// Operations by kind.
    pub work: Work,
    /// Wall time per phase.
    pub timings: Timings,
    /// What each object cost, in the order of the scene.
    pub costs: Vec<ObjectCost>,
    /// Hash of the complete state; equal for equal scene and command log.
    pub state_hash: u64,
}

/// Operations of one frame, summed over its substeps, those taken back included: what the paper's Table I counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Work {
    /// Particles scattered to the grid.
    pub particle_to_grid: u64,
    /// Particles gathered from the grid.
    pub grid_to_particle: u64,
    /// Grid nodes updated.
    pub grid_nodes: u64,
    /// Nodes that two objects share, which contact looks at.
    pub contact_nodes: u64,
    /// Particles summed for the moments that contact between objects needs.
    pub object_particles: u64,
    /// Pairs of objects tested for contact.
    pub object_pairs: u64,
    /// Particles held together by the coherence constraint.
    pub constrained_particles: u64,
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        self.particle_to_grid += other.particle_to_grid;
        self.grid_to_particle += other.grid_to_particle;
        self.grid_nodes += other.grid_nodes;
        self.contact_nodes += other.contact_nodes;
        self.object_particles += other.object_particles;
        self.object_pairs += other.object_pairs;
        self.constrained_particles += other.constrained_particles;
    }
}

/// Wall seconds per phase of one frame.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct Timings {
    /// Applying commands.
    pub commands: f64,
    /// Sorting and rebuilding block lists.
    pub sort: f64,
    /// Particle pass: gather, constitutive law, scatter.
    pub particles: f64,
    /// Grid pass: tile sums, velocity update, boundaries.
    pub grid: f64,
    /// Contact between objects on the grid.
    pub contact: f64,
    /// Matter on the grid against rigid bodies and solids.
    pub coupling: f64,
    /// Solids: elastic forces, and how nodes move.
    pub solids: f64,
    /// Contact of solids: among each other, with rigid bodies and with colliders.
    pub solid_contact: f64,
    /// Measuring the fastest motions of solids, which bound their substeps.
    pub solid_measuring: f64,
    /// Rigid bodies: among each other and at colliders.
    pub bodies: f64,
    /// Moments, energies, hash.
    pub moments: f64,
    /// Whole frame.
    pub total: f64,
}

impl std::ops::AddAssign for Timings {
    fn add_assign(&mut self, other: Self) {
        self.commands += other.commands;
        self.sort += other.sort;
        self.particles += other.particles;
        self.grid += other.grid;
        self.contact += other.contact;
        self.coupling += other.coupling;
        self.solids += other.solids;
        self.solid_contact += other.solid_contact;
        self.solid_measuring += other.solid_measuring;
        self.bodies += other.bodies;
        self.moments += other.moments;
        self.total += other.total;
    }
}

impl Timings {
    /// Names of the phases, in the order of [`phases`](Self::phases).
    pub const PHASES: [&str; 10] = [
        "particles",
        "grid",
        "contact",
        "coupling",
        "solids",
        "solid contact",
        "solid measuring",
        "bodies",
        "sort",
        "publish",
    ];

    /// Wall seconds of the phases that may take long, moments as what is published; what is left of the whole is between them.
    pub fn phases(&self) -> [f64; Self::PHASES.len()] {
        [
            self.particles,
            self.grid,
            self.contact,
            self.coupling,
            self.solids,
            self.solid_contact,
            self.solid_measuring,
            self.bodies,
            self.sort,
            self.moments,
        ]
    }
}

/// What an object cost in a frame.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ObjectCost {
    /// Processor time [s]; of matter on the spatial grid and of rigid bodies their shares of what all of these took, by particles and
    /// by bodies.
    pub seconds: f64,
    /// Substeps.
    pub substeps: u64,
    /// The smallest of them [s]; infinite where it took none.
    #[serde(skip_serializing_if = "is_infinite")]
    pub dt_min: f64,
    /// What limited that.
    pub dt_limit: DtLimit,
    /// Points of its surface that touch something where the frame ends; of solids on grids of their own.
    pub contact_points: u64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "what serde asks for")]
fn is_infinite(x: &f64) -> bool {
    x.is_infinite()
}

impl Default for ObjectCost {
    fn default() -> Self {
        Self {
            seconds: 0.0,
            substeps: 0,
            dt_min: f64::INFINITY,
            dt_limit: DtLimit::Frame,
            contact_points: 0,
        }
    }
}

impl std::ops::AddAssign for ObjectCost {
    fn add_assign(&mut self, other: Self) {
        self.seconds += other.seconds;
        self.substeps += other.substeps;
        if other.dt_min < self.dt_min {
            (self.dt_min, self.dt_limit) = (other.dt_min, other.dt_limit);
        }
        self.contact_points = self.contact_points.max(other.contact_points);
    }
}

/// What limited the time step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[repr(u32)]
pub enum DtLimit {
    /// The frame's own length.
    #[default]
    Frame = 0,
    /// Sound speed at the current tangent: isolated-particle limit.
    Sound = 1,
    /// A particle would move too far.
    Velocity = 2,
    /// A particle would deform too much.
    Deformation = 3,
}

/// How an object is modelled at present.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[repr(u32)]
pub enum Level {
    /// Visible only.
    #[default]
    Static = 1,
    /// Material points.
    Mpm = 2,
    /// At rest, until something comes near.
    Asleep = 3,
    /// One body.
    Rigid = 4,
    /// Nothing is left of it: its particles left the domain or were frozen.
    Gone = 6,
    /// A command removed it, or has yet to bring it in.
    Removed = 7,
}

/// Why a solid went over to the spatial grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum OverReason {
    /// Some point has a plastic strain of more than 2.
    #[default]
    Flow,
    /// A command gave it, or a region of it, a law that no solid has.
    Law,
    /// A command gave a patch of it another material.
    Patch,
}

/// A solid that went over to the spatial grid, with its momentum.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct GoneOver {
    /// Object id.
    pub object: usize,
    /// Why it did.
    pub reason: OverReason,
    /// Largest equivalent plastic strain of any of its points.
    pub plastic_strain: f64,
    /// Angular momentum about the world origin that it has more than before [kg m^2/s].
    pub angular_momentum: [f64; 3],
    /// Kinetic and elastic energy that it has more than before [J].
    pub energy: f64,
}

/// Contact of two objects that deform, or one of which does, from first touch to parting. Speeds are those of their rigid motions at the
/// place of contact, along its mean normal.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct ContactEpisode {
    /// Object ids, the lower first.
    pub objects: [usize; 2],
    /// Impulse that the second received [N s].
    pub impulse: [f64; 3],
    /// Speed of approach at first touch [m/s].
    pub speed_before: f64,
    /// Speed of parting [m/s]; 0 when they stay together.
    pub speed_after: f64,
    /// Whether they stay together: reported once, when that is clear.
    pub lasting: bool,
    /// `speed_after / speed_before`, as deformation left it; absent when they stay together, and when their rigid motions did not
    /// approach: vibration made them touch.
    pub restitution: Option<f64>,
    /// From first touch to the report [s].
    pub duration: f64,
    /// Simulated time of the report [s].
    pub time: f64,
}

/// Moments of one object (paper equation 2, with inertia and spin).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct ObjectState {
    /// How it is modelled.
    pub level: Level,
    /// Mass [kg]; 0 for static objects.
    pub mass: f64,
    /// Centre of mass [m].
    pub com: [f64; 3],
    /// Velocity of the centre of mass [m/s].
    pub linear_velocity: [f64; 3],
    /// Angular momentum about the centre of mass incl. the affine part [kg m^2/s].
    pub angular_momentum: [f64; 3],
    /// Angular velocity: `(inertia + dx^2/2 mass)^-1` x angular momentum [rad/s]; the second term is the affine
    /// part's share, which makes this exact for rigid motion.
    pub angular_velocity: [f64; 3],
    /// Inertia about the centre of mass xx xy xz yy yz zz [kg m^2].
    pub inertia: [f64; 6],
    /// Mean rotation since rest (polar part of the mass-weighted mean of F), unit quaternion xyzw.
    pub rotation: [f64; 4],
    /// Effective radius: root of 5/3 of the mass-weighted mean square distance from the COM [m]
    /// (exact for a solid ball).
    pub radius: f64,
    /// Kinetic energy incl. the affine part [J].
    pub kinetic_energy: f64,
    /// Elastic energy, that which contacts of solids hold with it [J].
    pub elastic_energy: f64,
    /// Impulse received from colliders and other objects in this frame [N s]: momentum change less gravity
    /// and commands.
    pub contact_impulse: [f64; 3],
}
