//! All that lights the scene, as one set to draw from: lamps, emissive surfaces, bright regions of the sky.
//!
//! A light is drawn by what it would about bring to the place if nothing blocked it.

use super::emitters::{Emitter, Place, collect};
use super::mean_channel;
use super::shapes::{self, Crossing, Found};
use crate::accel::Hit;
use crate::math::Distribution;
use crate::scene::{BrightCell, Environment, Light, LightShape, Scene};
use glam::{Quat, Vec2, Vec3};
use std::collections::HashMap;
use std::f32::consts::PI;

/// Everything that lights a scene, but for the rest of its sky, which rays meet.
pub(super) struct Lamps<'a> {
    scene: &'a Scene,
    lights: Vec<Lit<'a>>,
    places: HashMap<(u32, u32), Place>,
    /// Index of the first emitter among `lights`.
    first_emitter: usize,
}

/// One light.
enum Lit<'a> {
    Lamp(&'a Light, Reach),
    Emitter(Emitter),
    Sky(BrightSky<'a>),
}

/// What is known of a lamp from afar.
struct Reach {
    /// Metres, or the angular radius of a sun.
    radius: f32,
    /// Of an area lamp: the direction in which it shines.
    axis: Option<Vec3>,
    /// Mean of channels: W/sr on the axis, or W/m² of a sun.
    strength: f32,
    is_far: bool,
}

/// The bright cells of a sky's picture.
struct BrightSky<'a> {
    cells: Vec<(&'a BrightCell, Quat)>,
    /// Draws them by power: radiance × solid angle, mean of channels.
    draw: Distribution,
}

/// A light that was drawn, with what was found of it.
pub(super) struct Drawn {
    pub(super) found: Found,
    /// Chance of the light.
    pub(super) chance: f32,
    pub(super) casts_shadows: bool,
}

/// A receiving point and what all lights together would about bring to it.
#[derive(Clone, Copy)]
pub(super) struct Receiver {
    pub(super) position: Vec3,
    pub(super) normal: Vec3,
    total: f32,
}

impl<'a> Lamps<'a> {
    pub(super) fn new(scene: &'a Scene) -> Self {
        let mut lights: Vec<Lit> = scene.lights.iter().map(|light| Lit::Lamp(light, Reach::new(light))).collect();
        lights.extend(BrightSky::new(&scene.environment).map(Lit::Sky));
        let first_emitter = lights.len();
        let (emitters, places) = collect(scene);
        lights.extend(emitters.into_iter().map(Lit::Emitter));
        Self { scene, lights, places, first_emitter }
    }

    /// Looks at all lights from a place with unit `normal`.
    pub(super) fn receiver(&self, position: Vec3, normal: Vec3) -> Receiver {
        let total = self.lights.iter().map(|light| light.estimate(position, normal)).sum();
        Receiver { position, normal, total }
    }

    /// Draws one of the lights by `which`, and a point of it by `u`.
    pub(super) fn draw(&self, receiver: &Receiver, which: f32, u: Vec2) -> Option<Drawn> {
        let Receiver { position, normal, total } = *receiver;
        let (mut left, mut drawn) = (which * total, None);
        for light in &self.lights {
            let estimate = light.estimate(position, normal);
            if estimate > 0.0 {
                // Rounding must not lose the last.
                drawn = Some((light, estimate));
                if left < estimate {
                    break;
                }
                left -= estimate;
            }
        }
        let (light, estimate) = drawn?;
        let (found, casts_shadows) = match light {
            Lit::Lamp(light, _) => (shapes::sample(light, position, u)?, light.casts_shadows),
            Lit::Emitter(emitter) => (emitter.sample(self.scene, position, u)?, true),
            Lit::Sky(sky) => (sky.sample(u), true),
        };
        Some(Drawn { found, chance: estimate / total, casts_shadows })
    }

    /// Calls `visit` for every lamp that a ray from the receiver crosses, with its density among all draws.
    pub(super) fn crossings(&self, receiver: &Receiver, direction: Vec3, mut visit: impl FnMut(&Light, Crossing)) {
        for lit in &self.lights {
            let Lit::Lamp(light, _) = lit else { continue };
            if let Some(crossing) = shapes::crossing(light, receiver.position, direction) {
                visit(light, Crossing { density: crossing.density * self.chance(receiver, lit), ..crossing });
            }
        }
    }

    /// Density among all draws, 1/sr, of a hit on a surface; zero if it is none that is drawn.
    pub(super) fn density_at(&self, receiver: &Receiver, hit: &Hit, facing: f32) -> f32 {
        let Some(&place) = self.places.get(&(hit.instance, hit.triangle)) else { return 0.0 };
        let lit = &self.lights[self.first_emitter + place.emitter];
        let Lit::Emitter(emitter) = lit else { return 0.0 };
        emitter.density_at(place, hit.t, facing) * self.chance(receiver, lit)
    }

    /// Chance of a light at a receiver.
    fn chance(&self, receiver: &Receiver, light: &Lit) -> f32 {
        let estimate = light.estimate(receiver.position, receiver.normal);
        if estimate > 0.0 { estimate / receiver.total } else { 0.0 }
    }
}

impl Lit<'_> {
    /// Roughly the irradiance at `p` with unit `normal` if nothing blocks, mean of channels; zero only if none can arrive.
    fn estimate(&self, p: Vec3, normal: Vec3) -> f32 {
        match self {
            Lit::Lamp(light, reach) if reach.is_far => {
                reach.strength * (normal.dot(light.axes[2]) + reach.radius).clamp(0.0, 1.0)
            }
            Lit::Lamp(light, reach) => near(light.position, reach.radius, reach.axis, reach.strength, p, normal),
            Lit::Emitter(e) => near(e.centre, e.radius, None, e.power as f32, p, normal),
            Lit::Sky(sky) => sky.draw.total() as f32,
        }
    }
}

