//! What happens to objects in a run that people should hear of, and hear of once.

use crate::{
    materials::limits::{DeformationBounds, critical_dt},
    report::{Level, OverReason, StepReport},
    scene::{Scene, Solver},
};

/// How many times as short as at rest substeps of a solid are from which on that is said.
const SHORT: f64 = 16.0;

/// Remembers what was said.
#[derive(Clone, Debug)]
pub struct Notices {
    /// Whether nothing was left of each object.
    gone: Vec<bool>,
    /// Whether substeps were said to be short.
    says_short: bool,
    /// Simulated time of the latest report [s].
    time: f64,
}

impl Notices {
    /// Of a run of this scene of which nothing has been said yet.
    pub fn new(scene: &Scene) -> Self {
        Self {
            gone: vec![false; scene.objects.len()],
            says_short: false,
            time: 0.0,
        }
    }

    /// Sentences about what a report of the scene's run says first: an object of which nothing is left, one that went over to the spatial
    /// grid, one that is crushed. After a reset they may be said again.
    pub fn of(&mut self, scene: &Scene, report: &StepReport) -> Vec<String> {
        let mut sentences = Vec::new();
        let time = report.sim_time;
        if time < self.time {
            self.gone.fill(false);
            self.says_short = false;
        }
        self.time = time;
        let objects = self.gone.iter_mut().zip(&report.objects);
        for ((was_gone, state), object) in objects.zip(&scene.objects) {
            let is_gone = state.level == Level::Gone;
            if is_gone && !*was_gone {
                sentences.push(format!(
                    "nothing is left of object `{}` at {time:.3} s: its {} particles left the domain or were frozen",
                    object.name,
                    object.particles.len()
                ));
            }
            *was_gone = is_gone;
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
