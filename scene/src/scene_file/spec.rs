//! What a scene file says, checked line by line but with no asset read yet.

pub use super::regions::{RegionSelect, RegionSpec};

use cosplat_sim_core::{
    expression::VectorField,
    materials::Material,
    scene::{
        Aabb, Coherence, Collider, ContactSurface, DomainPolicy, Fidelity, PinnedRegion,
        PrescribedMotion, Region, RegionImpulse, SequentialRelease, Solver, Transfer, TurnedBox,
    },
};

use super::{
    contact::ContactSpec,
    error::{At, Finding},
    view::View,
};

/// A parsed scene file, SI units. `docs/scene.md` is the reference of the text format.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// Name for reports.
    pub name: String,
    /// Gravitational acceleration [m/s^2].
    pub gravity: [f64; 3],
    /// How fine the grid is.
    pub resolution: Resolution,
    /// Where [`resolution`](Self::resolution) stands.
    pub resolution_at: At,
    /// Particles per filled grid cell, 1..=64.
    pub particles_per_cell: f64,
    /// Published frames per simulated second [1/s].
    pub frame_rate: f64,
    /// Fraction of the stability limit, 0 < cfl <= 1.5.
    pub cfl: f64,
    /// See [`Scene::tolerance`](cosplat_sim_core::scene::Scene::tolerance).
    pub tolerance: f64,
    /// How far particles sit off their lattice at most, in spacings, 0..=0.5.
    pub jitter: f64,
    /// Seed of everything sampled.
    pub seed: u64,
    /// Domain; derived from the objects when absent.
    pub domain: Option<Aabb>,
    /// Assets, those named in the file and those written at their object.
    pub assets: Vec<AssetSpec>,
    /// Objects.
    pub objects: Vec<ObjectSpec>,
    /// How they meet.
    pub contact: ContactSpec,
    /// Rigid boundaries.
    pub colliders: Vec<ColliderSpec>,
    /// Boxes whose grid nodes are held or moved.
    pub pinned_regions: Vec<PinnedRegion>,
    /// What is prescribed for particles, and at the faces of the domain.
    pub conditions: ConditionSpecs,
    /// Probes.
    pub probes: Vec<ProbeSpec>,
    /// How it is shown.
    pub view: Option<View>,
    /// What is valid but suspicious.
    pub warnings: Vec<Finding>,
}

/// How the grid cell size is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Resolution {
    /// Cell size [m].
    Dx(f64),
    /// Cells along the longest side of the smallest simulated object.
    CellsPerObject(f64),
}

/// A splat asset placed in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct AssetSpec {
    /// Name; empty for assets written at their object.
    pub name: String,
    /// Where it stands.
    pub at: At,
    /// Where the Gaussians come from.
    pub source: AssetSource,
    /// File that says which object each belongs to, relative to the scene file.
    pub objects: Option<String>,
    /// Gaussians with less opacity are left out, 0..=1.
    pub min_opacity: f64,
    /// Asset units to world.
    pub placement: Placement,
}

/// Where the Gaussians of an asset come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AssetSource {
    /// A file, relative to the scene file.
    Path(String),
    /// An asset that cosplat generates.
    Builtin(String),
}

/// Turns and sizes geometry and puts it somewhere, in the order of the fields.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Axis of the geometry that becomes the world's +y.
    pub up: Axis,
    /// Size.
    pub size: Size,
    /// Point that rotation turns about and that lands at `translation`.
    pub anchor: Anchor,
    /// Rotation, unit quaternion xyzw.
    pub rotation: [f64; 4],
    /// Position of the anchor [m].
    pub translation: [f64; 3],
}

impl Default for Placement {
    fn default() -> Self {
        Self {
            up: Axis::Y,
            size: Size::Factor(1.0),
            anchor: Anchor::Origin,
            rotation: [0.0, 0.0, 0.0, 1.0],
            translation: [0.0; 3],
        }
    }
}

/// A signed coordinate axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Axis {
    X,
    Y,
    Z,
    NegX,
    NegY,
    NegZ,
}

/// How geometry is scaled to metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Size {
    /// Metres per unit.
    Factor(f64),
    /// Height of the box of Gaussian centres along the up axis [m].
    Height(f64),
}

