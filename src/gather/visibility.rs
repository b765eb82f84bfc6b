//! Shadow rays: how much of each lamp a receiver sees.

use super::choice::{Reach, draw};
use super::lamp::{Aim, Lamp, Shape};
use super::openings::Portals;
use crate::accel::{Accel, Ray, offset_origin};
use crate::atlas::SurfacePoint;
use crate::math::{Sequence, hash2, unit_float};
use crate::scene::{Environment, Group, Rgb};
use crate::transport::SELF_INTERSECTION;
use glam::{Vec2, Vec3};

/// So many lamps are all tested at a single point.
const FEW: usize = 4;

/// All lamps with what they need to be tested.
pub struct Lamps<'a> {
    lamps: Vec<Lamp>,
    reaches: Vec<Reach>,
    portals: Portals,
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
    /// Samples of the lamp that were tried.
    pub(super) tried: u32,
    /// Variance of the unblocked share, if it is known otherwise than by counting samples.
    known: Option<f32>,
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

    /// An unblocked share that was found otherwise, and the variance of its mean channel.
    pub(super) fn known(share: Rgb, variance: f32) -> Self {
        Self { open: share, all: Rgb::ONE, tried: 0, known: Some(variance) }
    }

    /// Variance of the unblocked share, mean of channels: that of stratified samples across an edge falls as n^(−3/2).
    pub(super) fn variance(&self) -> f32 {
        if let Some(variance) = self.known {
            return variance;
        }
        let share = self.share().element_sum() / 3.0;
        (share * (1.0 - share)).max(0.0) / (self.tried.max(1) as f32).powf(1.5)
    }

    /// The same of samples that fall anywhere: what hides an opening has many edges.
    pub(super) fn chance(&self) -> f32 {
        let share = self.share().element_sum() / 3.0;
        (share * (1.0 - share)).max(0.0) / self.tried.max(1) as f32
    }

    /// Unblocked share per channel.
    pub(super) fn share(&self) -> Rgb {
        Rgb::from_array(std::array::from_fn(|c| if self.all[c] > 0.0 { self.open[c] / self.all[c] } else { 0.0 }))
    }
}

/// The sky for rays from one receiver, without what is sent to it.
#[derive(Clone, Copy)]
pub struct Screen<'a> {
    portal: Option<&'a Lamp>,
    environment: &'a Environment,
}

impl Screen<'_> {
    /// Radiance that a ray sees which leaves the scene and stands for `solid_angle` sr, W/(m²·sr).
    pub fn sky(&self, origin: Vec3, direction: Vec3, solid_angle: f32) -> Rgb {
        match self.portal {
            Some(Lamp { shape: Shape::Portal(portal), .. }) if portal.shows(origin, direction) => Rgb::ZERO,
            _ => self.environment.mean_radiance(direction, solid_angle),
        }
    }
}

impl<'a> Lamps<'a> {
    /// Lamps that shine into the scene of `accel`, and the portals through which its sky does.
    pub fn new(lamps: Vec<Lamp>, portals: Portals, accel: &'a Accel<'a>) -> Self {
        let reaches = lamps.iter().map(Reach::new).collect();
        Self { lamps, reaches, portals, accel }
    }

    /// Lamps that may light one receiver, numbered from zero: the sky seen through portals comes last.
    pub(super) fn len(&self) -> usize {
        self.lamps.len() + self.skies()
    }

    /// Those among them that stand for the sky: one, or none where no portal is.
    pub(super) fn skies(&self) -> usize {
        usize::from(!self.portals.is_empty())
    }

    /// True if number `lamp` is the sky, which is seen unlike in every neighbourhood.
    pub(super) fn is_sky(&self, lamp: usize) -> bool {
        lamp == self.lamps.len()
    }

    /// Number `lamp` of those that may light a surface point.
    pub(super) fn get(&self, lamp: usize, place: &SurfacePoint) -> Option<&Lamp> {
        if self.is_sky(lamp) {
            self.portals.at(place.position, place.geometric_normal)
        } else {
            Some(&self.lamps[lamp])
        }
    }

    /// Light group of number `lamp`.
    pub(super) fn group(&self, lamp: usize) -> Group {
        if self.is_sky(lamp) { self.portals.group() } else { self.lamps[lamp].group }
    }

