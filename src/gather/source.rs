//! What a gather ray sees: the radiance of the coarse solution, refined by each texel's own direct light.

use super::guide::{Bright, Guide};
use super::lit_scene::LitScene;
use super::parts::Parts;
use super::secondary::Secondary;
use super::tally::{Grouped, Tally};
use super::visibility::Screen;
use crate::accel::{Accel, Hit, Ray, offset_origin};
use crate::atlas::SurfacePoint;
use crate::hierarchy::{Side, Surfels};
use crate::math::{cosine_hemisphere, hash2, unit_float};
use crate::scene::Rgb;
use glam::{Vec2, Vec3};
use half::f16;
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, PI};

/// Below this share the open part of a texel is too small to be known well.
const LEAST_OPEN: f32 = 0.25;
/// Widths of an element within which its mean irradiance says too little to those who see it.
const CONTACT: f32 = 1.0;
/// Turns of a path at most.
const MOST_TURNS: u32 = 8;
/// Share of what a path stands for below which the coarse solution tells enough.
const FAINT: f32 = 0.1;

/// Where rays from the side of a surfel start.
#[derive(Clone, Copy)]
pub struct Start<'a> {
    /// Just above its middle.
    pub origin: Vec3,
    /// Unit normal of the side.
    pub normal: Vec3,
    /// The sky for them; the neighbourhood that decides on it is that of the surfel's middle.
    pub screen: Screen<'a>,
}

/// What a ray sees.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// W/(m²·sr).
    pub radiance: Rgb,
    /// The receiver that reflects it: an element, or behind all elements a shut texel.
    pub receiver: Option<u32>,
}

/// What a path sees.
#[derive(Clone, Copy, Debug)]
pub(super) struct Followed {
    /// W/(m²·sr).
    pub radiance: Rgb,
    /// Distance to the first surface, metres.
    pub distance: f32,
    /// Rays cast, those to lamps left out.
    pub rays: u32,
}

/// What a ray runs into.
struct Met {
    /// Radiance of the sky, or emitted by surfaces as rays see it, W/(m²·sr).
    own: Rgb,
    /// Weight of what the place reflects: what surfaces before it let through.
    passed: Rgb,
    /// Distance, metres.
    distance: f32,
    /// Where it ends and is reflected, if it is.
    place: Option<Place>,
    /// What reflects.
    receiver: Option<u32>,
}

/// A point of a surface that reflects.
#[derive(Clone, Copy)]
struct Place {
    point: Vec3,
    /// Unit normal of the side that was met.
    normal: Vec3,
    /// Of the angle between it and the ray.
    cosine: f32,
    side: Side,
    surfel: u32,
    element: u32,
    /// The element, or the shut texel.
    receiver: u32,
    /// True if the element is all that is met: nothing stands there or crosses it.
    is_clear: bool,
    /// True if the light that lamps bring to its texel stands for that at the point: nothing touches the texel.
    is_whole: bool,
}

/// Share of a texel that is seen, from the share of it that is open: what is wholly covered is seen through gaps.
pub(super) fn open_part(open: f32) -> f32 {
    if open > 0.0 { open.max(LEAST_OPEN) } else { 1.0 }
}

/// The scene as a source of light.
pub struct Source<'a> {
    /// The scene and its light.
    pub lit: LitScene<'a>,
    /// Where bright things are seen, if that is known.
    guide: Option<&'a Guide>,
    /// What is sent to probes.
    pub(super) secondary: Option<Secondary>,
    /// Reflected radiance of every surfel's front, W/(m²·sr).
    front: Vec<[f16; 3]>,
    /// Reflected radiance of every element, W/(m²·sr).
    elements: Vec<Rgb>,
    /// Area of every element, with what something stands on, m².
    areas: Vec<f32>,
    /// As `front` and `elements`, by light group.
    parts: Parts,
}

/// Radiance that a surfel reflects of irradiance `e`, as far as halves can hold it.
pub(super) fn reflected(surfels: &Surfels, s: u32, e: Rgb) -> Rgb {
    (e * surfels.reflectance(s) * FRAC_1_PI).min(Rgb::splat(f16::MAX.to_f32()))
}

