//! Refines the coarse solution by rays: irradiance of every element from what its own rays meet.
//!
//! Links of clusters are cheap and rough: they know no orientation inside a cluster and carry a little light through
//! walls. One bounce by rays sees surfaces as they are; its hits are kept and iterated, from the links' solution on.

use super::guide::{Glance, Guide};
use super::lit_scene::LitScene;
use super::source::{Source, Start};
use super::tally::{Grouped, Origins, Sums};
use crate::hierarchy::Side;
use crate::math::{Sequence, cosine_hemisphere, hash2};
use crate::progress::{Cancelled, Progress};
use crate::scene::Rgb;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;
use std::ops::Range;

/// Iterations. What leaked into a closed dark room fades as its reflectance to this power.
const ITERATIONS: usize = 32;
/// Marks a ray that met nothing which reflects.
pub const NOTHING: u32 = u32::MAX;

/// What the rays of the first bounce tell.
#[derive(Serialize, Deserialize)]
pub struct Bounce {
    /// Irradiance of every receiver (elements, then shut texels) from everything but lamps, W/m².
    pub irradiance: Vec<Rgb>,
    /// The same by light group.
    pub groups: Grouped,
    /// What of it comes straight from sky and emissive surfaces, by light group.
    pub own: Grouped,
    /// Receivers that the rays of every receiver met, as many for each; [`NOTHING`] where none reflects. Empty if light is
    /// not kept apart.
    pub hits: Vec<u32>,
    /// Where bright things are.
    pub guide: Guide,
    /// Rays cast.
    pub rays: u64,
}

/// Irradiance of every receiver from everything but lamps, by `rays` rays each. `reflectance` and `guess`
/// (W/m², whole and by light group) belong to the elements; the result is close to the fixed point whatever the guess.
pub fn bounce(
    lit: LitScene,
    reflectance: &[Rgb],
    guess: (Vec<Rgb>, Grouped),
    rays: usize,
    progress: &dyn Progress,
) -> Result<Bounce, Cancelled> {
    let LitScene { surfels, hierarchy: tree, shut, .. } = lit;
    let elements = tree.elements.len();
    let count = elements + shut.len();
    let mut fixed = vec![Rgb::ZERO; count];
    let mut own = Grouped::new(lit.groups.len(), count);
    let mut fixed_groups = Grouped::new(lit.groups.len(), count);
    let direct_only = Source::new(lit, &fixed, &own, None);
    let mut origins: Vec<Origins> = own
        .rows_mut(count)
        .into_iter()
        .zip(fixed_groups.rows_mut(count))
        .map(|(own, reflected)| Origins { own: Sums(own), reflected: Sums(reflected) })
        .collect();
    let (origins_elements, origins_shut) = origins.split_at_mut(elements);
    let mut hits = vec![NOTHING; count * rays];
    let groups = Guide::groups(tree);
    let (fixed_elements, fixed_shut) = fixed.split_at_mut(elements);
    let (hits_elements, hits_shut) = hits.split_at_mut(elements * rays);
    let hot = tasks(&groups, fixed_elements, hits_elements, origins_elements, rays)
        .into_par_iter()
        .map(|Task { elements, fixed, hits, origins }| {
            let mut glances = Vec::with_capacity(hits.len());
            for (((e, fixed), hits), origins) in elements.zip(fixed).zip(hits.chunks_mut(rays)).zip(origins) {
                let sampler = tree.sampler(surfels, e);
                let from = |u| sampler.draw(u);
                *fixed = cast(&direct_only, hash2(e, 0xe1e3), from, hits, origins, |glance| glances.push(glance));
            }
            if progress.is_cancelled() { Err(Cancelled) } else { Ok(Guide::bright(&glances)) }
        })
        .collect::<Result<_, Cancelled>>()?;
    let shut_rows = fixed_shut.par_iter_mut().zip(hits_shut.par_chunks_mut(rays)).zip(origins_shut);
    shut_rows.zip(shut).try_for_each(|(((fixed, hits), origins), &texel)| {
        let from = |_| (texel, Side::Front);
        *fixed = cast(&direct_only, hash2(texel, 0x5407), from, hits, origins, |_| ());
        if progress.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    })?;
    let reflectance: Vec<Rgb> =
        reflectance.iter().copied().chain(shut.iter().map(|&s| surfels.reflectance(s))).collect();
    fixed_groups.add_all(&own);
    let (mut irradiance, guess_groups) = guess;
    irradiance.resize(count, Rgb::ZERO);
    for _ in 0..ITERATIONS {
        let sent: Vec<Rgb> = irradiance.iter().zip(&reflectance).map(|(&e, &r)| e * r).collect();
        irradiance.par_iter_mut().zip(&fixed).zip(hits.par_chunks(rays)).for_each(|((e, &fixed), hits)| {
            let met = hits.iter().filter(|&&h| h != NOTHING);
            *e = fixed + met.map(|&h| sent[h as usize]).sum::<Rgb>() / rays as f32;
        });
        if progress.is_cancelled() {
            return Err(Cancelled);
        }
    }
    let by_group = iterate_groups(&fixed_groups, guess_groups, &reflectance, &hits, rays, progress)?;
    let cast = hits.len() as u64;
    let hits = if lit.groups.is_empty() { Vec::new() } else { hits };
    Ok(Bounce { irradiance, groups: by_group, own, hits, guide: Guide::new(&groups, hot), rays: cast })
}

