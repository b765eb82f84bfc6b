//! The order of the lighting stages: resolved scene and texels → irradiance.

use super::effort::{CAREFUL, cell_settings, effort, element_rays};
use super::elements::{elements, emittance, hierarchy, lamps, mean};
use super::observer::{Counts, FoundSoFar, Observer, REFINE, Refinement, Solution};
use crate::accel::Accel;
use crate::atlas::{Atlas, Texels};
use crate::gather::{
    self, CellSettings, Direct, DirectSettings, Footprint, GatherStart, Gathering, Grouped, Indirect, Lamps, Lightmap,
    LitScene, Portals, Probe, Smooth, Source,
};
use crate::hierarchy::{Side, Surfels};
use crate::output::report::StageClock;
use crate::output::{Milestone, State};
use crate::progress::{Cancelled, Progress, Stage};
use crate::relight::{LitElements, Patches};
use crate::scene::{LightGroups, Rgb};
use crate::solve::{self, Elements, SolveSettings};
use crate::transport::Exchange;
use glam::Vec3;

/// Texels along a side of an element.
const ELEMENT_SIDE: u32 = 4;
/// Rays per element that look for backs of double-sided surfaces.
const BACK_RAYS: u32 = 16;
/// Rays per element that count what it sees, for a solution that the first bounce starts from.
const SURVEY_RAYS: u32 = 16;
/// Shadow rays per lamp of an element that has no texels of its own.
const ELEMENT_RAYS: u32 = 16;
/// Rays per element of the first bounce.
const BOUNCE_RAYS: usize = 24;

/// Patches that tell how light changes with reflectances.
pub struct TexelPatches {
    /// The patches.
    pub patches: Patches,
    /// Patch of every texel, if it has one.
    pub of_texel: Vec<Option<u32>>,
}

/// What the lighting stages end with.
pub struct Lit {
    /// The lightmap.
    pub lightmap: Lightmap,
    /// What it is, and the error to expect.
    pub state: State,
    /// What it took.
    pub counts: Counts,
    /// What relighting needs, if light was kept apart.
    pub patches: Option<TexelPatches>,
}

/// What is to be lit, and how.
#[derive(Clone, Copy)]
pub struct Lighting<'a> {
    /// The scene, ready for rays.
    pub accel: &'a Accel<'a>,
    /// Its layout.
    pub atlas: &'a Atlas,
    /// The texels of that.
    pub texels: &'a Texels,
    /// What light is kept apart by.
    pub groups: &'a LightGroups,
    /// Relative RMSE of the lightmap to aim for.
    pub error: f32,
    /// What is known of all but direct light before it is solved, for drafts.
    pub first: Option<&'a Smooth>,
    /// Takes the time of stages.
    pub clock: &'a StageClock,
    /// Is told how far the stages are.
    pub progress: &'a dyn Progress,
}

/// Irradiance of every texel.
pub fn light(lighting: &Lighting, observer: &mut dyn Observer) -> Result<Lit, Cancelled> {
    solved(lighting, observer, |solved, observer| solved.gather(observer))
}

/// The scene with its radiosity solution: what the final gather starts from.
pub(super) struct Solved<'a> {
    lit: LitScene<'a>,
    error: f32,
    clock: &'a StageClock,
    progress: &'a dyn Progress,
    /// False where a texel lies inside other geometry.
    usable: Vec<bool>,
    /// What is costly of it.
    pub(super) solution: &'a Solution,
    /// What it took.
    counts: Counts,
    /// Probes that were gathered before.
    probes: Vec<(u32, Probe)>,
}

