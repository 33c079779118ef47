//! Materials: the laws of the original in the terms of the scene format.

use crate::{
    config::{Config, Kind, Material},
    notes::{NoteKind, Notes},
};

/// Young's modulus below which a unit is probably wrong [Pa]: forks store it divided by ten million.
const SUSPICIOUS: f64 = 100.0;
/// Range of Young's modulus that a scene file takes [Pa].
const MODULI: (f64, f64) = (1e-3, 1e13);
/// What a material without stress gets: the least that the scene format takes [Pa].
const STRESS_FREE: f64 = 1e-3;
/// Angles of friction that the law of sand takes [degrees].
const FRICTION: (f64, f64) = (1.0, 60.0);
/// Steepest softening of plasticine per shear modulus, just below what the law takes.
const STEEPEST: f64 = 2.69;
/// Substeps of an explicit method are unstable beyond this part of a cell that sound crosses in one.
const COURANT_LIMIT: f64 = 1.0;

/// A material of the scene: lines of a TOML table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Lines(pub Vec<String>);

/// Numbers that regions change.
#[derive(Clone, Copy, Debug)]
pub(super) struct Elastic {
    pub youngs_modulus: f64,
    pub nu: f64,
    pub density: f64,
}

impl Elastic {
    fn mu(&self) -> f64 {
        self.youngs_modulus / (2.0 * (1.0 + self.nu))
    }

    fn lambda(&self) -> f64 {
        self.youngs_modulus * self.nu / ((1.0 + self.nu) * (1.0 - 2.0 * self.nu))
    }

    /// Courant number of a substep: cells that a pressure wave crosses.
    pub fn courant(&self, dt: f64, dx: f64) -> f64 {
        dt / dx * ((self.lambda() + 2.0 * self.mu()) / self.density).sqrt()
    }
}

/// Multiplies Young's moduli and doubts what remains small; warns where the original's step is too long.
pub(super) fn check_stiffness(config: &mut Config, multiplier: Option<f64>, notes: &mut Notes) {
    let (dt, dx) = (config.substep_dt, config.dx());
    let base = &mut config.material;
    let mut all = vec![(
        String::new(),
        &mut base.youngs_modulus,
        base.nu,
        base.density,
    )];
    for region in &mut config.regions {
        let prefix = format!("{}.", region.key);
        all.push((
            prefix,
            &mut region.youngs_modulus,
            region.nu,
            region.density,
        ));
    }
    for (prefix, modulus, nu, density) in all {
        let key = format!("{prefix}E");
        let old = *modulus;
        if let Some(multiplier) = multiplier {
            *modulus *= multiplier;
            notes.add(
                NoteKind::Changed,
                &key,
                old,
                *modulus,
                "times --e-multiplier",
            );
        }
        if *modulus < SUSPICIOUS {
            notes.warn(
                &key,
                *modulus,
                "softer than any solid one can hold; DreamPhysics and Physics3D store Pa divided by 1e7: try \
                 --e-multiplier 1e7",
            );
        }
        let taken = modulus.clamp(MODULI.0, MODULI.1);
        if taken != *modulus {
            notes.add(
                NoteKind::Changed,
                &key,
                *modulus,
                taken,
                "the nearest modulus that a scene file takes [Pa]",
            );
            *modulus = taken;
        }
        let elastic = Elastic {
            youngs_modulus: *modulus,
            nu,
            density,
        };
        let courant = elastic.courant(dt, dx);
        if courant > COURANT_LIMIT {
            notes.warn(
                format!("{prefix}substep_dt").trim_start_matches('.'),
                dt,
                format!(
                    "the original's step is unstable here: sound crosses {courant:.2} cells in it. The step is chosen \
                     from the stability limit here"
                ),
            );
        }
    }
}

/// Lines of the material of an object or region. `key` is the path of the entry that the numbers come from, with the
/// dot behind it.
pub(super) fn lines(
    kind: Kind,
    elastic: Elastic,
    base: &Material,
    compat: bool,
    notes: Option<&mut Notes>,
) -> Lines {
    let mut unheard = Notes::default();
    let notes = notes.unwrap_or(&mut unheard);
    let mut lines = Writer::default();
    match kind {
        Kind::Jelly | Kind::Stationary => lines.law("fixed_corotated", elastic),
        Kind::Metal => metal(&mut lines, elastic, base, compat, notes),
        Kind::Sand => sand(&mut lines, elastic, base, notes),
        Kind::Foam => foam(&mut lines, elastic, base, notes),
        Kind::Snow => snow(&mut lines, elastic, compat, notes),
        Kind::Plasticine => plasticine(&mut lines, elastic, base, compat, notes),
        Kind::Fluid => fluid(&mut lines, elastic, base, notes),
    }
    Lines(lines.lines)
}