impl<'a> Source<'a> {
    /// `rest` is the irradiance of every receiver from everything but lamps, W/m², `rest_groups` the same by light group;
    /// `guide` aims the rays of probes.
    pub fn new(lit: LitScene<'a>, rest: &[Rgb], rest_groups: &Grouped, guide: Option<&'a Guide>) -> Self {
        let LitScene { surfels, hierarchy, footprint, element_direct, .. } = lit;
        let radiance = |s: u32, e: Rgb| reflected(surfels, s, e);
        let front: Vec<[f16; 3]> = (0..surfels.len() as u32)
            .into_par_iter()
            .map(|s| {
                let Some(e) = hierarchy.element_of(s, Side::Front) else { return [f16::ZERO; 3] };
                // A texel's irradiance is the mean with what is covered and dark; others see only the open part.
                let own = match lit.direct.irradiance.get(s as usize) {
                    Some(&mean) => mean / open_part(footprint.open()[s as usize]),
                    None => element_direct[e as usize],
                };
                let receiver = lit.shut_receiver(s).unwrap_or(e);
                radiance(s, own + rest[receiver as usize]).to_array().map(f16::from_f32)
            })
            .collect();
        let (elements, areas): (Vec<Rgb>, Vec<f32>) = hierarchy
            .elements
            .par_iter()
            .enumerate()
            .map(|(i, element)| {
                let mut sum = Rgb::ZERO;
                let (mut area, mut extent) = (0.0, 0.0);
                for s in element.surfels.clone() {
                    let a = surfels.area(s);
                    area += a;
                    extent += surfels.extent(s);
                    sum += a * match element.side {
                        Side::Front => Rgb::from_array(front[s as usize].map(f16::to_f32)),
                        Side::Back => radiance(s, element_direct[i] + rest[i]),
                    };
                }
                (sum / area.max(f32::MIN_POSITIVE), extent)
            })
            .unzip();
        // Only probes have them sent; not through what hides reflected light and no lamp.
        let casts_shadows = lit.accel.scene().instances.iter().all(|i| i.casts_shadows);
        let secondary = guide.filter(|_| casts_shadows).map(|_| Secondary::new(hierarchy, &elements));
        let parts = Parts::new(&lit, rest_groups);
        Self { lit, guide, secondary, front, elements, areas, parts }
    }

    /// Number of light groups that are kept apart.
    pub fn groups(&self) -> usize {
        self.lit.groups.len()
    }

    /// Light straight from lamps at a texel, W/m², mean of channels.
    pub fn direct(&self, texel: u32) -> f32 {
        self.lit.direct.irradiance[texel as usize].element_sum() / 3.0
    }