/// Lights a scene as far as its radiosity solution, hands that to `then`, and returns what comes of it.
pub(super) fn solved<T, E: From<Cancelled>>(
    lighting: &Lighting,
    observer: &mut dyn Observer,
    then: impl FnOnce(Solved, &mut dyn Observer) -> Result<T, E>,
) -> Result<T, E> {
    let Lighting { accel, atlas, texels, groups, error, first, clock, progress } = *lighting;
    let mut counts = Counts::default();
    let scene = accel.scene();
    let before = observer.found_before();
    let footprint = clock.measure(Stage::Texels, || Footprint::new(accel, atlas, texels, progress))?;
    let usable: Vec<bool> = (0..texels.len() as u32).map(|t| !footprint.is_hidden(t)).collect();

    let (emission, lamps) = lamps(scene, groups);
    let sky = groups.of_environment();
    let portals =
        clock.measure(Stage::Direct, || Portals::find(accel, &footprint, texels.len() as u32, sky, progress))?;
    let lamps = Lamps::new(lamps, portals, accel);
    let direct_settings = DirectSettings::for_error(error);
    let direct = clock.measure(Stage::Direct, || match before.direct {
        Some(direct) => Ok(direct),
        None => gather::texel_direct(&lamps, groups.len(), atlas, texels, &footprint, &direct_settings, progress),
    })?;
    counts.rays.insert("shadow".into(), direct.rays);
    observer.found(&FoundSoFar { direct: Some(&direct), solution: None, probes: &[] }, &counts, &mut || {
        Some(smooth_draft(Milestone::Direct, &direct, first?, &usable).into())
    });

    let surfels = Surfels::new(scene, atlas, texels, footprint.covered(), footprint.parted(), footprint.crossed());
    let (tree, backs, elements, direct_groups) = clock.measure(Stage::Solve, || {
        let known = before.solution.as_ref().map(|s| s.backs.as_slice());
        let (tree, backs) = hierarchy(accel, atlas, &surfels, (ELEMENT_SIDE, BACK_RAYS), known, progress)?;
        let (elements, groups) = elements(scene, atlas, &surfels, &tree, &emission, &lamps, &direct, ELEMENT_RAYS);
        Ok((tree, backs, elements, groups))
    })?;
    let shut = gather::shut_texels(&surfels, &tree);
    let lit = LitScene {
        accel,
        atlas,
        surfels: &surfels,
        hierarchy: &tree,
        emission: &emission,
        footprint: &footprint,
        lamps: &lamps,
        direct: &direct,
        element_direct: &elements.direct,
        element_direct_groups: &direct_groups,
        groups,
        shut: &shut,
    };
    let solution = match before.solution {
        Some(solution) => solution,
        None => clock.measure(Stage::Solve, || solution(&lit, &elements, backs, error, progress))?,
    };
    counts.solver = solution.counts.solver;
    counts.rays.extend(solution.counts.rays.clone());
    let solution = &solution;
    then(Solved { lit, error, clock, progress, usable, solution, counts, probes: before.probes }, observer)
}