#[derive(Default)]
struct Writer {
    lines: Vec<String>,
}

impl Writer {
    fn law(&mut self, law: &str, elastic: Elastic) {
        self.lines.push(format!("law = \"{law}\""));
        self.number("youngs_modulus_pa", elastic.youngs_modulus, "E");
        self.number("poisson_ratio", elastic.nu, "nu");
        self.number("density_kg_m3", elastic.density, "density");
    }

    fn number(&mut self, key: &str, value: f64, from: &str) {
        self.lines.push(format!("{key} = {value:?} # {from}"));
    }
}

/// Von Mises threshold on the Frobenius norm of the deviatoric stress: that of a tension test times sqrt(2/3).
fn yield_stress(base: &Material, compat: bool, notes: &mut Notes) -> f64 {
    let stated = base.yield_stress;
    let literal = stated * 1.5f64.sqrt();
    if compat {
        notes.add(
            NoteKind::Reproduced,
            "yield_stress",
            stated,
            literal,
            "the original compares it with the norm of the deviatoric stress: a yield stress in tension that is \
             sqrt(3/2) higher",
        );
        return literal;
    }
    notes.add(
        NoteKind::Corrected,
        "yield_stress",
        stated,
        stated,
        format!(
            "taken as the yield stress in tension. The original leaves out the factor sqrt(2/3) of von Mises, which \
             makes the same number {literal:.6} Pa; --compat repeats that"
        ),
    );
    stated
}

/// Change of the yield stress per equivalent plastic strain, of one per norm of the plastic strain, which is
/// sqrt(3/2) larger.
fn per_equivalent_strain(slope: f64, compat: bool) -> f64 {
    let slope = slope * 1.5f64.sqrt();
    // As above: of the yield stress itself, or of its sqrt(2/3).
    if compat { slope * 1.5f64.sqrt() } else { slope }
}

/// `yield += 2 mu xi dgamma`, when `hardening` is 1.
fn hardening(elastic: Elastic, base: &Material, compat: bool) -> f64 {
    if base.hardens {
        per_equivalent_strain(2.0 * elastic.mu() * base.xi, compat)
    } else {
        0.0
    }
}

fn doubt_no_yield_stress(base: &Material, notes: &mut Notes) {
    if base.yield_stress == 0.0 {
        notes.warn(
            "yield_stress",
            base.yield_stress,
            "nothing resists a change of shape: the object flows like water",
        );
    }
}

fn metal(lines: &mut Writer, elastic: Elastic, base: &Material, compat: bool, notes: &mut Notes) {
    lines.law("von_mises", elastic);
    doubt_no_yield_stress(base, notes);
    let from = if compat {
        "yield_stress sqrt(3/2)"
    } else {
        "yield_stress"
    };
    lines.number("yield_stress_pa", yield_stress(base, compat, notes), from);
    let slope = hardening(elastic, base, compat);
    lines.number("hardening_pa", slope.max(0.0), "hardening, xi");
    if slope < 0.0 {
        notes.ignore("xi", base.xi, "a metal that softens has no law here");
    } else if base.hardens {
        notes.add(
            NoteKind::Changed,
            "xi",
            base.xi,
            slope,
            "growth of the yield stress per equivalent plastic strain [Pa]",
        );
    }
    hencky(compat, notes);
}

fn hencky(compat: bool, notes: &mut Notes) {
    let message = "the original multiplies each principal Kirchhoff stress once more by its stretch; the stress here \
                   is that of the Hencky energy, equal where stretches are near 1";
    if compat {
        notes.add(
            NoteKind::Corrected,
            "material",
            "stress times stretch",
            "Hencky stress",
            format!("{message}. Corrected with --compat as well: the solver has no such law"),
        );
    } else {
        notes.add(
            NoteKind::Corrected,
            "material",
            "stress times stretch",
            "Hencky stress",
            message,
        );
    }
}

fn sand(lines: &mut Writer, elastic: Elastic, base: &Material, notes: &mut Notes) {
    lines.law("drucker_prager", elastic);
    let angle = base.friction_angle.clamp(FRICTION.0, FRICTION.1);
    if angle != base.friction_angle {
        notes.add(
            NoteKind::Changed,
            "friction_angle",
            base.friction_angle,
            angle,
            "the law is made for angles that sand has",
        );
    }
    lines.number("friction_angle_deg", angle, "friction_angle");
    lines.number("cohesion", 0.0, "dry");
    notes.add(
        NoteKind::Changed,
        "material",
        "sand",
        "drucker_prager",
        "with volume correction, which the original leaves out: sand that was torn apart does not swell when it comes \
         together again",
    );
}

