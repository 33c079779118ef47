//! The kernel's speed with the materials of a scene: a block of each falls onto a floor, as in `cosplat bench kernel`.

use cosplat_sim_core::{
    Isa, Scene,
    materials::{Law, Material},
    scene::Fidelity,
};

use crate::kernel::{Case, Quartiles, Runner};

/// Particles of the block: enough to leave the fast caches.
const PARTICLES: u32 = 1 << 17;
/// Frames; the median counts.
const ROUNDS: usize = 5;

/// Speeds found so far.
#[derive(Default)]
pub struct KernelRates(Vec<(Material, u16, f64)>);

impl KernelRates {
    /// Speed of the kernel with the scene's materials, as its particles are shared among them [million updates/s];
    /// `None` where nothing is simulated on the grid.
    ///
    /// # Errors
    /// When no threads can be started.
    pub fn of_scene(&mut self, scene: &Scene, threads: u16) -> anyhow::Result<Option<f64>> {
        let (mut particles, mut seconds) = (0.0, 0.0);
        for part in scene.parts() {
            let static_or_rigid = matches!(
                scene.objects[part.object].fidelity,
                Fidelity::Static | Fidelity::Rigid
            );
            if static_or_rigid || part.material.law == Law::Rigid || part.particles.is_empty() {
                continue;
            }
            let count = part.particles.len() as f64;
            particles += count;
            seconds += count / self.of(&part.material, threads)?;
        }
        Ok((particles > 0.0).then(|| particles / seconds))
    }

    fn of(&mut self, material: &Material, threads: u16) -> anyhow::Result<f64> {
        let known = self
            .0
            .iter()
            .find(|(m, n, _)| m == material && *n == threads);
        if let Some((_, _, rate)) = known {
            return Ok(*rate);
        }
        let case = Case {
            particles: PARTICLES,
            per_cell: 8,
            threads,
            isa: Isa::detect(),
            gaussians: false,
        };
        let mut runner = Runner::new(material.clone(), &case)?;
        for _ in 0..ROUNDS {
            runner.run(threads);
        }
        let rate = Quartiles::of(runner.rates).median;
        self.0.push((material.clone(), threads, rate));
        Ok(rate)
    }
}