/// A point of the geometry's box (of Gaussian centres), after `up` and `size`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// The geometry's own origin.
    Origin,
    /// Centre of the box.
    Center,
    /// Centre of the bottom face of the box.
    Bottom,
}

/// One `[[objects]]` entry.
#[derive(Clone, Debug)]
pub struct ObjectSpec {
    /// Unique name.
    pub name: String,
    /// Where it stands.
    pub at: At,
    /// What it looks like at rest.
    pub geometry: Geometry,
    /// Where the geometry, or the selection from it, is given.
    pub geometry_at: At,
    /// Whether the geometry is another object's.
    pub is_clone: bool,
    /// On top of the asset's placement, after the selection.
    pub placement: Placement,
    /// Material; a placeholder for static objects.
    pub material: Material,
    /// Parts of it with another material.
    pub regions: Vec<RegionSpec>,
    /// How its surface answers to other objects.
    pub surface: ContactSurface,
    /// What holds it together besides its matter.
    pub coherence: Option<Coherence>,
    /// Whether it is there from the beginning; otherwise it is away until a command brings it in.
    pub present: bool,
    /// Whether it is simulated.
    pub fidelity: Fidelity,
    /// Which grid its matter is on; chosen for the finished scene when absent.
    pub solver: Option<Solver>,
    /// Where its particles come from.
    pub particles: ParticleMode,
    /// Initial velocity of the centre of mass [m/s].
    pub linear_velocity: [f64; 3],
    /// Initial spin [rad/s].
    pub angular_velocity: [f64; 3],
    /// Initial affine velocity on top of the spin [1/s], row-major.
    pub velocity_gradient: [[f64; 3]; 3],
    /// Initial velocity on top of these [m/s].
    pub velocity: Option<VectorField>,
    /// Acceleration [m/s^2].
    pub body_force: Option<VectorField>,
}

/// What an object looks like at rest.
#[derive(Clone, Debug, PartialEq)]
pub enum Geometry {
    /// Gaussians of an asset.
    Asset {
        /// Index into [`SceneFile::assets`].
        asset: usize,
        /// Which of them; all when absent.
        select: Option<Select>,
        /// Makes several objects of them.
        split: Option<Split>,
    },
    /// A primitive shape, centred at its origin.
    Shape {
        /// Which.
        shape: Shape,
        /// Thickness of its wall where it is hollow [m], after `scale`.
        wall: Option<f64>,
        /// Colour of its Gaussians, RGB 0..=1.
        color: [f32; 3],
        /// Distance between its Gaussians [m]; derived from its area when absent.
        gaussian_spacing: Option<f64>,
    },
    /// Triangles of a file.
    Mesh {
        /// File, relative to the scene file.
        path: String,
        /// Thickness of its wall where it is hollow [m], after `scale`.
        wall: Option<f64>,
        /// Colour of its Gaussians, RGB 0..=1.
        color: [f32; 3],
        /// Distance between its Gaussians [m]; derived from its area when absent.
        gaussian_spacing: Option<f64>,
    },
}

/// Which Gaussians of an asset belong to an object.
#[derive(Clone, Debug, PartialEq)]
pub enum Select {
    /// Index ranges `first..end` in the order of the file.
    Ranges(Vec<[u64; 2]>),
    /// Values of the asset's semantic id (a feature vector of length 1, `f_sem_0`).
    Ids(Vec<u64>),
    /// Objects of the asset's file of objects, with all their parts.
    Names(Vec<String>),
    /// Whatever belongs to an object of that file.
    Objects,
    /// Boxes in the world frame, after the asset's placement [m].
    Boxes(Vec<TurnedBox>),
    /// The n-th largest connected component, from 0.
    Component(usize, Link),
    /// Whatever no other object of the asset selects.
    Rest,
}

/// Makes one object per part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Split {
    /// Per connected component.
    Components(Link),
    /// Per semantic id.
    Ids,
    /// Per object of the asset's file of objects, parts with what they are part of.
    Objects,
}

/// When Gaussians are connected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// Cell size of the connection test [m]; by which neighbours touch when absent.
    pub distance: Option<f64>,
    /// Smaller components are left out.
    pub min_gaussians: usize,
}