/// The iteration of [`bounce`] for every light group, over the same hits.
fn iterate_groups(
    fixed: &Grouped,
    guess: Grouped,
    reflectance: &[Rgb],
    hits: &[u32],
    rays: usize,
    progress: &dyn Progress,
) -> Result<Grouped, Cancelled> {
    let (count, groups) = (reflectance.len(), fixed.groups());
    let mut irradiance = guess.resized(count);
    if groups == 0 {
        return Ok(irradiance);
    }
    for _ in 0..ITERATIONS {
        let before = irradiance.clone();
        irradiance.rows_mut(count).into_par_iter().zip(hits.par_chunks(rays)).enumerate().for_each(
            |(i, (row, hits))| {
                row.fill(Rgb::ZERO);
                for &h in hits.iter().filter(|&&h| h != NOTHING) {
                    let share = reflectance[h as usize] / rays as f32;
                    row.iter_mut().zip(before.of(h as usize)).for_each(|(sum, &e)| *sum += e * share);
                }
                row.iter_mut().zip(fixed.of(i)).for_each(|(sum, &fixed)| *sum += fixed);
            },
        );
        if progress.is_cancelled() {
            return Err(Cancelled);
        }
    }
    Ok(irradiance)
}

/// One group of elements with its results.
struct Task<'a, 'b> {
    elements: Range<u32>,
    fixed: &'a mut [Rgb],
    hits: &'a mut [u32],
    origins: &'a mut [Origins<'b>],
}

/// Cuts the results of all elements by group.
fn tasks<'a, 'b>(
    groups: &[Range<u32>],
    mut fixed: &'a mut [Rgb],
    mut hits: &'a mut [u32],
    mut origins: &'a mut [Origins<'b>],
    rays: usize,
) -> Vec<Task<'a, 'b>> {
    let mut tasks = Vec::with_capacity(groups.len());
    for elements in groups.iter().cloned() {
        let (of_group, rest) = fixed.split_at_mut(elements.len());
        let (hits_of_group, more_hits) = hits.split_at_mut(elements.len() * rays);
        let (origins_of_group, more_origins) = origins.split_at_mut(elements.len());
        tasks.push(Task { elements, fixed: of_group, hits: hits_of_group, origins: origins_of_group });
        (fixed, hits, origins) = (rest, more_hits, more_origins);
    }
    tasks
}

/// Irradiance of a receiver from the scene lit by lamps alone. Rays start where `from` says for a number in 0..1. The
/// receivers that they meet go to `hits`, what they see to `glance`.
fn cast(
    source: &Source,
    seed: u32,
    from: impl Fn(f32) -> (u32, Side),
    hits: &mut [u32],
    origins: &mut Origins,
    mut glance: impl FnMut(Glance),
) -> Rgb {
    let sequence = Sequence::new(seed);
    let rays = hits.len() as f32;
    let mut sum = Rgb::ZERO;
    for (i, hit) in hits.iter_mut().enumerate() {
        let (surfel, side) = from(sequence.second(i as u32).x);
        let Start { origin, normal, screen } = source.start(surfel, side);
        let direction = cosine_hemisphere(normal, sequence.first(i as u32));
        let solid_angle = PI / (rays * direction.dot(normal).max(0.05));
        let seen = match source.groups() {
            0 => source.look(origin, direction, solid_angle, screen, &mut ()),
            _ => source.look(origin, direction, solid_angle, screen, origins),
        };
        sum += seen.radiance;
        glance((direction, seen.radiance.element_sum() / 3.0));
        *hit = seen.receiver.unwrap_or(NOTHING);
    }
    origins.scale(PI / rays);
    sum * (PI / rays)
}
