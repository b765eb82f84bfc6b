//! Light that comes straight from lamps: unoccluded irradiance in closed form times visibility.
//!
//! Visibility is sampled sparsely where a texel and its neighbours agree that the lamp is wholly seen or wholly
//! blocked, and densely, over the texel's area and the lamp's, where they do not: in penumbrae and at shadow edges.

use super::footprint::Footprint;
use super::lamp::{Aim, Lamp};
use super::look::{CLOSER, Look};
use super::tally::Grouped;
use super::visibility::{Lamps, Seen, Visibility};
use crate::atlas::{Atlas, SurfacePoint, Texels};
use crate::hierarchy::{Element, Side, Surfels};
use crate::math::{Sequence, hash2, hash3};
use crate::progress::{Cancelled, Counter, Progress, Stage};
use crate::scene::Rgb;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU64, Ordering};

/// Texels per parallel task.
const CHUNK: usize = 1024;
/// Texel widths within which a lamp's irradiance bends inside a texel.
const NEAR: f32 = 6.0;
/// Texels from which the mean irradiance is estimated.
const MEAN_SAMPLES: usize = 4096;
/// Errors of the lightmap that a penumbra's noise may reach, where visibility is least certain.
const PENUMBRA: f32 = 2.0;
/// Times the irradiance of a texel, and share of the scene's mean, that its penumbrae are measured by.
const BESIDE: f32 = 2.0;
const DIM: f32 = 0.1;
/// Errors of the lightmap that a part of the sky must bring to be looked for, and most rays that do so.
const SLIVER: f32 = 8.0;
const MOST_BLIND: u32 = 64;
/// Times the rays of every texel that one casts which is looked at again.
const MANY: u32 = 16;
/// Times the rays of every texel that are worth casting where a penumbra may end.
const AT_END: u32 = 16;
/// Points of an element that see the sky for all of it.
const SKY_POINTS: usize = 2;
/// Points of a texel that is near a lamp, and of one that the rim of a beam crosses.
const NEAR_SAMPLES: u32 = 32;
const RIM_SAMPLES: u32 = 512;
/// Share of a texel's brightest point that is left at its darkest where a rim may cross it.
const FADED: f32 = 0.1;

/// How many shadow rays are cast.
#[derive(Clone, Copy, Debug)]
pub struct DirectSettings {
    /// Rays of every texel to every lamp.
    pub base: u32,
    /// Most rays of a texel that sees part of the lamp.
    pub most: u32,
    /// Relative error of the lightmap to aim for.
    pub error: f32,
    /// Whether the sky through openings is sent, too.
    pub sky: bool,
}

impl DirectSettings {
    /// Settings whose noise stays below a relative error of the whole lightmap.
    pub fn for_error(error: f32) -> Self {
        Self { base: 4, most: 1024, error, sky: true }
    }

    /// Few rays for a first look at lamps, and none for the sky.
    pub fn rough() -> Self {
        Self { base: 1, most: 8, error: 0.15, sky: false }
    }

    /// Rays of every texel to the sky behind portals, which unblocked would bring `free` where about `around` W/m² arrive.
    /// Most of it may be hidden, and what is left must not be missed where it matters.
    pub(super) fn sky(&self, free: f32, around: f32) -> u32 {
        let rays = free / (SLIVER * self.error * around.max(1e-12));
        (rays.min(MOST_BLIND as f32) as u32).next_power_of_two().clamp(CLOSER * self.base, MOST_BLIND)
    }

    /// Rays of a texel that sees part of a lamp which unblocked would bring `free`, where about `around` W/m² arrive.
    /// The error of stratified visibility falls as n^(−3/4).
    pub(super) fn penumbra(&self, free: f32, around: f32) -> u32 {
        let rays = (0.5 * free / (PENUMBRA * self.error * around.max(1e-12))).powf(4.0 / 3.0);
        (rays.min(self.most as f32) as u32).next_power_of_two().clamp(CLOSER * self.base, self.most)
    }

    /// Most rays of a texel that may lie at the end of a penumbra: the share of a lamp that all of them miss is about
    /// what noise may reach.
    pub(super) fn at_end(&self) -> u32 {
        let rays = 1.0 / (PENUMBRA * self.error.max(1e-6));
        (rays as u32).next_power_of_two().max(AT_END * self.base).min(self.most)
    }
}

/// Irradiance that the light of one lamp is measured by at a texel, W/m², where `so_far` arrives there and `mean` in the
/// whole scene: what is dim beside the scene must be clean beside what lights it.
pub(super) fn yardstick(so_far: Rgb, mean: f32) -> f32 {
    (BESIDE * so_far.max_element()).clamp(DIM * mean, mean)
}

