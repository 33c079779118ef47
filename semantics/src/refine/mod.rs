//! Equation (1) as refinement: `l1 L_visual + l2 L_semantic` by gradient, from the closed form.
//!
//! `observe` reads what a view shows; `loss` has the two terms, `model` their gradients and steps; `split` parts Gaussians
//! that straddle two objects.
//! Every eighth view is held out. What comes out is the state that was best on these, and none that is worse there than the
//! beginning in either term, but for the 0.1 dB that splitting may cost.

mod loss;
mod model;
mod observe;
mod split;

pub use observe::{observe, picture};

use cosplat_scene::assets::Gaussians;

use crate::View;
use glam::Vec2;
use model::{Model, Moments, Rates};
use split::{Cut, Side};

/// Every how many views one is held out.
const HOLD_OUT: usize = 8;
/// Rounds over the views without a better state before refinement ends.
const PATIENCE: usize = 4;
/// Rates of the first round, as in the training of splats (Kerbl et al. 2023) but a fifth of it for what it has trained;
/// the position's is over the extent of the cameras.
const RATES: Rates = Rates {
    position: 3e-5,
    scale: 1e-3,
    rotation: 2e-4,
    opacity: 1e-2,
    color: 5e-4,
    feature: 5e-3,
};
/// Rates of the last round over those of the first.
const DECAY: f32 = 0.05;
/// Weight that the prior of a feature has in a view [pixel].
const PRIOR: f32 = 0.1;
/// Less weight of an object in a view does not say where it is [pixel].
const SEEN: f32 = 0.05;
/// Rounds of cutting what straddles, then rounds of fading what still does, and rounds over the views after each.
const CUTS: usize = 2;
const FADES: usize = 3;
const AFTER_SPLIT: usize = 6;
/// Extent of a part across its cut over that of its side of a normal distribution, whose tail reaches across the cut.
const SHARP: f64 = 0.9;
/// Opacity of what fades over what it had. What two cuts did not part is smaller than what a plane parts on the screen; where
/// pictures need it, the gradient brings it back.
const FADE: f32 = 0.25;
/// Share that is not of the largest object within single views, from which on a straddler fades. Masks that are off are one
/// object's in this view and another's in that: what they say says nothing against matter.
const MIXED: f32 = 0.15;
/// What splitting may cost [dB].
const SPLIT_COST: f64 = 0.1;

/// What a user may set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// `l1` and `l2` of equation (1), >= 0.
    pub weights: [f32; 2],
    /// Share of D-SSIM in the visual term, 0..=1.
    pub dssim: f32,
    /// Most rounds over the views.
    pub rounds: usize,
    /// Whether straddlers are split.
    pub split: bool,
    /// Colour behind the splat, 0..=1.
    pub background: [f32; 3],
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            weights: [1.0, 0.1],
            dssim: 0.2,
            rounds: 20,
            split: true,
            background: [0.93; 3],
        }
    }
}

impl Settings {
    /// About as many views as a refinement of `views` of them looks at, if it does not end early: the length of its progress.
    #[must_use]
    pub fn most_views(&self, views: usize) -> u64 {
        let splits = if self.split { CUTS + FADES } else { 0 };
        // Once over all for the closed form and the scores before and after, also of each split.
        ((self.rounds + splits * (AFTER_SPLIT + 1) + 2) * views) as u64
    }
}

/// What one view shows.
#[derive(Clone, Debug, Default)]
pub struct Observation {
    /// The picture, `[3][height][width]`, 0..=1.
    pub picture: Vec<f32>,
    /// What its pixels belong to, `[channels][height][width]`; all 0 where nothing is said.
    pub feature: Vec<f32>,
}

/// How well a splat shows the views that are held out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// `(1 - l) L1 + l (1 - SSIM)`, mean over views.
    pub visual: f64,
    /// `1 - cos`, mean over views.
    pub semantic: f64,
    /// Mean over views [dB].
    pub psnr: f64,
}

/// What straddles two objects.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Straddling {
    /// Gaussians whose largest share of an object is below 0.8.
    pub count: usize,
    /// Sum of their opacities.
    pub opacity: f64,
    /// Sum of their opacities times the standard deviations along their two longest axes [asset unit^2]: each is a piece of
    /// surface, and a smaller one tears less.
    pub mass: f64,
}

/// What came of a refinement.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The splat: its rows in their order, then the second halves of what was split.
    pub gaussians: Gaussians,
    /// Shares of the objects, `[gaussians][channels]`.
    pub feature: Vec<f32>,
    /// Weight of each Gaussian in pixels of which something is said [pixel].
    pub seen: Vec<f32>,
    /// On held-out views: at the start, and of what is here.
    pub score: [Score; 2],
    /// The same of what straddles, in the other views.
    pub straddling: [Straddling; 2],
    /// Rounds over the views that were made.
    pub rounds: usize,
}

