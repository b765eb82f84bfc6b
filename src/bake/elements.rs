//! What the radiosity system is made of: scene, texels and lamps → hierarchy, elements with what they send.

use crate::accel::Accel;
use crate::atlas::Atlas;
use crate::gather::{self, Direct, Emission, Grouped, Lamp, Lamps, LitScene};
use crate::hierarchy::{self, Hierarchy, Side, Surface, Surfels};
use crate::progress::{Cancelled, Progress};
use crate::scene::{LightGroups, Rgb, Scene};
use crate::solve::{self, Elements};
use std::f32::consts::PI;

/// Which emission rays meet, and all lamps: those of the scene, emitters that are sent like lamps, and bright parts of
/// the sky.
pub(super) fn lamps(scene: &Scene, groups: &LightGroups) -> (Emission, Vec<Lamp>) {
    let (emission, mut lamps) = gather::classify(scene, groups);
    lamps.extend(scene.lights.iter().enumerate().map(|(i, light)| Lamp::new(light, groups.of_light(i))));
    lamps.extend(Lamp::of_environment(&scene.environment, groups.of_environment()));
    (emission, lamps)
}

/// The hierarchy over all fronts, and over those backs that something sees by so many rays from every element, unless
/// it is known which these are. With the backs.
pub(super) fn hierarchy(
    accel: &Accel,
    atlas: &Atlas,
    surfels: &Surfels,
    (side, rays): (u32, u32),
    known: Option<&[bool]>,
    progress: &dyn Progress,
) -> Result<(Hierarchy, Vec<bool>), Cancelled> {
    let surfaces: Vec<Surface> = surfels.surfaces(atlas);
    let build = |backs: &[bool]| hierarchy::build(surfels, &surfaces, backs, side);
    if let Some(backs) = known {
        return Ok((build(backs), backs.to_vec()));
    }
    let fronts = build(&vec![false; surfaces.len()]);
    let backs = solve::hidden_backs(accel, atlas, surfels, &fronts, &surfaces, rays, progress)?;
    Ok((if backs.contains(&true) { build(&backs) } else { fronts }, backs))
}

/// What every element reflects and sends before any exchange, and what lamps of every group send to it. Elements without
/// texels cast `rays` at every lamp.
pub(super) fn elements(
    scene: &Scene,
    atlas: &Atlas,
    surfels: &Surfels,
    tree: &Hierarchy,
    emission: &Emission,
    lamps: &Lamps,
    direct: &Direct,
    rays: u32,
) -> (Elements, Grouped) {
    let emittance = emittance(scene, atlas, surfels, tree, emission, |_, _| true);
    let (direct, groups) = gather::element_direct(lamps, surfels, &tree.elements, direct, rays);
    (Elements { reflectance: means(surfels, tree, |s| surfels.reflectance(s)), emittance, direct }, groups)
}

/// What every element emits and rays meet, W/m², of those instances and primitives that `counts` takes.
pub(super) fn emittance(
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

/// Area-weighted mean irradiance over all texels, W/m², mean of channels, where `rest` is that of receivers from everything
/// but lamps.
pub(super) fn mean(lit: &LitScene, rest: &[Rgb]) -> f32 {
    let (mut sum, mut area) = (0.0f64, 0.0f64);
    for (t, (&direct, &a)) in lit.direct.irradiance.iter().zip(&lit.surfels.texels.area).enumerate() {
        let other = lit.hierarchy.element_of(t as u32, Side::Front).map_or(Rgb::ZERO, |e| rest[e as usize]);
        sum += ((direct + other).element_sum() / 3.0 * a) as f64;
        area += a as f64;
    }
    (sum / area.max(f64::MIN_POSITIVE)) as f32
}