/// Primitive shapes; lengths in metres before `scale`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Full edge lengths.
    Box {
        /// Along x, y, z [m].
        size: [f64; 3],
    },
    /// Ball.
    Sphere {
        /// Radius [m].
        radius: f64,
    },
    /// Upright along y.
    Cylinder {
        /// Radius [m].
        radius: f64,
        /// Radius of the hole along the axis [m], 0 <= inner_radius < radius.
        inner_radius: f64,
        /// Height [m].
        height: f64,
    },
    /// Flat box whose top face lies in the plane y = 0: a table top or a floor.
    Slab {
        /// Edge lengths along x and z [m].
        size: [f64; 2],
        /// Thickness, downwards [m].
        thickness: f64,
    },
}

/// Where the particles of a simulated asset come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParticleMode {
    /// The volume behind the surface is filled.
    Filled {
        /// A cavity that is open only below counts as closed: cameras did not see the underside.
        closed_below: bool,
    },
    /// One particle at every Gaussian.
    PerGaussian,
}

/// One `[[colliders]]` entry.
#[derive(Clone, Debug)]
pub struct ColliderSpec {
    /// Where it stands.
    pub at: At,
    /// The collider; a mesh is empty until building reads it.
    pub collider: Collider,
    /// Where the mesh comes from, when it is one.
    pub mesh: Option<MeshSpec>,
}

/// A mesh file and how it gets into the collider's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshSpec {
    /// File, relative to the scene file.
    pub path: String,
    /// Size, up axis and anchor go into the mesh; rotation and translation are the collider's pose.
    pub placement: Placement,
}

/// Everything prescribed for particles, with objects by name; the selections inside are filled when building.
#[derive(Clone, Debug, Default)]
pub struct ConditionSpecs {
    /// What the faces of the domain do.
    pub domain_policy: DomainPolicy,
    /// See [`Conditions::damping`](cosplat_sim_core::scene::Conditions::damping).
    pub damping: f64,
    /// See [`Conditions::settle`](cosplat_sim_core::scene::Conditions::settle).
    pub settle: f64,
    /// See [`Conditions::transfer`](cosplat_sim_core::scene::Conditions::transfer).
    pub transfer: Transfer,
    /// See [`Conditions::rpic_damping`](cosplat_sim_core::scene::Conditions::rpic_damping).
    pub rpic_damping: f64,
    /// See [`Conditions::prescribed`](cosplat_sim_core::scene::Conditions::prescribed).
    pub prescribed: Vec<(SelectionSpec, PrescribedMotion)>,
    /// See [`Conditions::impulses`](cosplat_sim_core::scene::Conditions::impulses).
    pub impulses: Vec<(SelectionSpec, RegionImpulse)>,
    /// See [`Conditions::releases`](cosplat_sim_core::scene::Conditions::releases).
    pub releases: Vec<(SelectionSpec, SequentialRelease)>,
}

/// Which particles are meant; see [`Selection`](cosplat_sim_core::scene::Selection).
#[derive(Clone, Debug, PartialEq)]
pub struct SelectionSpec {
    /// Where it stands.
    pub at: At,
    /// Name of an object.
    pub object: Option<String>,
    /// A region.
    pub region: Option<Region>,
}

/// A reported quantity; objects by name, because splitting makes objects.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeSpec {
    /// Unique name.
    pub name: String,
    /// Where it stands.
    pub at: At,
    /// What is measured.
    pub kind: ProbeKindSpec,
}

/// What a probe measures; see [`ProbeKind`](cosplat_sim_core::scene::ProbeKind).
#[derive(Clone, Debug, PartialEq)]
pub enum ProbeKindSpec {
    /// Box of an object.
    Extent {
        /// Object name.
        object: String,
        /// Part of its volume that is not beyond a face.
        share: f64,
    },
    /// A fixed point in space.
    Point {
        /// Where [m].
        position: [f64; 3],
    },
    /// An object against where it should be.
    Deviation {
        /// Object name.
        object: String,
        /// Where its particles should be [m].
        position: VectorField,
        /// Only particles that are in this box at rest [m].
        bounds: Option<TurnedBox>,
    },
    /// A particle of an object.
    MaterialPoint {
        /// Object name.
        object: String,
        /// Rest position [m].
        position: [f64; 3],
    },
}