fn foam(lines: &mut Writer, elastic: Elastic, base: &Material, notes: &mut Notes) {
    lines.law("foam", elastic);
    doubt_no_yield_stress(base, notes);
    lines.number("yield_stress_pa", base.yield_stress, "yield_stress");
    let viscosity = 0.5 * base.plastic_viscosity;
    lines.number("viscosity_pa_s", viscosity, "plastic_viscosity / 2");
    notes.add(
        NoteKind::Changed,
        "plastic_viscosity",
        base.plastic_viscosity,
        viscosity,
        "half of it: the original's relates norms of stress and strain rate, where a viscosity is that of simple shear",
    );
    lines.number("exponent", 1.0, "the original is linear in the rate");
    hencky(false, notes);
}

fn snow(lines: &mut Writer, elastic: Elastic, compat: bool, notes: &mut Notes) {
    if compat {
        lines.law(
            "fixed_corotated",
            Elastic {
                youngs_modulus: STRESS_FREE,
                ..elastic
            },
        );
        notes.add(
            NoteKind::Reproduced,
            "material",
            "snow",
            "fixed_corotated",
            format!(
                "the original has no snow: neither return map nor stress. {STRESS_FREE} Pa is as good as none"
            ),
        );
        return;
    }
    lines.law("snow", elastic);
    // Stomakhin et al. 2013, table 2.
    lines.number(
        "critical_compression",
        0.025,
        "not in the configuration: Stomakhin et al. 2013",
    );
    lines.number(
        "critical_stretch",
        0.0075,
        "not in the configuration: Stomakhin et al. 2013",
    );
    lines.number(
        "hardening",
        10.0,
        "not in the configuration: Stomakhin et al. 2013",
    );
    notes.add(
        NoteKind::Corrected,
        "material",
        "snow",
        "snow",
        "the original accepts the name and computes no stress; here it is the snow of Stomakhin et al. 2013 with their \
         limits",
    );
}

fn plasticine(
    lines: &mut Writer,
    elastic: Elastic,
    base: &Material,
    compat: bool,
    notes: &mut Notes,
) {
    lines.law("plasticine", elastic);
    doubt_no_yield_stress(base, notes);
    let from = if compat {
        "yield_stress sqrt(3/2)"
    } else {
        "yield_stress"
    };
    lines.number("yield_stress_pa", yield_stress(base, compat, notes), from);
    let slope = per_equivalent_strain(base.softening, compat) - hardening(elastic, base, compat);
    let steepest = STEEPEST * elastic.mu();
    lines.number(
        "softening",
        slope.clamp(0.0, steepest),
        "softening, hardening, xi",
    );
    notes.add(
        NoteKind::Changed,
        "softening",
        base.softening,
        slope.clamp(0.0, steepest),
        "loss of yield stress per equivalent plastic strain [Pa]",
    );
    if slope < 0.0 {
        notes.ignore(
            "xi",
            base.xi,
            "plasticine that hardens more than it softens has no law here",
        );
    } else if slope > steepest {
        notes.warn(
            "softening",
            base.softening,
            format!("the strength would fall faster than elastic strain takes it up: {steepest} Pa is used"),
        );
    }
    notes.add(
        NoteKind::Changed,
        "material",
        "plasticine",
        "plasticine",
        "the original's stress is fixed corotated, here that of the Hencky energy; equal where stretches are near 1",
    );
}

fn fluid(lines: &mut Writer, elastic: Elastic, base: &Material, notes: &mut Notes) {
    let derived = elastic.lambda() + 2.0 / 3.0 * elastic.mu();
    let (modulus, from) = if base.bulk_modulus > 0.0 {
        (base.bulk_modulus, "bulk_modulus")
    } else {
        (derived, "E, nu")
    };
    if base.bulk_modulus > 0.0 {
        notes.add(
            NoteKind::Corrected,
            "bulk_modulus",
            base.bulk_modulus,
            modulus,
            format!(
                "used as it is; warp-mpm replaces it by {derived:.6e} Pa, from E and nu, when it derives all moduli"
            ),
        );
    } else {
        notes.add(
            NoteKind::Changed,
            "bulk_modulus",
            base.bulk_modulus,
            modulus,
            "from E and nu, as warp-mpm derives it",
        );
    }
    lines.lines.push("law = \"fluid\"".into());
    lines.number("bulk_modulus_pa", modulus, from);
    lines.number(
        "viscosity_pa_s",
        base.plastic_viscosity,
        "plastic_viscosity",
    );
    lines.number("density_kg_m3", elastic.density, "density");
}
