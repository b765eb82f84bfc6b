//! What a gather ray sees: the radiance of the coarse solution, refined by each texel's own direct light.

use super::emitters::Emission;
use super::footprint::Footprint;
use crate::accel::{Accel, Hit, Ray};
use crate::atlas::Atlas;
use crate::hierarchy::{Hierarchy, Side, Surfels};
use crate::math::{hash3, unit_float};
use crate::scene::Rgb;
use glam::Vec3;
use half::f16;
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

/// Below this share the open part of a texel is too small to be known well.
const LEAST_OPEN: f32 = 0.25;

/// Translucent surfaces in a row, and share of light that passes them, from which on nothing more is looked for.
const MOST_LAYERS: u32 = 16;
const LEAST_PASSED: f32 = 2e-3;

/// What a ray sees.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// W/(m²·sr).
    pub radiance: Rgb,
    /// Distance to where it comes from, metres.
    pub distance: f32,
    /// The element that reflects it, if that shares in the element's irradiance.
    pub element: Option<u32>,
}

/// The scene as a source of light.
pub struct Source<'a> {
    /// Ray queries.
    pub accel: &'a Accel<'a>,
    atlas: &'a Atlas,
    surfels: &'a Surfels<'a>,
    hierarchy: &'a Hierarchy,
    emission: &'a Emission,
    footprint: &'a Footprint<'a>,
    /// Reflected radiance of every surfel's front, W/(m²·sr).
    front: Vec<[f16; 3]>,
    /// Reflected radiance of every element, W/(m²·sr).
    elements: Vec<Rgb>,
    /// Area of every element, m².
    areas: Vec<f32>,
}

impl<'a> Source<'a> {
    /// `direct` is the irradiance of every texel straight from lamps; `element_direct` and `element_rest` are the
    /// irradiance of every element from lamps and from everything else, all in W/m².
    pub fn new(
        accel: &'a Accel<'a>,
        atlas: &'a Atlas,
        surfels: &'a Surfels<'a>,
        hierarchy: &'a Hierarchy,
        emission: &'a Emission,
        footprint: &'a Footprint<'a>,
        direct: &[Rgb],
        element_direct: &[Rgb],
        element_rest: &[Rgb],
    ) -> Self {
        let radiance = |s: u32, e: Rgb| (e * surfels.reflectance(s) * FRAC_1_PI).min(Rgb::splat(f16::MAX.to_f32()));
        let front: Vec<[f16; 3]> = (0..surfels.len() as u32)
            .into_par_iter()
            .map(|s| {
                let Some(e) = hierarchy.element_of(s, Side::Front) else { return [f16::ZERO; 3] };
                // A texel's irradiance is the mean with what is covered and dark; others see only the open part.
                let own = match direct.get(s as usize) {
                    Some(&mean) => mean / footprint.open()[s as usize].max(LEAST_OPEN),
                    None => element_direct[e as usize],
                };
                // What something stands on does not share in what the element's open part receives.
                let share = if surfels.is_covered(s) && hierarchy.is_open(surfels, e) { 0.0 } else { 1.0 };
                radiance(s, own + element_rest[e as usize] * share).to_array().map(f16::from_f32)
            })
            .collect();
        let (elements, areas) = hierarchy
            .elements
            .par_iter()
            .enumerate()
            .map(|(i, element)| {
                let mut sum = Rgb::ZERO;
                let mut area = 0.0;
                for s in element.surfels.clone() {
                    let a = surfels.area(s);
                    area += a;
                    sum += a * match element.side {
                        Side::Front => Rgb::from_array(front[s as usize].map(f16::to_f32)),
                        Side::Back => radiance(s, element_direct[i] + element_rest[i]),
                    };
                }
                (sum / area.max(f32::MIN_POSITIVE), area)
            })
            .unzip();
        Self { accel, atlas, surfels, hierarchy, emission, footprint, front, elements, areas }
    }

    /// What is seen along a ray that stands for `solid_angle` sr.
    pub fn look(&self, origin: Vec3, direction: Vec3, solid_angle: f32) -> Seen {
        let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
        match self.accel.closest(&ray) {
            Some(hit) => match self.accel.transmission_at(&hit) {
                None => self.leaving(&hit, direction, solid_angle),
                Some(through) => self.look_through(ray, hit, through, solid_angle),
            },
            None => self.sky(direction, solid_angle),
        }
    }

