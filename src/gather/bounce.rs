//! Refines the coarse solution by rays: irradiance of every element from what its own rays meet.
//!
//! Links of clusters are cheap and rough: they know no orientation inside a cluster and carry a little light through
//! walls. One bounce by rays sees surfaces as they are; its hits are kept and iterated, from the links' solution on.

use super::source::Source;
use crate::accel::offset_origin;
use crate::hierarchy::{Hierarchy, Surfels};
use crate::math::{Sequence, cosine_hemisphere, hash2};
use crate::progress::{Cancelled, Progress};
use crate::scene::Rgb;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Rays per element.
const RAYS: u32 = 64;
/// Iterations at most. What leaked into a closed dark room fades as its reflectance to this power.
const ITERATIONS: usize = 32;
/// Marks a ray that met nothing which reflects.
const NOTHING: u32 = u32::MAX;

/// Irradiance of every element from everything but lamps, W/m². `direct_only` is the scene lit by lamps alone,
/// `reflectance` and `guess` belong to the elements; the result is close to the fixed point whatever the guess.
/// Returns it with the number of rays cast.
pub fn bounce(
    direct_only: &Source,
    surfels: &Surfels,
    tree: &Hierarchy,
    reflectance: &[Rgb],
    guess: Vec<Rgb>,
    progress: &dyn Progress,
) -> Result<(Vec<Rgb>, u64), Cancelled> {
    let count = tree.elements.len();
    let mut fixed = vec![Rgb::ZERO; count];
    let mut hits = vec![NOTHING; count * RAYS as usize];
    fixed.par_iter_mut().zip(hits.par_chunks_mut(RAYS as usize)).enumerate().try_for_each(|(e, (fixed, hits))| {
        *fixed = cast(direct_only, surfels, tree, e as u32, hits);
        if progress.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    })?;
    let mut irradiance = guess;
    for _ in 0..ITERATIONS {
        let sent: Vec<Rgb> = irradiance.iter().zip(reflectance).map(|(&e, &r)| e * r).collect();
        irradiance.par_iter_mut().zip(&fixed).zip(hits.par_chunks(RAYS as usize)).for_each(|((e, &fixed), hits)| {
            let met = hits.iter().filter(|&&h| h != NOTHING);
            *e = fixed + met.map(|&h| sent[h as usize]).sum::<Rgb>() / RAYS as f32;
        });
        if progress.is_cancelled() {
            return Err(Cancelled);
        }
    }
    Ok((irradiance, hits.len() as u64))
}

/// Irradiance of element `e` from the scene lit by lamps alone; the elements that its rays meet go to `hits`.
fn cast(source: &Source, surfels: &Surfels, tree: &Hierarchy, e: u32, hits: &mut [u32]) -> Rgb {
    let node = tree.elements[e as usize].node;
    let sequence = Sequence::new(hash2(e, 0xe1e3));
    let mut sum = Rgb::ZERO;
    for (i, hit) in hits.iter_mut().enumerate() {
        let (surfel, side) = tree.sample(surfels, node, sequence.second(i as u32).x);
        let normal = tree.normal(surfels, surfel, side);
        let direction = cosine_hemisphere(normal, sequence.first(i as u32));
        let origin = offset_origin(surfels.position(surfel), normal);
        let solid_angle = PI / (RAYS as f32 * direction.dot(normal).max(0.05));
        let seen = source.look(origin, direction, solid_angle);
        sum += seen.radiance;
        *hit = seen.element.unwrap_or(NOTHING);
    }
    sum * (PI / RAYS as f32)
}
