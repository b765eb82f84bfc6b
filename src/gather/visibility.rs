//! Shadow rays: how much of each lamp a receiver sees.

use super::choice::{Reach, draw};
use super::lamp::Lamp;
use crate::accel::{Accel, Ray, offset_origin};
use crate::atlas::SurfacePoint;
use crate::math::{Sequence, hash2, unit_float};
use crate::scene::Rgb;
use crate::transport::SELF_INTERSECTION;

/// So many lamps are all tested at a single point.
const FEW: usize = 4;

/// All lamps with what they need to be tested.
pub struct Lamps<'a> {
    pub(super) lamps: Vec<Lamp>,
    reaches: Vec<Reach>,
    accel: &'a Accel<'a>,
}

/// What a texel sees of a lamp.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Seen {
    /// The lamp cannot light the texel.
    Never,
    Blocked,
    Open,
    Part,
}

/// Sums over the samples of one receiver: what arrives, and what would arrive.
#[derive(Clone, Copy, Default)]
pub(super) struct Visibility {
    open: Rgb,
    all: Rgb,
}

impl Visibility {
    pub(super) fn seen(&self) -> Seen {
        if self.all.max_element() <= 0.0 {
            Seen::Never
        } else if self.open == self.all {
            Seen::Open
        } else if self.open == Rgb::ZERO {
            Seen::Blocked
        } else {
            Seen::Part
        }
    }

    /// Unblocked share per channel.
    pub(super) fn share(&self) -> Rgb {
        Rgb::from_array(std::array::from_fn(|c| if self.all[c] > 0.0 { self.open[c] / self.all[c] } else { 0.0 }))
    }
}

impl<'a> Lamps<'a> {
    /// Lamps that shine into the scene of `accel`.
    pub fn new(lamps: Vec<Lamp>, accel: &'a Accel<'a>) -> Self {
        let reaches = lamps.iter().map(Reach::new).collect();
        Self { lamps, reaches, accel }
    }

    /// Casts one ray per sample `indices` of `lamp` from points of one receiver.
    pub(super) fn test(
        &self,
        lamp: usize,
        seed: u32,
        indices: std::ops::Range<u32>,
        point: impl Fn(glam::Vec2) -> SurfacePoint,
        sum: &mut Visibility,
    ) -> u64 {
        let lamp_ref = &self.lamps[lamp];
        let sequence = Sequence::new(hash2(seed, lamp as u32));
        let mut rays = 0;
        for i in indices {
            let p = point(sequence.second(i));
            let Some(sample) = lamp_ref.sample(p.position, p.shading_normal, sequence.first(i)) else { continue };
            sum.all += sample.weight;
            if sample.direction.dot(p.geometric_normal) <= 0.0 {
                continue;
            }
            rays += 1;
            let ray = shadow_ray(&p, sample.direction, sample.distance);
            sum.open +=
                if lamp_ref.casts_shadows { sample.weight * self.accel.visibility(&ray) } else { sample.weight };
        }
        rays
    }

    /// Irradiance at a point, W/m², from a ray to each of few lamps or to one drawn out of many.
    pub fn at(&self, point: &SurfacePoint, seed: u32) -> Rgb {
        let points = std::slice::from_ref(point);
        if self.lamps.len() <= FEW {
            return self.mean(points, seed, 1);
        }
        let u = unit_float(hash2(seed, 0xd4a3));
        draw(&self.lamps, &self.reaches, point.position, point.shading_normal, u)
            .map_or(Rgb::ZERO, |(lamp, chance)| self.mean_of(lamp, points, seed, 1) / chance)
    }

    /// Irradiance from all lamps averaged over points, with `rays` rays per lamp.
    pub(super) fn mean(&self, points: &[SurfacePoint], seed: u32, rays: u32) -> Rgb {
        (0..self.lamps.len()).map(|lamp| self.mean_of(lamp, points, seed, rays)).sum()
    }

    /// The part of one lamp in [`Lamps::mean`].
    fn mean_of(&self, lamp: usize, points: &[SurfacePoint], seed: u32, rays: u32) -> Rgb {
        let at = |p: &SurfacePoint| self.lamps[lamp].unoccluded(p.position, p.shading_normal);
        let free = points.iter().map(at).sum::<Rgb>() / points.len() as f32;
        if free.max_element() <= 0.0 {
            return Rgb::ZERO;
        }
        let mut sum = Visibility::default();
        let pick = |u: glam::Vec2| points[((u.x * points.len() as f32) as usize).min(points.len() - 1)];
        self.test(lamp, seed, 0..rays, pick, &mut sum);
        free * sum.share()
    }
}

/// The segment from just above a surface point to what lies at `distance` along `direction` from the point itself: aimed
/// anew, so that at grazing angles the lifted ray does not pierce the lamp's own surface early.
fn shadow_ray(p: &SurfacePoint, direction: glam::Vec3, distance: f32) -> Ray {
    let origin = offset_origin(p.position, p.geometric_normal);
    if distance.is_infinite() {
        return Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    }
    let v = p.position + direction * distance - origin;
    let length = v.length();
    Ray { origin, direction: v / length.max(f32::MIN_POSITIVE), t_min: 0.0, t_max: length * (1.0 - SELF_INTERSECTION) }
}
