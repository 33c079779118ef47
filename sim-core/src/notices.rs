//! What happens to objects in a run that people should hear of, and hear of once.

use crate::{
    materials::limits::{DeformationBounds, bridged_stretch, critical_dt},
    report::{Level, OverReason, StepReport},
    scene::{Scene, Solver},
};

/// How many times as short as at rest substeps of a solid are from which on that is said.
const SHORT: f64 = 16.0;

/// Remembers what was said.
#[derive(Clone, Debug)]
pub struct Notices {
    objects: Vec<Said>,
    /// Whether substeps were said to be short.
    says_short: bool,
    /// Simulated time of the latest report [s].
    time: f64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Said {
    is_gone: bool,
    is_torn: bool,
}

impl Notices {
    /// Of a run of this scene of which nothing has been said yet.
    pub fn new(scene: &Scene) -> Self {
        Self {
            objects: vec![Said::default(); scene.objects.len()],
            says_short: false,
            time: 0.0,
        }
    }

    /// Sentences about what a report of the scene's run says first: an object of which nothing is left, one that fell apart or is crushed,
    /// impacts that were not searched for. After a reset they may be said again.
    pub fn of(&mut self, scene: &Scene, report: &StepReport) -> Vec<String> {
        let mut sentences = Vec::new();
        let time = report.sim_time;
        if time < self.time {
            self.objects.fill(Said::default());
            self.says_short = false;
        }
        self.time = time;
        let objects = self.objects.iter_mut().zip(&report.objects);
        for ((said, state), object) in objects.zip(&scene.objects) {
            let is_gone = state.level == Level::Gone;
            if is_gone && !said.is_gone {
                sentences.push(format!(
                    "nothing is left of object `{}` at {time:.3} s: its {} particles left the domain or were frozen",
                    object.name,
                    object.particles.len()
                ));
            }
            said.is_gone = is_gone;
        }
        for gone in &report.gone_over {
            if let Some(object) = scene.objects.get(gone.object) {
                let why = match gone.reason {
                    OverReason::Flow => {
                        format!("its largest plastic strain is {:.2}", gone.plastic_strain)
                    }
                    OverReason::Law => "a command gave it a law that no solid has".into(),
                    OverReason::Patch => "a command painted a patch of it".into(),
                };
                let name = &object.name;
                sentences.push(format!(
                    "object `{name}` goes over to the spatial grid at {time:.3} s: {why}"
                ));
            }
        }
        for torn in &report.torn {
            let (Some(said), Some(object)) = (
                self.objects.get_mut(torn.object),
                scene.objects.get(torn.object),
            ) else {
                continue;
            };
            if std::mem::replace(&mut said.is_torn, true) {
                continue;
            }
            let volumes = &scene.particles.volume[object.particles.clone()];
            let per_cell = volumes.len() as f64 * scene.dx.powi(3) / volumes.iter().sum::<f64>();
            sentences.push(format!(
                "object `{}` is torn at {time:.3} s: it is in {} pieces, {:.2} % of it is not in the largest. Its law does not \
                 tear: it was stretched by more than its {per_cell:.0} particles per cell bridge, about {:.1}",
                object.name,
                torn.pieces,
                100.0 * torn.apart,
                bridged_stretch(per_cell)
            ));
        }
        if !self.says_short
            && let Some(sentence) = short_substeps(scene, report)
        {
            sentences.push(sentence);
            self.says_short = true;
        }
        sentences
    }
}

/// A sentence about a solid whose substeps are far shorter than at rest, if one is so.
fn short_substeps(scene: &Scene, report: &StepReport) -> Option<String> {
    let object = scene.objects.get(report.dt_object?)?;
    let materials = object.materials();
    let rest = DeformationBounds::REST;
    let at_rest = materials.map(|m| critical_dt(m, m.density, scene.dx, &rest));
    let times = scene.cfl * at_rest.fold(f64::INFINITY, f64::min) / report.dt_min;
    if object.solver != Solver::Lagrangian || times.is_nan() || times < SHORT {
        return None;
    }
    Some(format!(
        "frames take long from {:.3} s on: object `{}` is crushed or torn so much that substeps are {times:.0} times as short as at \
         rest. Start it beside what it is in, press it more slowly, or give it a softer material or larger cells",
        report.sim_time, object.name
    ))
}
