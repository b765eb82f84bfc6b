//! The order of the lighting stages: resolved scene and texels → irradiance.

use crate::accel::Accel;
use crate::atlas::{Atlas, Texels};
use crate::gather::{
    self, CellSettings, Direct, DirectSettings, Emission, Footprint, Grouped, Lamp, Lamps, Lightmap, LitScene, Portals,
    ProbeSettings, Source,
};
use crate::hierarchy::{self, Hierarchy, Side, Surface, Surfels};
use crate::output::report::{SolverFacts, StageClock};
use crate::progress::{Cancelled, Progress, Stage};
use crate::relight::{LitElements, Patches};
use crate::scene::{LightGroups, Rgb, Scene};
use crate::solve::{self, Elements, SolveSettings};
use crate::transport::Exchange;
use glam::Vec3;
use std::collections::BTreeMap;
use std::f32::consts::PI;

/// Rays per element that look for backs of double-sided surfaces.
const BACK_RAYS: u32 = 16;
/// Rays per element that count what it sees.
const SURVEY_RAYS: u32 = 64;
/// Shadow rays per lamp of an element that has no texels of its own.
const ELEMENT_RAYS: u32 = 16;

/// Share of the scene's mean irradiance below which errors of a texel count as if it were that bright.
const FLOOR: f32 = 0.25;
/// Most rays that one probe casts for an error of 2 %.
const MOST_RAYS: f32 = 1800.0;

/// What the lighting stages did.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    /// Sizes of the radiosity system and of the gather.
    pub solver: SolverFacts,
    /// Rays by purpose.
    pub rays: BTreeMap<String, u64>,
}

/// Patches that tell how light changes with reflectances.
pub struct TexelPatches {
    /// The patches.
    pub patches: Patches,
    /// Patch of every texel, if it has one.
    pub of_texel: Vec<Option<u32>>,
}