/// Light straight from lamps at every texel.
#[derive(Serialize, Deserialize)]
pub struct Direct {
    /// W/m².
    pub irradiance: Vec<Rgb>,
    /// The same by light group.
    pub groups: Grouped,
    /// Root of the mean squared noise to be expected in penumbrae, W/m², mean of channels.
    pub noise: f32,
    /// Rays cast.
    pub rays: u64,
}

/// Irradiance of every texel straight from the lamps, and apart for so many `groups`.
pub fn texel_direct(
    lamps: &Lamps,
    groups: usize,
    atlas: &Atlas,
    texels: &Texels,
    footprint: &Footprint,
    settings: &DirectSettings,
    progress: &dyn Progress,
) -> Result<Direct, Cancelled> {
    let mut irradiance = vec![Rgb::ZERO; texels.len()];
    let mut groups = Grouped::new(groups, texels.len());
    let mut part = vec![Rgb::ZERO; texels.len()];
    let count = lamps.len() - if settings.sky { 0 } else { lamps.skies() };
    let counter = Counter::new(progress, Stage::Direct, texels.len() * count * 2);
    let rays = AtomicU64::new(0);
    let mean = sample_mean(lamps, footprint, texels.len());
    let mut seen = vec![Visibility::default(); texels.len()];
    let mut noise = vec![0.0f64; texels.len().div_ceil(CHUNK)];
    for lamp in 0..count {
        let look = Look {
            lamps,
            lamp,
            atlas,
            texels,
            footprint,
            settings,
            so_far: &irradiance,
            mean,
            rays: &rays,
            counter: &counter,
        };
        // `part` holds what would arrive unblocked until it is known what does.
        look.glance(&mut seen, &mut part)?;
        look.closer(&mut seen, &part)?;
        let shared = look.shared(&mut seen, &part)?;
        // What those around have told is put in place of what a texel saw alone.
        shared.iter().for_each(|&(t, share, variance)| seen[t as usize] = Visibility::known(share, variance));
        let chunks = part.par_chunks_mut(CHUNK).zip(seen.par_chunks(CHUNK)).zip(&mut noise);
        chunks.enumerate().try_for_each(|(chunk, ((part, seen), noise))| {
            for (i, (e, seen)) in part.iter_mut().zip(seen).enumerate() {
                *e *= footprint.lit((chunk * CHUNK + i) as u32);
                *noise += f64::from(e.element_sum() / 3.0).powi(2) * f64::from(seen.variance());
                *e *= seen.share();
            }
            counter.advance(part.len())
        })?;
        irradiance.par_iter_mut().zip(&part).for_each(|(e, &part)| *e += part);
        groups.add(lamps.group(lamp), &part);
    }
    let noise = (noise.iter().sum::<f64>() / texels.len().max(1) as f64).sqrt() as f32;
    Ok(Direct { irradiance, groups, noise, rays: rays.into_inner() })
}

/// The same again, whole and by light group, with many rays, for the texels that are `wanted`. Returns the rays cast.
pub fn closer_direct(
    lamps: &Lamps,
    texels: &Texels,
    footprint: &Footprint,
    settings: &DirectSettings,
    wanted: &[bool],
    irradiance: &mut [Rgb],
    groups: &mut Grouped,
    progress: &dyn Progress,
) -> Result<u64, Cancelled> {
    let mean = sample_mean(lamps, footprint, texels.len());
    let rays = AtomicU64::new(0);
    let rows = groups.rows_mut(texels.len());
    let all = irradiance.par_iter_mut().zip(rows).zip(wanted).enumerate().filter(|(_, (_, wanted))| **wanted);
    all.try_for_each(|(t, ((e, row), _))| {
        let texel = t as u32;
        let mut cast = 0;
        let mut sum = Rgb::ZERO;
        let usable = footprint.usable(texel);
        row.fill(Rgb::ZERO);
        for lamp in 0..lamps.len() {
            let Some(sender) = lamps.get(lamp, &footprint.centre(texel)) else { continue };
            let free = unoccluded(sender, texels, footprint, texel);
            let (point, seed) = (|u| usable.point(u), hash2(texel, lamp as u32));
            let aim = aim(sender, texels, footprint, texel);
            let mut look = Visibility::default();
            cast += lamps.test(&aim, seed, MANY * settings.base, point, &mut look);
            if look.seen() == Seen::Part {
                let most = settings.penumbra(free.max_element(), yardstick(*e, mean));
                cast += lamps.test(&aim, seed, most, point, &mut look);
            }
            let light = free * look.share() * footprint.lit(texel);
            sum += light;
            if let Some(part) = row.get_mut(usize::from(lamps.group(lamp))) {
                *part += light;
            }
        }
        *e = sum;
        rays.fetch_add(cast, Ordering::Relaxed);
        if progress.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    })?;
    Ok(rays.into_inner())
}