/// Roughly the irradiance from a light of `strength` W/sr within a sphere.
fn near(centre: Vec3, radius: f32, axis: Option<Vec3>, strength: f32, p: Vec3, normal: Vec3) -> f32 {
    let v = centre - p;
    if v.dot(normal) <= -radius {
        return 0.0;
    }
    let d2 = v.length_squared().max(radius * radius).max(1e-8);
    // Cosines to the middle, blurred by how large the light looks, so that no part of it is left out.
    let blur = (radius * radius / d2).sqrt().max(1e-3);
    let toward = v / v.length().max(1e-6);
    let receives = (normal.dot(toward) + blur).clamp(0.0, 1.0);
    let sends = match axis {
        Some(axis) if axis.dot(-v) <= 0.0 => return 0.0,
        Some(axis) => (axis.dot(-toward) + 1e-3).clamp(0.0, 1.0),
        None => 1.0,
    };
    strength * receives * sends / d2
}

impl Reach {
    fn new(light: &Light) -> Self {
        let shines = -light.axes[2];
        let flat = |radiance, size: [f32; 2], area: f32| Self {
            radius: 0.5 * size[0].hypot(size[1]),
            axis: Some(shines),
            strength: mean_channel(radiance) as f32 * area,
            is_far: false,
        };
        let round =
            |intensity, radius| Self { radius, axis: None, strength: mean_channel(intensity) as f32, is_far: false };
        match light.shape {
            LightShape::Rect { radiance, size, .. } => flat(radiance, size, size[0] * size[1]),
            LightShape::Disk { radiance, size, .. } => flat(radiance, size, size[0] * size[1] * PI * 0.25),
            LightShape::Point { intensity, radius } | LightShape::Spot { intensity, radius, .. } => {
                round(intensity, radius)
            }
            LightShape::Sun { irradiance, angle } => Self { is_far: true, ..round(irradiance, 0.5 * angle + 1e-4) },
        }
    }
}

impl<'a> BrightSky<'a> {
    /// None if nothing in the sky is bright and small.
    fn new(environment: &'a Environment) -> Option<Self> {
        let Environment::Image(sky) = environment else { return None };
        let regions = sky.regions().iter();
        let cells: Vec<_> = regions.flat_map(|r| r.cells.iter().map(|cell| (cell, r.rotation))).collect();
        let draw = Distribution::new(cells.iter().map(|(cell, _)| cell.power()));
        (draw.total() > 0.0).then_some(Self { cells, draw })
    }

    fn sample(&self, u: Vec2) -> Found {
        let (index, within) = self.draw.draw(u.x);
        let chance = self.draw.chance(index).max(f64::MIN_POSITIVE);
        let (cell, rotation) = self.cells[index];
        let direction = rotation * cell.cell.direction(Vec2::new(within, u.y));
        let weight = cell.radiance * (cell.cell.solid_angle() / chance) as f32;
        Found { direction, distance: f32::INFINITY, weight, density: None }
    }
}