/// A run over views that `observe` gives, one at a time.
struct Run<'a, F> {
    views: &'a [View],
    settings: Settings,
    channels: usize,
    /// Extent of the cameras [asset unit].
    extent: f32,
    observe: F,
}

/// Whether a view is held out: one of eight, and one where there are fewer.
#[must_use]
pub fn is_held_out(view: usize, views: usize) -> bool {
    let every = HOLD_OUT.min(views.max(1));
    view % every == every / 2
}

/// Refines a splat with features of `channels` values. `observe` is asked for a view when it is needed, so that one is in
/// memory at a time; `tick` hears of every view that was looked at, with what is being done.
///
/// Equal input gives equal bits on any number of threads. With fewer than three views nothing can be held out, and the
/// splat comes back with the closed form.
///
/// # Errors
/// Those of `observe`.
pub fn refine<E>(
    gaussians: Gaussians,
    views: &[View],
    channels: usize,
    settings: &Settings,
    observe: impl FnMut(usize) -> Result<Observation, E>,
    mut tick: impl FnMut(&str),
) -> Result<Refined, E> {
    let mut run = Run {
        views,
        settings: *settings,
        channels,
        extent: extent(views),
        observe,
    };
    let rows = gaussians.len();
    let mut start = Model {
        gaussians,
        channels,
        feature: vec![0.0; rows * channels],
        prior: Vec::new(),
    };
    run.closed_form(&mut start, &mut tick)?;
    let sums = run.sums(&start, &mut tick)?;
    let before = split::straddling(&start.gaussians, &sums, channels);
    let first = run.score(&start, &mut tick)?;
    let mut best = (start, first);
    let mut made = 0;
    if views.len() >= 3 {
        best = run.descend(best, Some(first), settings.rounds, &mut made, &mut tick)?;
        if settings.split {
            best = run.part(best, &mut made, &mut tick)?;
        }
    }
    let (model, score) = best;
    let sums = run.sums(&model, &mut tick)?;
    let after = split::straddling(&model.gaussians, &sums, channels);
    let seen = sums.chunks(channels.max(1)).map(|of| of.iter().sum());
    Ok(Refined {
        seen: seen.collect(),
        gaussians: model.gaussians,
        feature: model.feature,
        score: [first, score],
        straddling: [before, after],
        rounds: made,
    })
}

/// Largest distance of a camera from their middle, as the training of splats takes it; 1 where all are in one place.
fn extent(views: &[View]) -> f32 {
    let count = views.len().max(1) as f32;
    let middle = views.iter().map(|v| v.camera.position).sum::<glam::Vec3>() / count;
    let far = views.iter().map(|v| v.camera.position.distance(middle));
    let far = far.fold(0.0, f32::max);
    if far > 0.0 { far } else { 1.0 }
}