/// Irradiance of every texel to within about `error` (relative RMSE), kept apart by `groups`; if there are any, with the
/// patches that relighting needs.
pub fn light(
    accel: &Accel,
    atlas: &Atlas,
    texels: &Texels,
    groups: &LightGroups,
    error: f32,
    clock: &mut StageClock,
    progress: &dyn Progress,
) -> Result<(Lightmap, Counts, Option<TexelPatches>), Cancelled> {
    let mut counts = Counts::default();
    let scene = accel.scene();
    let footprint = clock.measure(Stage::Texels, || Footprint::new(accel, atlas, texels, progress))?;

    let (emission, mut lamps) = gather::classify(scene, groups);
    lamps.extend(scene.lights.iter().enumerate().map(|(i, light)| Lamp::new(light, groups.of_light(i))));
    let sky = groups.of_environment();
    lamps.extend(Lamp::of_environment(&scene.environment, sky));
    let portals =
        clock.measure(Stage::Direct, || Portals::find(accel, &footprint, texels.len() as u32, sky, progress))?;
    let lamps = Lamps::new(lamps, portals, accel);
    let direct_settings = DirectSettings::for_error(error);
    let direct = clock.measure(Stage::Direct, || {
        gather::texel_direct(&lamps, groups.len(), atlas, texels, &footprint, &direct_settings, progress)
    })?;
    counts.rays.insert("shadow".into(), direct.rays);

    let (surfels, tree, elements, direct_groups, guess) = clock.measure(Stage::Solve, || {
        let surfels = Surfels::new(scene, atlas, texels, footprint.covered(), footprint.parted(), footprint.crossed());
        let tree = hierarchy(accel, atlas, &surfels, progress)?;
        let (elements, direct_groups) = elements(scene, atlas, &surfels, &tree, &emission, &lamps, &direct);
        let sky = |position: Vec3, normal: Vec3, direction: Vec3, solid_angle: f32| {
            lamps.screen(position, normal).sky(position, direction, solid_angle)
        };
        let survey = solve::survey(accel, &surfels, &tree, sky, SURVEY_RAYS, progress)?;
        let exchange = Exchange { hierarchy: &tree, surfels: &surfels, accel };
        let settings = SolveSettings::for_error(error);
        let solution = solve::solve(&exchange, &elements, &survey, &settings, progress)?;
        let by_group: Vec<Vec<Rgb>> = (0..groups.len())
            .map(|g| {
                let emittance = emittance(scene, atlas, &surfels, &tree, &emission, |i, p| {
                    usize::from(groups.of_emitter(i, p)) == g
                });
                let (reflectance, direct) = (elements.reflectance.clone(), direct_groups.group(g));
                let dark = vec![Rgb::ZERO; direct.len()];
                let sky = if g == usize::from(groups.of_environment()) { &survey.sky } else { &dark };
                let elements = Elements { reflectance, emittance, direct };
                solution.of_other_light(&tree, &elements, sky, &settings, progress)
            })
            .collect::<Result<_, Cancelled>>()?;
        counts.solver.nodes = tree.nodes.len() as u64;
        counts.solver.elements = tree.elements.len() as u64;
        counts.solver.links = solution.links.len() as u64;
        counts.solver.iterations = solution.iterations;
        counts.rays.insert("link".into(), solution.rays);
        counts.rays.insert("survey".into(), survey.rays + (BACK_RAYS as usize * tree.elements.len()) as u64);
        Ok((surfels, tree, elements, direct_groups, (solution.irradiance, Grouped::from_groups(&by_group))))
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
    let bounce = clock.measure(Stage::Solve, || gather::bounce(lit, &elements.reflectance, guess, progress))?;
    counts.rays.insert("bounce".into(), bounce.rays);

    let patches = (!groups.is_empty()).then(|| {
        let lit = LitElements {
            scene,
            atlas,
            surfels: &surfels,
            tree: &tree,
            shut: &shut,
            bounce: &bounce,
            direct: &direct_groups,
        };
        let (patches, of_element) = clock.measure(Stage::Solve, || Patches::new(&lit));
        let patch = |t| tree.element_of(t, Side::Front).map(|e| of_element[e as usize]);
        TexelPatches { patches, of_texel: (0..texels.len() as u32).map(patch).collect() }
    });

    let indirect = clock.measure(Stage::Gather, || {
        let source = Source::new(lit, &bounce.irradiance, &bounce.groups, Some(&bounce.guide));
        let floor = FLOOR * mean(texels, &direct.irradiance, &tree, &bounce.irradiance);
        gather::indirect(&source, atlas, texels, &footprint, &cell_settings(error, floor), progress)
    })?;
    counts.solver.probes = indirect.probes as u64;
    counts.rays.insert("gather".into(), indirect.rays);
    let combined = direct.irradiance.iter().zip(&indirect.irradiance).map(|(&d, &i)| d + i).collect();
    let mut by_group = indirect.groups;
    by_group.add_all(&direct.groups);
    let usable = (0..texels.len() as u32).map(|t| !footprint.is_hidden(t)).collect();
    let lightmap =
        Lightmap { direct: direct.irradiance, combined, groups: by_group, direct_groups: direct.groups, usable };
    Ok((lightmap, counts, patches))
}

/// How finely the final gather works for a relative error of the lightmap.
fn cell_settings(error: f32, floor: f32) -> CellSettings {
    // Enough to halve the error by four times the rays, but no endless run.
    let extra = (MOST_RAYS * (0.02 / error).powi(2)).min(1e6) as u32;
    let probe = ProbeSettings { extra, tolerance: error, floor };
    CellSettings { tolerance: 0.5 * error, floor, probe }
}

/// The hierarchy over all fronts, and over those backs that something sees.
fn hierarchy(accel: &Accel, atlas: &Atlas, surfels: &Surfels, progress: &dyn Progress) -> Result<Hierarchy, Cancelled> {
    let surfaces: Vec<Surface> = surfels.surfaces(atlas);
    let fronts = hierarchy::build(surfels, &surfaces, &vec![false; surfaces.len()]);
    let backs = solve::hidden_backs(accel, atlas, surfels, &fronts, &surfaces, BACK_RAYS, progress)?;
    Ok(if backs.contains(&true) { hierarchy::build(surfels, &surfaces, &backs) } else { fronts })
}

/// What every element reflects and sends before any exchange, and what lamps of every group send to it.
fn elements(
    scene: &Scene,
    atlas: &Atlas,
    surfels: &Surfels,
    tree: &Hierarchy,
    emission: &Emission,
    lamps: &Lamps,
    direct: &Direct,
) -> (Elements, Grouped) {
    let emittance = emittance(scene, atlas, surfels, tree, emission, |_, _| true);
    let (direct, groups) = gather::element_direct(lamps, surfels, &tree.elements, direct, ELEMENT_RAYS);
    (Elements { reflectance: means(surfels, tree, |s| surfels.reflectance(s)), emittance, direct }, groups)
}

/// What every element emits and rays meet, W/m², of those instances and primitives that `counts` takes.
fn emittance(
    scene: &Scene,
    atlas: &Atlas,
    surfels: &Surfels,
    tree: &Hierarchy,
    emission: &Emission,
    counts: impl Fn(usize, usize) -> bool,
) -> Vec<Rgb> {
    if !emission.any_seen() {
        return vec![Rgb::ZERO; tree.elements.len()];
    }
    let seen = |s: u32| {
        let (instance, triangle) = surfels.triangle(atlas, s);
        let primitive = scene.meshes[scene.instances[instance].mesh].primitive_index(triangle);
        let is_seen = emission.is_seen(scene, instance, triangle) && counts(instance, primitive);
        if is_seen { surfels.emission(s) } else { Rgb::ZERO }
    };
    means(surfels, tree, seen).into_iter().map(|l| l * PI).collect()
}

/// Area-weighted mean over the surfels of every element.
fn means(surfels: &Surfels, tree: &Hierarchy, of: impl Fn(u32) -> Rgb) -> Vec<Rgb> {
    let mean = |range: std::ops::Range<u32>| {
        let (mut sum, mut area) = (Rgb::ZERO, 0.0);
        for s in range {
            let a = surfels.area(s);
            sum += of(s) * a;
            area += a;
        }
        sum / area.max(f32::MIN_POSITIVE)
    };
    tree.elements.iter().map(|e| mean(e.surfels.clone())).collect()
}

/// Area-weighted mean irradiance over all texels, W/m², mean of channels.
fn mean(texels: &Texels, direct: &[Rgb], tree: &Hierarchy, rest: &[Rgb]) -> f32 {
    let (mut sum, mut area) = (0.0f64, 0.0f64);
    for (t, (&direct, &a)) in direct.iter().zip(&texels.area).enumerate() {
        let other = tree.element_of(t as u32, Side::Front).map_or(Rgb::ZERO, |e| rest[e as usize]);
        sum += ((direct + other).element_sum() / 3.0 * a) as f64;
        area += a as f64;
    }
    (sum / area.max(f64::MIN_POSITIVE)) as f32
}