    /// The sky as rays from a surface point are to count it.
    pub fn screen(&self, position: Vec3, normal: Vec3) -> Screen<'_> {
        Screen { portal: self.portals.at(position, normal), environment: &self.accel.scene().environment }
    }

    /// Tries samples of the lamp that one receiver aims at, from points of that, until there are `count`. Returns the rays
    /// that took.
    pub(super) fn test(
        &self,
        aim: &Aim,
        seed: u32,
        count: u32,
        point: impl Fn(Vec2) -> SurfacePoint,
        sum: &mut Visibility,
    ) -> u64 {
        let sequence = Sequence::new(seed);
        let mut rays = 0;
        for i in sum.tried..count {
            rays += self.probe(aim, &point(sequence.second(i)), sequence.first(i), sum);
        }
        rays
    }

    /// Casts a ray to the point `u` of the lamp that is aimed at. Returns how many that took.
    fn probe(&self, aim: &Aim, from: &SurfacePoint, u: Vec2, sum: &mut Visibility) -> u64 {
        sum.tried += 1;
        let Some(sample) = aim.sample(from.position, from.shading_normal, u) else { return 0 };
        sum.all += sample.weight;
        if sample.direction.dot(from.geometric_normal) <= 0.0 {
            return 0;
        }
        let ray = shadow_ray(from, sample.direction, sample.distance);
        sum.open += if aim.lamp.casts_shadows { sample.weight * self.accel.visibility(&ray) } else { sample.weight };
        1
    }

    /// Irradiance at a point, W/m², from a ray to each of few lamps or to one drawn out of many. `part` gets to know what
    /// of it is whose.
    pub(super) fn at(&self, point: &SurfacePoint, seed: u32, mut part: impl FnMut(Group, Rgb)) -> Rgb {
        let points = std::slice::from_ref(point);
        if self.lamps.len() <= FEW {
            return self.mean(points, seed, 1, part);
        }
        let u = unit_float(hash2(seed, 0xd4a3));
        let drawn = draw(&self.lamps, &self.reaches, point.position, point.shading_normal, u);
        let sky = if self.portals.is_empty() { Rgb::ZERO } else { self.mean_of(self.lamps.len(), points, seed, 1) };
        part(self.portals.group(), sky);
        let Some((lamp, chance)) = drawn else { return sky };
        let light = self.mean_of(lamp, points, seed, 1) / chance;
        part(self.lamps[lamp].group, light);
        sky + light
    }

    /// Irradiance from all lamps averaged over points, with `rays` rays per lamp. `part` gets to know what of it is whose.
    pub(super) fn mean(&self, points: &[SurfacePoint], seed: u32, rays: u32, mut part: impl FnMut(Group, Rgb)) -> Rgb {
        let of = |lamp| {
            let light = self.mean_of(lamp, points, seed, rays);
            part(self.group(lamp), light);
            light
        };
        (0..self.len()).map(of).sum()
    }

    /// The part of one lamp in [`Lamps::mean`].
    pub(super) fn mean_of(&self, lamp: usize, points: &[SurfacePoint], seed: u32, rays: u32) -> Rgb {
        let sequence = Sequence::new(hash2(seed, lamp as u32));
        let mut sum = Visibility::default();
        for i in 0..rays {
            let p = points[((sequence.second(i).x * points.len() as f32) as usize).min(points.len() - 1)];
            if let Some(lamp) = self.get(lamp, &p) {
                self.probe(&lamp.aim(p.position, p.shading_normal, 0.0), &p, sequence.first(i), &mut sum);
            }
        }
        // What is blocked need not be known.
        if sum.open == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let at = |p: &SurfacePoint| {
            self.get(lamp, p).map_or(Rgb::ZERO, |lamp| lamp.unoccluded(p.position, p.shading_normal))
        };
        let free = points.iter().map(at).sum::<Rgb>() / points.len() as f32;
        free * sum.share()
    }
}

/// The segment from just above a surface point to what lies at `distance` along `direction` from the point itself: aimed
/// anew, so that at grazing angles the lifted ray does not pierce the lamp's own surface early.
fn shadow_ray(p: &SurfacePoint, direction: Vec3, distance: f32) -> Ray {
    let origin = offset_origin(p.position, p.geometric_normal);
    if distance.is_infinite() {
        return Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    }
    let v = p.position + direction * distance - origin;
    let length = v.length();
    Ray { origin, direction: v / length.max(f32::MIN_POSITIVE), t_min: 0.0, t_max: length * (1.0 - SELF_INTERSECTION) }
}