/// Mean irradiance from all lamps, W/m², mean of channels, from every so many-th texel.
fn sample_mean(lamps: &Lamps, footprint: &Footprint, texels: usize) -> f32 {
    let step = texels.div_ceil(MEAN_SAMPLES).max(1);
    let sum: f32 = (0..texels.div_ceil(step))
        .into_par_iter()
        .map(|i| lamps.mean(&[footprint.centre((i * step) as u32)], i as u32, 1, |_, _| ()).element_sum() / 3.0)
        .collect::<Vec<f32>>()
        .iter()
        .sum();
    sum / texels.div_ceil(step).max(1) as f32
}

/// Irradiance from an unblocked lamp: at the texel's centre, or averaged over the texel where the lamp is so close or
/// the surface so bent that this differs.
pub(super) fn unoccluded(lamp: &Lamp, texels: &Texels, footprint: &Footprint, texel: u32) -> Rgb {
    let at = |p: SurfacePoint| lamp.unoccluded(p.position, p.shading_normal);
    let centre = footprint.centre(texel);
    if !footprint.is_bent(texel) && lamp.distance(centre.position) > NEAR * texels.area[texel as usize].sqrt() {
        return at(centre);
    }
    let (usable, sequence) = (footprint.usable(texel), Sequence::new(hash2(texel, 0x0ea7)));
    let sample = |i| at(usable.point(sequence.first(i)));
    let (mut sum, mut least, mut most) = (Rgb::ZERO, f32::INFINITY, 0f32);
    for value in (0..NEAR_SAMPLES).map(sample) {
        sum += value;
        (least, most) = (least.min(value.max_element()), most.max(value.max_element()));
    }
    if !lamp.has_rim() || least > FADED * most {
        return sum / NEAR_SAMPLES as f32;
    }
    (sum + (NEAR_SAMPLES..RIM_SAMPLES).map(sample).sum::<Rgb>()) / RIM_SAMPLES as f32
}

/// The lamp, to be sampled from a texel.
pub(super) fn aim<'a>(lamp: &'a Lamp, texels: &Texels, footprint: &Footprint, texel: u32) -> Aim<'a> {
    let centre = footprint.centre(texel);
    lamp.aim(centre.position, centre.shading_normal, texels.area[texel as usize].sqrt())
}

/// Irradiance of elements straight from the lamps, W/m², whole and by light group: the texels' mean for fronts of charts,
/// sampled with `rays` rays per lamp elsewhere.
pub fn element_direct(
    lamps: &Lamps,
    surfels: &Surfels,
    elements: &[Element],
    direct: &Direct,
    rays: u32,
) -> (Vec<Rgb>, Grouped) {
    let texel_count = surfels.texels.len() as u32;
    let mut groups = Grouped::new(direct.groups.groups(), elements.len());
    let whole = elements
        .par_iter()
        .zip(groups.rows_mut(elements.len()))
        .enumerate()
        .map(|(index, (element, row))| {
            if element.side == Side::Front && element.surfels.end <= texel_count {
                let area = |s: u32| surfels.area(s);
                let total: f32 = element.surfels.clone().map(area).sum();
                for s in element.surfels.clone() {
                    let share = area(s) / total;
                    row.iter_mut().zip(direct.groups.of(s as usize)).for_each(|(sum, &e)| *sum += e * share);
                }
                return element.surfels.clone().map(|s| direct.irradiance[s as usize] * area(s)).sum::<Rgb>() / total;
            }
            let points = element_points(surfels, element, rays as usize);
            lamps.mean(&points, hash3(index as u32, 0xe1e, 0), rays, |group, light| {
                if let Some(part) = row.get_mut(usize::from(group)) {
                    *part += light;
                }
            })
        })
        .collect();
    (whole, groups)
}

/// Irradiance of elements from the sky through openings, W/m², by `rays` rays each.
pub fn element_sky(lamps: &Lamps, surfels: &Surfels, elements: &[Element], rays: u32) -> Vec<Rgb> {
    let Some(sky) = (0..lamps.len()).find(|&lamp| lamps.is_sky(lamp)) else { return vec![Rgb::ZERO; elements.len()] };
    let of_element = |(index, element)| {
        // What an opening sends unblocked is costly to know at a point, and varies little over an element.
        let points = element_points(surfels, element, SKY_POINTS);
        lamps.mean_of(sky, &points, hash3(index as u32, 0x5c1, 0), rays)
    };
    elements.par_iter().enumerate().map(of_element).collect()
}

/// The middles of an element's surfels, or of `most` of them.
fn element_points(surfels: &Surfels, element: &Element, most: usize) -> Vec<SurfacePoint> {
    let point = |s: u32| {
        let normal = if element.side == Side::Front { surfels.normal(s) } else { -surfels.normal(s) };
        SurfacePoint { position: surfels.position(s), geometric_normal: normal, shading_normal: normal }
    };
    element.surfels.clone().step_by(element.surfels.len().div_ceil(most)).map(point).collect()
}