impl Solved<'_> {
    /// Direct light and solution, as they are kept.
    pub(super) fn found(&self) -> FoundSoFar<'_> {
        FoundSoFar { direct: Some(self.lit.direct), solution: Some(self.solution), probes: &[] }
    }

    /// What probes see.
    fn source(&self) -> Source<'_> {
        let bounce = &self.solution.bounce;
        Source::new(self.lit, &bounce.irradiance, &bounce.groups, Some(&bounce.guide))
    }

    /// About the mean irradiance of the lightmap, W/m².
    fn mean(&self) -> f32 {
        mean(&self.lit, &self.solution.bounce.irradiance)
    }

    /// How finely it is gathered.
    fn cell_settings(&self) -> CellSettings {
        cell_settings(self.error, self.solution.effort, self.mean())
    }

    /// The probes of all cells that hold a `wanted` texel, by texel. `watch` is called now and then with those so far.
    pub(super) fn probes(
        mut self,
        wanted: Vec<bool>,
        mut watch: impl FnMut(&[(u32, Probe)]),
    ) -> Result<Vec<(u32, Probe)>, Cancelled> {
        let LitScene { atlas, surfels, footprint, .. } = self.lit;
        let before = std::mem::take(&mut self.probes);
        let (source, settings) = (self.source(), self.cell_settings());
        let start = GatherStart { wanted, probes: before, ..GatherStart::default() };
        let mut watch = |gathering: &Gathering| watch(gathering.probes());
        let indirect = self.clock.measure(Stage::Gather, || {
            gather::indirect(&source, atlas, surfels.texels, footprint, &settings, start, &mut watch, self.progress)
        })?;
        Ok(indirect.probes)
    }

    /// Gathers all texels.
    fn gather(mut self, observer: &mut dyn Observer) -> Result<Lit, Cancelled> {
        let LitScene { accel, atlas, surfels, hierarchy: tree, footprint, direct, shut, .. } = self.lit;
        let (texels, bounce, clock, progress) = (surfels.texels, &self.solution.bounce, self.clock, self.progress);
        let (mut counts, before) = (std::mem::take(&mut self.counts), std::mem::take(&mut self.probes));
        let patches = (!self.lit.groups.is_empty()).then(|| {
            let scene = accel.scene();
            let direct = self.lit.element_direct_groups;
            let lit = LitElements { scene, atlas, surfels, tree, shut, bounce, direct };
            let (patches, of_element) = clock.measure(Stage::Solve, || Patches::new(&lit));
            let patch = |t| tree.element_of(t, Side::Front).map(|e| of_element[e as usize]);
            TexelPatches { patches, of_texel: (0..texels.len() as u32).map(patch).collect() }
        });
        let rest = match observer.wants_drafts() {
            true => Some(gather::smooth(atlas, texels, tree, &bounce.irradiance, ELEMENT_SIDE, progress)?),
            false => None,
        };
        let (solved, usable) = (self.found(), &self.usable);
        observer.found(&solved, &counts, &mut || {
            Some(smooth_draft(Milestone::Solution, direct, rest.as_ref()?, usable).into())
        });

        let (source, mean) = (self.source(), self.mean());
        let start = GatherStart { probes: before, ..GatherStart::default() };
        let mut indirect = clock.measure(Stage::Gather, || {
            let mut watch = |gathering: &Gathering| {
                let so_far = FoundSoFar { probes: gathering.probes(), ..solved };
                observer.found(&so_far, &counts, &mut || {
                    let rest = rest.as_ref()?;
                    let (irradiance, squares) = gathering.draft(&rest.irradiance, rest.change);
                    Some(draft(Milestone::Gather, direct, &irradiance, squares, usable).into())
                });
            };
            let settings = self.cell_settings();
            gather::indirect(&source, atlas, texels, footprint, &settings, start, &mut watch, progress)
        })?;
        counts.solver.probes = indirect.probes.len() as u64;
        counts.rays.insert("gather".into(), indirect.rays);
        let last =
            |indirect: &Indirect| draft(Milestone::Final, direct, &indirect.irradiance, indirect.squared_error, usable);
        let (mut lightmap, mut state) = last(&indirect);
        lightmap.direct_groups.clone_from(&direct.groups);

        let probes = std::mem::take(&mut indirect.probes);
        while let Some(refinement) = observer.judge(&lightmap, &probes, &counts)? {
            indirect = gather_again(&source, &refinement, mean, indirect, &mut lightmap, &mut counts, clock, progress)?;
            state = last(&indirect).1;
            lightmap.combined = lightmap.direct.iter().zip(&indirect.irradiance).map(|(&d, &i)| d + i).collect();
        }
        lightmap.groups = indirect.groups;
        lightmap.groups.add_all(&lightmap.direct_groups);
        Ok(Lit { lightmap, state, counts, patches })
    }
}

/// Direct light as it is by now with the `rest`, which has the squared error `squares` over all texels.
fn draft(reached: Milestone, direct: &Direct, rest: &[Rgb], squares: f64, usable: &[bool]) -> (Lightmap, State) {
    let combined: Vec<Rgb> = direct.irradiance.iter().zip(rest).map(|(&d, &i)| d + i).collect();
    let squares = squares + f64::from(direct.noise).powi(2) * combined.len() as f64;
    let state = State { reached, predicted_error: relative(squares, &combined) };
    let (direct, usable) = (direct.irradiance.clone(), usable.to_vec());
    (Lightmap { direct, combined, usable, ..Lightmap::default() }, state)
}

/// The same with a rest that is smooth.
fn smooth_draft(reached: Milestone, direct: &Direct, rest: &Smooth, usable: &[bool]) -> (Lightmap, State) {
    let squares = f64::from(rest.change).powi(2) * rest.irradiance.len() as f64;
    draft(reached, direct, &rest.irradiance, squares, usable)
}

/// A root mean square as a share of the mean of `irradiance`, from the sum of squares of all texels.
pub(super) fn relative(squares: f64, irradiance: &[Rgb]) -> f64 {
    let count = irradiance.len().max(1) as f64;
    let mean = irradiance.iter().map(|e| f64::from(e.element_sum()) / 3.0).sum::<f64>() / count;
    if mean > 0.0 { (squares / count).sqrt() / mean } else { 0.0 }
}