    fn sky(&self, direction: Vec3, solid_angle: f32) -> Seen {
        let radiance = self.accel.scene().environment.mean_radiance(direction, solid_angle);
        Seen { radiance, distance: f32::INFINITY, element: None }
    }

    /// Sums what every surface in a row sends, weighted by what those before it let through; `first` is translucent.
    /// The element is one of theirs, drawn by how much of the view it fills: its colour is lost, but only to the coarse
    /// solution.
    fn look_through(&self, mut ray: Ray, first: Hit, through: Rgb, solid_angle: f32) -> Seen {
        let mut total = Seen { radiance: Rgb::ZERO, distance: f32::INFINITY, element: None };
        let (mut passed, mut inverse) = (Rgb::ONE, 0.0);
        let seed = hash3(ray.direction.x.to_bits(), ray.direction.y.to_bits(), ray.direction.z.to_bits());
        let (mut draw, mut undrawn) = (unit_float(seed), true);
        let mut next = Some((first, Some(through)));
        for _ in 0..MOST_LAYERS {
            let (layer, through) = match next {
                Some((hit, through)) => (self.leaving(&hit, ray.direction, solid_angle), through.unwrap_or(Rgb::ZERO)),
                None => (self.sky(ray.direction, solid_angle), Rgb::ZERO),
            };
            total.radiance += passed * layer.radiance;
            let fills = passed.element_sum() / 3.0 * (1.0 - through.element_sum() / 3.0);
            inverse += fills / layer.distance.max(1e-6);
            if undrawn && draw < fills {
                (total.element, undrawn) = (layer.element, false);
            }
            draw -= fills;
            passed *= through;
            let Some((hit, _)) = next.filter(|_| passed.max_element() > LEAST_PASSED) else { break };
            ray = self.accel.behind(&ray, &hit);
            next = self.accel.closest(&ray).map(|hit| (hit, self.accel.transmission_at(&hit)));
        }
        total.distance = 1.0 / inverse;
        total
    }

    /// What a hit point sends against `direction`.
    fn leaving(&self, hit: &Hit, direction: Vec3, solid_angle: f32) -> Seen {
        let scene = self.accel.scene();
        let (instance, triangle) = (hit.instance as usize, hit.triangle as usize);
        let cosine = -hit.normal.dot(direction);
        let side = if cosine >= 0.0 { Side::Front } else { Side::Back };
        if side == Side::Back && !scene.material_of(scene.instances[instance].mesh, triangle).double_sided {
            return Seen { radiance: Rgb::ZERO, distance: hit.t, element: None };
        }
        let own = if self.emission.is_seen(scene, instance, triangle) {
            let there = scene.alpha_at(instance, triangle, hit.barycentric);
            scene.emission_at(instance, triangle, hit.barycentric) * there
        } else {
            Rgb::ZERO
        };
        let dark = Seen { radiance: own, distance: hit.t, element: None };
        let Some(surfel) = self.surfels.at(self.atlas, instance, triangle, hit.barycentric) else { return dark };
        let surfel = match self.atlas.locate(instance, triangle, hit.barycentric) {
            Some((_, p)) => self.footprint.seen_at(surfel, p),
            None => surfel,
        };
        let Some(element) = self.hierarchy.element_of(surfel, side) else { return dark };
        let footprint = solid_angle * hit.t * hit.t / cosine.abs().max(0.05);
        // The ray stands for a patch of the surface: its mean is what the ray should bring, not one texel of it.
        let reflected = if side == Side::Back || footprint > self.areas[element as usize] {
            self.elements[element as usize]
        } else {
            Rgb::from_array(self.front[surfel as usize].map(f16::to_f32))
        };
        let shut =
            side == Side::Front && self.surfels.is_covered(surfel) && self.hierarchy.is_open(self.surfels, element);
        Seen { radiance: own + reflected, distance: hit.t, element: (!shut).then_some(element) }
    }
}