    /// What is bright as seen from a surfel's front.
    pub fn bright(&self, surfel: u32) -> Option<Bright<'_>> {
        Some(self.guide?.around(self.lit.hierarchy.element_of(surfel, Side::Front)?))
    }

    /// Where rays from a surfel's side start.
    pub fn start(&self, surfel: u32, side: Side) -> Start<'_> {
        let LitScene { surfels, hierarchy, lamps, .. } = self.lit;
        let (position, normal) = (surfels.position(surfel), hierarchy.normal(surfels, surfel, side));
        Start { origin: offset_origin(position, normal), normal, screen: lamps.screen(position, normal) }
    }

    /// What is seen along a ray that stands for `solid_angle` sr, as the coarse solution has it; of the sky what
    /// `screen` shows.
    pub(super) fn look<T: Tally>(
        &self,
        origin: Vec3,
        direction: Vec3,
        solid_angle: f32,
        screen: Screen,
        tally: &mut T,
    ) -> Seen {
        let met = self.meet(origin, direction, solid_angle, screen, None, Rgb::ONE, tally);
        let cached = |place: &Place| self.cached(place, met.distance, solid_angle, met.passed, tally);
        let reflected = met.place.as_ref().map_or(Rgb::ZERO, cached);
        Seen { radiance: met.own + met.passed * reflected, receiver: met.receiver }
    }

    /// Like `look`, but a path that ends nearer than the coarse solution can tell what happens there, as in corners and
    /// narrow gaps, goes on. What is sent to `receiver` does not count. `seed` makes its turns.
    pub(super) fn follow<T: Tally>(
        &self,
        origin: Vec3,
        direction: Vec3,
        solid_angle: f32,
        screen: Screen,
        receiver: Vec3,
        seed: u32,
        tally: &mut T,
    ) -> Followed {
        let first = self.meet(origin, direction, solid_angle, screen, Some(receiver), Rgb::ONE, tally);
        let (mut radiance, mut weight) = (first.own, first.passed);
        if first.place.is_some_and(|place| self.is_sent(&place, receiver)) {
            return Followed { radiance, distance: first.distance, rays: 1 };
        }
        let (mut place, mut distance, mut solid_angle) = (first.place, first.distance, solid_angle);
        let mut rays = 1;
        for turn in 0.. {
            let Some(at) = place else { break };
            let is_far = distance * distance > CONTACT * CONTACT * self.areas[at.element as usize];
            if turn == MOST_TURNS || is_far || weight.max_element() < FAINT {
                radiance += weight * self.cached(&at, distance, solid_angle, weight, tally);
                break;
            }
            let seed = hash2(seed, turn);
            weight *= self.lit.surfels.reflectance(at.surfel);
            let (direct, screen) = self.direct_at(&at, seed, weight * FRAC_1_PI, tally);
            radiance += weight * FRAC_1_PI * direct;
            let u = Vec2::new(unit_float(hash2(seed, 1)), unit_float(hash2(seed, 2)));
            let origin = offset_origin(at.point, at.normal);
            let next = self.meet(origin, cosine_hemisphere(at.normal, u), PI, screen, None, weight, tally);
            radiance += weight * next.own;
            weight *= next.passed;
            rays += 1;
            (place, distance) = (next.place, next.distance);
            // It now stands for all that the point sees.
            solid_angle = PI;
        }
        Followed { radiance, distance: first.distance, rays }
    }

    /// What a ray that stands for `solid_angle` sr runs into. What translucent surfaces send counts as own; of all that
    /// is met, the receiver is drawn by how much of the view it fills: colour is lost by that, but only to the coarse
    /// solution. What is sent to `receiver` does not count as own. The tally gets `weight` times what does.
    fn meet<T: Tally>(
        &self,
        origin: Vec3,
        direction: Vec3,
        solid_angle: f32,
        screen: Screen,
        receiver: Option<Vec3>,
        weight: Rgb,
        tally: &mut T,
    ) -> Met {
        let accel = self.lit.accel;
        let mut ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
        let mut met = Met { own: Rgb::ZERO, passed: Rgb::ONE, distance: f32::INFINITY, place: None, receiver: None };
        // What casts no shadow hides what is reflected behind it, but not what shines there.
        let (mut shines, mut is_hidden) = (Rgb::ONE, false);
        let (mut draw, mut layers) = (None, 0);
        loop {
            let Some(hit) = accel.surface(&ray) else {
                let sky = shines * screen.sky(origin, direction, solid_angle);
                met.own += sky;
                tally.add(self.lit.groups.of_environment(), weight * sky);
                return met;
            };
            let (emitted, place) = self.surface(&ray, &hit);
            met.own += shines * emitted;
            if T::COUNTS && emitted != Rgb::ZERO {
                tally.add(self.lit.emitter_group(&hit), weight * shines * emitted);
            }
            let met_by = place.map(|p| p.receiver);
            let through = accel.transmission_at(&hit).filter(|_| layers < Accel::MOST_LAYERS);
            match through {
                _ if is_hidden => {}
                None => {
                    (met.distance, met.place, is_hidden) = (hit.t, place, true);
                    if draw.is_none_or(|d| d >= 0.0) {
                        met.receiver = met_by;
                    }
                }
                Some(through) => {
                    let is_there = 1.0 - through.element_sum() / 3.0;
                    let counts = |place: &Place| receiver.is_none_or(|p| !self.is_sent(place, p));
                    if let Some(place) = place.filter(counts) {
                        let passed = met.passed * is_there;
                        met.own += passed * self.cached(&place, hit.t, solid_angle, weight * passed, tally);
                    }
                    let left = draw.unwrap_or_else(|| {
                        unit_float(direction.to_array().iter().fold(0, |seed, x| hash2(seed, x.to_bits())))
                    });
                    let fills = met.passed.element_sum() / 3.0 * is_there;
                    if left >= 0.0 && left < fills {
                        met.receiver = met_by;
                    }
                    draw = Some(left - fills);
                    met.passed *= through;
                }
            }
            if accel.casts_shadow(&hit) {
                let Some(through) = through else { return met };
                shines *= through;
            }
            layers += u32::from(through.is_some());
            ray = accel.behind(&ray, &hit);
        }
    }

    /// Radiance that the surface at a hit emits against the ray, and where it reflects.
    fn surface(&self, ray: &Ray, hit: &Hit) -> (Rgb, Option<Place>) {
        let lit = &self.lit;
        let scene = lit.accel.scene();
        let direction = ray.direction;
        let (instance, triangle) = (hit.instance as usize, hit.triangle as usize);
        let cosine = -hit.normal.dot(direction);
        let side = if cosine >= 0.0 { Side::Front } else { Side::Back };
        if side == Side::Back && !scene.material_of(scene.instances[instance].mesh, triangle).double_sided {
            return (Rgb::ZERO, None);
        }
        let own = if lit.emission.is_seen(scene, instance, triangle) {
            let there = scene.alpha_at(instance, triangle, hit.barycentric);
            scene.emission_at(instance, triangle, hit.barycentric) * there
        } else {
            Rgb::ZERO
        };
        let place = lit.surfels.at(lit.atlas, instance, triangle, hit.barycentric).and_then(|surfel| {
            let is_clear = lit.surfels.is_clear(surfel);
            let is_whole = is_clear && lit.footprint.open().get(surfel as usize).is_none_or(|&open| open == 1.0);
            let surfel = match lit.atlas.locate(instance, triangle, hit.barycentric) {
                Some((_, p)) => lit.footprint.seen_at(surfel, p),
                None => surfel,
            };
            let element = lit.hierarchy.element_of(surfel, side)?;
            let normal = if side == Side::Front { hit.normal } else { -hit.normal };
            let shut = if side == Side::Front { lit.shut_receiver(surfel) } else { None };
            let receiver = shut.unwrap_or(element);
            let point = ray.origin + direction * hit.t;
            Some(Place { point, normal, cosine: cosine.abs(), side, surfel, element, receiver, is_clear, is_whole })
        });
        (own, place)
    }

    /// True if what a place reflects is sent to receivers at `p`.
    fn is_sent(&self, place: &Place, p: Vec3) -> bool {
        let is_plain = place.is_clear && place.receiver == place.element;
        is_plain && self.secondary.as_ref().is_some_and(|secondary| secondary.is_sent(place.element, p))
    }

    /// What a place reflects as the coarse solution has it, to a ray that stands for `solid_angle` sr, W/(m²·sr). The
    /// tally gets `weight` times that.
    fn cached<T: Tally>(&self, place: &Place, distance: f32, solid_angle: f32, weight: Rgb, tally: &mut T) -> Rgb {
        let element = place.element as usize;
        let footprint = solid_angle * distance * distance / place.cosine.max(0.05);
        // The ray stands for a patch of the surface: its mean is what the ray should bring, not one texel of it.
        let is_wide = footprint > self.areas[element] && place.receiver == place.element;
        let surfel = (place.side == Side::Front && !is_wide).then_some(place.surfel);
        self.sent(surfel, place.element, weight, tally)
    }

    /// What the front of a surfel reflects, or the whole element, W/(m²·sr). The tally gets `weight` times that.
    pub(super) fn sent<T: Tally>(&self, surfel: Option<u32>, element: u32, weight: Rgb, tally: &mut T) -> Rgb {
        if T::COUNTS {
            let parts = surfel.map_or_else(|| self.parts.element(element), |s| self.parts.front(s));
            tally.reflected(weight, parts);
        }
        match surfel {
            Some(s) => Rgb::from_array(self.front[s as usize].map(f16::to_f32)),
            None => self.elements[element as usize],
        }
    }

    /// Irradiance straight from lamps at a place, W/m²: its texel's if that has one for all of it, else sampled at the
    /// very point, because a gap may be narrower than a texel. With what is counted of the sky by that. The tally gets
    /// `weight` times the irradiance.
    fn direct_at<T: Tally>(&self, place: &Place, seed: u32, weight: Rgb, tally: &mut T) -> (Rgb, Screen<'_>) {
        let LitScene { direct, lamps, .. } = self.lit;
        let s = place.surfel as usize;
        // What has no light has none anywhere.
        let stands_for_all = |&e: &Rgb| place.is_whole || e == Rgb::ZERO;
        if place.side == Side::Front && direct.irradiance.get(s).is_some_and(stands_for_all) {
            if T::COUNTS {
                tally.lit(weight, direct.groups.of(s));
            }
            return (direct.irradiance[s], self.start(place.surfel, place.side).screen);
        }
        let Place { point, normal, .. } = *place;
        let point = SurfacePoint { position: point, geometric_normal: normal, shading_normal: normal };
        let irradiance = lamps.at(&point, seed, |group, light| tally.add(group, weight * light));
        (irradiance, lamps.screen(place.point, normal))
    }
}