/// The radiosity solution: links first, then hits of rays.
fn solution(
    lit: &LitScene,
    elements: &Elements,
    backs: Vec<bool>,
    error: f32,
    progress: &dyn Progress,
) -> Result<Solution, Cancelled> {
    let LitScene { accel, surfels, hierarchy: tree, lamps, .. } = *lit;
    let count = tree.elements.len();
    let sky = |position: Vec3, normal: Vec3, direction: Vec3, solid_angle: f32| {
        lamps.screen(position, normal).sky(position, direction, solid_angle)
    };
    let survey = solve::survey(accel, surfels, tree, sky, element_rays(SURVEY_RAYS, count), progress)?;
    let exchange = Exchange { hierarchy: tree, surfels, accel };
    let settings = SolveSettings::for_error(error);
    let linked = solve::solve(&exchange, elements, &survey, &settings, progress)?;
    let of_group = |g: usize| {
        let is_own = |instance, primitive| usize::from(lit.groups.of_emitter(instance, primitive)) == g;
        let emittance = emittance(accel.scene(), lit.atlas, surfels, tree, lit.emission, is_own);
        let (reflectance, direct) = (elements.reflectance.clone(), lit.element_direct_groups.group(g));
        let dark = vec![Rgb::ZERO; direct.len()];
        let sky = if g == usize::from(lit.groups.of_environment()) { &survey.sky } else { &dark };
        linked.of_other_light(tree, &Elements { reflectance, emittance, direct }, sky, &settings, progress)
    };
    let by_group: Vec<Vec<Rgb>> = (0..lit.groups.len()).map(of_group).collect::<Result<_, Cancelled>>()?;
    let guess = (linked.irradiance, Grouped::from_groups(&by_group));
    let bounce = gather::bounce(*lit, &elements.reflectance, guess, BOUNCE_RAYS, progress)?;
    let mut counts = Counts::default();
    counts.solver.nodes = tree.nodes.len() as u64;
    counts.solver.elements = tree.elements.len() as u64;
    counts.solver.links = linked.links.len() as u64;
    counts.solver.iterations = linked.iterations;
    counts.rays.insert("link".into(), linked.rays);
    counts.rays.insert("survey".into(), survey.rays + (BACK_RAYS as usize * count) as u64);
    counts.rays.insert("bounce".into(), bounce.rays);
    let source = Source::new(*lit, &bounce.irradiance, &bounce.groups, Some(&bounce.guide));
    let mean = mean(lit, &bounce.irradiance);
    let (effort, tried) = effort(&source, lit.footprint, error, lit.direct.noise, mean);
    counts.rays.insert("trial".into(), tried);
    Ok(Solution { backs, bounce, effort, counts })
}

/// What an audit finds wanting, gathered more finely: the lightmap's direct light in place, the rest anew from what it was.
fn gather_again(
    source: &Source,
    refinement: &Refinement,
    mean: f32,
    before: Indirect,
    lightmap: &mut Lightmap,
    counts: &mut Counts,
    clock: &StageClock,
    progress: &dyn Progress,
) -> Result<Indirect, Cancelled> {
    let LitScene { atlas, surfels, footprint, lamps, .. } = source.lit;
    let (texels, error) = (surfels.texels, refinement.error);
    let mut wanted = vec![false; texels.len()];
    refinement.tiles.iter().for_each(|tile| wanted[tile.start as usize..tile.end as usize].fill(true));
    let settings = DirectSettings::for_error(error);
    let (own, own_groups) = (&mut lightmap.direct, &mut lightmap.direct_groups);
    let cast = clock.measure(Stage::Direct, || {
        gather::closer_direct(lamps, texels, footprint, &settings, &wanted, own, own_groups, progress)
    })?;
    let kept = 1.0 - wanted.iter().filter(|&&w| w).count() as f64 / texels.len() as f64;
    let start = GatherStart { irradiance: before.irradiance, groups: before.groups, wanted, probes: Vec::new() };
    let mut indirect = clock.measure(Stage::Gather, || {
        gather::indirect(
            source,
            atlas,
            texels,
            footprint,
            &cell_settings(error, CAREFUL, mean),
            start,
            &mut |_| (),
            progress,
        )
    })?;
    indirect.squared_error += kept * before.squared_error;
    *counts.rays.entry(REFINE.into()).or_default() += cast + indirect.rays;
    counts.solver.probes += indirect.probes.len() as u64;
    Ok(indirect)
}