impl<E, F: FnMut(usize) -> Result<Observation, E>> Run<'_, F> {
    fn part_of(&self, held_out: bool) -> Vec<usize> {
        let count = self.views.len();
        (0..count)
            .filter(|&v| (count >= 3 && is_held_out(v, count)) == held_out)
            .collect()
    }

    /// Sums of weight times what the views that are not held out say: `[gaussians][channels]` [pixel].
    fn sums(&mut self, model: &Model, tick: &mut impl FnMut(&str)) -> Result<Vec<f32>, E> {
        let mut sums = vec![0.0f32; model.len() * self.channels];
        for view in self.part_of(false) {
            let said = (self.observe)(view)?;
            let found = model.gather(&self.views[view].camera, &said.feature, self.channels);
            for (sum, value) in sums.iter_mut().zip(&found.values) {
                *sum += value;
            }
            tick("closed form");
        }
        Ok(sums)
    }

    /// Sets features and prior to the closed form.
    fn closed_form(&mut self, model: &mut Model, tick: &mut impl FnMut(&str)) -> Result<(), E> {
        let mut sums = self.sums(model, tick)?;
        for of in sums.chunks_mut(self.channels.max(1)) {
            let sum: f32 = of.iter().sum();
            let scale = if sum > 0.0 { 1.0 / sum } else { 0.0 };
            of.iter_mut().for_each(|value| *value *= scale);
        }
        model.feature.clone_from(&sums);
        model.prior = sums;
        Ok(())
    }

    /// What the model shows of the views that are held out.
    fn score(&mut self, model: &Model, tick: &mut impl FnMut(&str)) -> Result<Score, E> {
        let mut sum = Score::default();
        let held_out = self.part_of(true);
        for &view in &held_out {
            let said = (self.observe)(view)?;
            let drawn = model.draw(&self.views[view].camera);
            let (visual, semantic, shown, _) = self.losses(&drawn.picture, &said);
            let square = |(a, b): (&f32, &f32)| f64::from(a - b).powi(2);
            let square = shown.iter().zip(&said.picture).map(square).sum::<f64>();
            // Eight bits show nothing beyond 60 dB.
            let mean = (square / said.picture.len().max(1) as f64).max(1e-6);
            let each = 1.0 / held_out.len() as f64;
            sum.visual += each * visual;
            sum.semantic += each * semantic;
            sum.psnr -= each * 10.0 * mean.log10();
            tick("held-out views");
        }
        Ok(sum)
    }

    /// Both terms, the colours before the background, and the gradient of equation (1) by the planes of the picture.
    fn losses(
        &self,
        picture: &cosplat_raster::Picture,
        said: &Observation,
    ) -> (f64, f64, Vec<f32>, Vec<f32>) {
        let pixels = picture.width * picture.height;
        let Settings {
            weights: [l1, l2],
            dssim,
            background,
            ..
        } = self.settings;
        let mut gradient = vec![0.0; picture.planes.len()];
        let passes = picture.plane(picture.channels);
        let shown: Vec<f32> = (0..3 * pixels)
            .map(|n| picture.planes[n] + background[n / pixels] * passes[n % pixels])
            .collect();
        let (colors, rest) = gradient.split_at_mut(3 * pixels);
        let size = [picture.width, pixels];
        let visual = loss::visual(&shown, &said.picture, size, dssim, l1, colors);
        let (features, by_passes) = rest.split_at_mut(self.channels * pixels);
        for (n, color) in colors.iter().enumerate() {
            by_passes[n % pixels] += background[n / pixels] * color;
        }
        let feature = &picture.planes[3 * pixels..(3 + self.channels) * pixels];
        let semantic = loss::semantic(feature, &said.feature, self.channels, l2, features);
        (visual, semantic, shown, gradient)
    }

    /// Goes down the gradient for at most `rounds` over the views. Gives the best state by the held-out views that is no worse
    /// than `floor` in either term; where there is none, the one that it began with.
    fn descend(
        &mut self,
        begin: (Model, Score),
        floor: Option<Score>,
        rounds: usize,
        made: &mut usize,
        tick: &mut impl FnMut(&str),
    ) -> Result<(Model, Score), E> {
        let [l1, l2] = self.settings.weights.map(f64::from);
        let total = |score: &Score| l1 * score.visual + l2 * score.semantic;
        let mut model = begin.0.clone();
        let mut best = begin;
        let (mut moments, mut waited) = (Moments::default(), 0);
        for round in 0..rounds {
            let decay = DECAY.powf(round as f32 / rounds.max(2) as f32);
            for view in self.order(*made) {
                let said = (self.observe)(view)?;
                let camera = &self.views[view].camera;
                let drawn = model.draw(camera);
                let (.., gradient) = self.losses(&drawn.picture, &said);
                let gradient = model.gradient(camera, drawn, &gradient);
                let pixels = (camera.width * camera.height) as f32;
                let pull = self.settings.weights[1] * PRIOR / pixels;
                model.step(&mut moments, &gradient, &RATES.at(decay, self.extent), pull);
                tick(&format!(
                    "round {}, {:.2} dB held out",
                    *made + 1,
                    best.1.psnr
                ));
            }
            *made += 1;
            let score = self.score(&model, tick)?;
            let holds = floor.is_none_or(|floor| {
                score.visual <= floor.visual && score.semantic <= floor.semantic
            });
            if holds && total(&score) < total(&best.1) {
                best = (model.clone(), score);
                waited = 0;
            } else {
                waited += 1;
            }
            if waited == PATIENCE {
                break;
            }
        }
        Ok(best)
    }

    /// The views of a round in an order of its own, the same in every run.
    fn order(&self, round: usize) -> Vec<usize> {
        let mut views = self.part_of(false);
        views.sort_by_key(|&view| {
            let mut x =
                (view as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (round as u64) << 32;
            x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            (x ^ (x >> 31), view)
        });
        views
    }

    /// Where the Gaussians `which` are cut, from where in them the views see their objects.
    fn cuts(
        &mut self,
        model: &Model,
        sums: &[f32],
        which: &[usize],
        tick: &mut impl FnMut(&str),
    ) -> Result<Vec<Cut>, E> {
        let channels = self.channels;
        let row = |n: usize| n * channels..(n + 1) * channels;
        let mut sides: Vec<Side> = which.iter().map(|&n| Side::new(n, &sums[row(n)])).collect();
        for view in self.part_of(false) {
            let camera = &self.views[view].camera;
            let said = (self.observe)(view)?;
            // Sums over pixels of weight times mask, and of that times x and y.
            let (width, pixels) = (camera.width as usize, said.picture.len() / 3);
            let places = [
                (0..pixels)
                    .map(|n| (n % width) as f32 + 0.5)
                    .collect::<Vec<_>>(),
                (0..pixels).map(|n| (n / width) as f32 + 0.5).collect(),
            ];
            let mut planes = said.feature;
            for place in &places {
                for n in 0..channels * pixels {
                    planes.push(planes[n] * place[n % pixels]);
                }
            }
            let found = model.gather(camera, &planes, 3 * channels);
            for side in &mut sides {
                let of = &found.values[3 * channels * side.gaussian..][..3 * channels];
                let all: f32 = of[..channels].iter().sum();
                let own = of[side.object];
                let other = all - own;
                if own < SEEN || other < SEEN {
                    continue;
                }
                let offset = [1, 2].map(|axis| {
                    let of = &of[axis * channels..(axis + 1) * channels];
                    let all: f32 = of.iter().sum();
                    of[side.object] / own - (all - of[side.object]) / other
                });
                let position = model.position(side.gaussian);
                let (turn, scale) = model.shape(side.gaussian);
                let (x, y, _) = camera.project(position);
                let axes = [0, 1, 2].map(|k| {
                    let (u, v, _) = camera.project(position + turn.col(k) * scale[k]);
                    Vec2::new(u - x, v - y)
                });
                side.add(Vec2::from_array(offset), own.min(other), axes);
            }
            tick("what straddles");
        }
        Ok(sides.iter().map(Side::cut).collect())
    }

    /// Those of `which` that are of more than one object within single views.
    fn mixed(
        &mut self,
        model: &Model,
        which: &[usize],
        tick: &mut impl FnMut(&str),
    ) -> Result<Vec<usize>, E> {
        let channels = self.channels;
        let mut sums = vec![[0.0f32; 2]; which.len()];
        for view in self.part_of(false) {
            let said = (self.observe)(view)?;
            let found = model.gather(&self.views[view].camera, &said.feature, channels);
            for (sums, n) in sums.iter_mut().zip(which) {
                let of = &found.values[n * channels..(n + 1) * channels];
                let all: f32 = of.iter().sum();
                sums[0] += all - of.iter().copied().fold(0.0, f32::max);
                sums[1] += all;
            }
            tick("what straddles");
        }
        let mixed = which.iter().zip(sums);
        let mixed = mixed.filter(|(_, [mixed, all])| *mixed > MIXED * all);
        Ok(mixed.map(|(n, _)| *n).collect())
    }

    /// Cuts what straddles in two, then fades what still does, and goes on after each. Gives the last state with less of it that the held-out views lose no more than
    /// [`SPLIT_COST`] by, and nothing of the semantic term.
    fn part(
        &mut self,
        whole: (Model, Score),
        made: &mut usize,
        tick: &mut impl FnMut(&str),
    ) -> Result<(Model, Score), E> {
        // What is taken may not cost what an earlier part of it gained.
        let mut floor = whole.1;
        let mut sums = self.sums(&whole.0, tick)?;
        let mut least = split::straddling(&whole.0.gaussians, &sums, self.channels).mass;
        let mut best = whole;
        let mut now = best.clone();
        for round in 0..CUTS + FADES {
            let which = split::straddlers(&sums, self.channels);
            if which.is_empty() {
                break;
            }
            // What is not split keeps what it has learnt.
            let mut learnt = std::mem::take(&mut now.0.feature);
            let rows = now.0.len();
            if round < CUTS {
                let cuts = self.cuts(&now.0, &sums, &which, tick)?;
                split::split(&mut now.0.gaussians, &cuts, SHARP);
            } else {
                let mixed = self.mixed(&now.0, &which, tick)?;
                let opacity = &mut now.0.gaussians.opacity;
                mixed.iter().for_each(|&n| opacity[n] *= FADE);
            }
            self.closed_form(&mut now.0, tick)?;
            let closed = &now.0.feature;
            learnt.extend_from_slice(&closed[rows * self.channels..]);
            for &n in &which {
                let row = n * self.channels..(n + 1) * self.channels;
                learnt[row.clone()].copy_from_slice(&closed[row]);
            }
            now.0.feature = learnt;
            now.1 = self.score(&now.0, tick)?;
            now = self.descend(now, None, AFTER_SPLIT, made, tick)?;
            sums = self.sums(&now.0, tick)?;
            let left = split::straddling(&now.0.gaussians, &sums, self.channels).mass;
            let costs_little = now.1.psnr >= floor.psnr - SPLIT_COST;
            if left < least && costs_little && now.1.semantic <= floor.semantic {
                (best, least) = (now.clone(), left);
                floor.psnr = floor.psnr.max(now.1.psnr);
            }
        }
        Ok(best)
    }
}
