//! A lamp as the receiver sees it: unoccluded irradiance in closed form, and points to test visibility to.

use super::emitter_triangle::EmitterTriangle;
use super::near::{NearView, is_near};
use super::portal::{Portal, PortalView};
use super::region::{Region, regions};
use crate::math::{Distribution, orthonormal_basis, shifted, uniform_disk};
use crate::scene::{
    Environment, Falloff, Group, Light, LightShape, NARROWEST_SPREAD, Profile, Rgb, spot_attenuation,
    spread_attenuation,
};
use crate::transport::{form_factor, soft_box};
use glam::{Vec2, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;

/// Corners of the polygon that stands for a disk.
const DISK_CORNERS: usize = 32;
/// Times the reach of samples from which on a lamp looks about the same from all of them.
const FAR: f32 = 6.0;
/// Points that are tried until one lies in the part of an area lamp whose beam reaches the receiver.
const TRIES: u32 = 16;

/// A direction to test, and what arrives from there if nothing blocks it.
#[derive(Clone, Copy, Debug)]
pub(super) struct LampSample {
    /// Unit direction from the receiver.
    pub direction: Vec3,
    /// Distance to the lamp's surface; infinite for a sun.
    pub distance: f32,
    /// Relative irradiance carried by the sample, alike for all samples of a lamp: if that is flat, W/m² where they are
    /// averaged.
    pub weight: Rgb,
}

/// A source that is small or bright enough to be sent to every receiver.
#[derive(Clone, Debug)]
pub struct Lamp {
    /// Shape and strength.
    pub shape: Shape,
    /// False: its light passes through everything.
    pub casts_shadows: bool,
    /// Its light group.
    pub group: Group,
}

/// Shapes with closed-form irradiance.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Flat and one-sided.
    Polygon {
        /// Corners in order.
        corners: Vec<Vec3>,
        /// Centre.
        centre: Vec3,
        /// Half axes: a rectangle's half sides or an ellipse's half diameters.
        half: [Vec3; 2],
        /// Unit direction in which it shines.
        normal: Vec3,
        /// True if it is an ellipse.
        round: bool,
        /// W/(m²·sr).
        radiance: Rgb,
        /// Full angle of the beam, radians; π if it is Lambertian.
        spread: f32,
    },
    /// A sphere or, with radius zero, a point.
    Sphere {
        /// Centre.
        centre: Vec3,
        /// Radius, metres.
        radius: f32,
        /// True if it is a disk that faces every receiver.
        faces_receivers: bool,
        /// W/sr (on the axis, if it has a beam).
        intensity: Rgb,
        /// Beam of a spot.
        beam: Option<Beam>,
        /// Measured distribution.
        web: Option<Web>,
    },
    /// A disc at infinity.
    Sun {
        /// Unit direction to it.
        direction: Vec3,
        /// Sine of its angular radius.
        sine: f32,
        /// W/m² on a surface that faces it.
        irradiance: Rgb,
    },
    /// A bright region of the environment.
    Region(Region),
    /// The sky as it is seen through openings.
    Portal(Portal),
    /// Emissive triangles.
    Triangles {
        /// The triangles.
        triangles: Vec<EmitterTriangle>,
        /// Draws them by power.
        draw: Distribution,
        /// Centre of a sphere around them.
        centre: Vec3,
        /// Its radius.
        radius: f32,
    },
}

/// Angular falloff of a spot.
#[derive(Clone, Copy, Debug)]
pub struct Beam {
    /// Unit axis.
    pub axis: Vec3,
    /// Half angle, radians.
    pub outer: f32,
    /// Share of the cone that fades.
    pub blend: f32,
    /// Curve of the fade.
    pub falloff: Falloff,
}

/// A measured distribution and the frame in which it was measured.
#[derive(Clone, Debug)]
pub struct Web {
    /// Orthonormal frame of the lamp.
    pub axes: [Vec3; 3],
    /// The measurement.
    pub profile: Arc<Profile>,
}

impl Web {
    /// Relative intensity towards unit direction `d` (from the lamp).
    fn attenuation(&self, d: Vec3) -> f32 {
        self.profile.relative(Vec3::from_array(self.axes.map(|axis| axis.dot(d))))
    }
}

impl Beam {
    /// Relative intensity towards unit direction `d` (from the lamp).
    fn attenuation(&self, d: Vec3) -> f32 {
        spot_attenuation(self.axis.dot(d), self.outer, self.blend, self.falloff)
    }

    /// How far it is from offset `v` (from the lamp) to where the cone fades or, inside that zone, how wide it is.
    fn smoothness(&self, v: Vec3) -> f32 {
        let distance = v.length();
        let angle = (self.axis.dot(v) / distance.max(f32::MIN_POSITIVE)).clamp(-1.0, 1.0).acos();
        let inner = (self.outer.cos() + (1.0 - self.outer.cos()) * self.blend).min(1.0).acos();
        distance * (angle - self.outer).max(inner - angle).max(self.outer - inner)
    }
}

impl Lamp {
    /// The lamps that stand for the bright regions of the environment.
    pub fn of_environment(environment: &Environment, group: Group) -> Vec<Self> {
        let lamp = |region| Self { shape: Shape::Region(region), casts_shadows: true, group };
        regions(environment).into_iter().map(lamp).collect()
    }

    /// The lamp of the scene's contract.
    pub fn new(light: &Light, group: Group) -> Self {
        let [x, y, z] = light.axes;
        let faces_receivers = light.faces_receivers;
        let web = light.profile.clone().map(|profile| Web { axes: light.axes, profile });
        let shape = match light.shape {
            LightShape::Rect { radiance, size, spread } => {
                let half = [x * (size[0] * 0.5), y * (size[1] * 0.5)];
                let c = light.position;
                let corners =
                    vec![c - half[0] - half[1], c + half[0] - half[1], c + half[0] + half[1], c - half[0] + half[1]];
                Shape::Polygon { corners, centre: c, half, normal: -z, round: false, radiance, spread }
            }
            LightShape::Disk { radiance, size, spread } => {
                let half = [x * (size[0] * 0.5), y * (size[1] * 0.5)];
                // A regular polygon of the same area as the disk.
                let step = 2.0 * PI / DISK_CORNERS as f32;
                let grow = (step / step.sin()).sqrt();
                let corner = |i: usize| (i as f32 * step).sin_cos();
                let corners = (0..DISK_CORNERS)
                    .map(corner)
                    .map(|(s, c)| light.position + (half[0] * c + half[1] * s) * grow)
                    .collect();
                Shape::Polygon { corners, centre: light.position, half, normal: -z, round: true, radiance, spread }
            }
            LightShape::Point { intensity, radius } => {
                Shape::Sphere { centre: light.position, radius, faces_receivers, intensity, beam: None, web }
            }
            LightShape::Spot { intensity, radius, outer_cone_angle, blend, falloff } => {
                let beam = Beam { axis: -z, outer: outer_cone_angle, blend, falloff };
                Shape::Sphere { centre: light.position, radius, faces_receivers, intensity, beam: Some(beam), web }
            }
            LightShape::Sun { irradiance, angle } => Shape::Sun { direction: z, sine: (angle * 0.5).sin(), irradiance },
        };
        Self { shape, casts_shadows: light.casts_shadows, group }
    }

    /// A length in metres over which the lamp's irradiance around `p` is smooth: its distance, or less at the rim of a beam.
    pub fn distance(&self, p: Vec3) -> f32 {
        match &self.shape {
            Shape::Polygon { centre, half, normal, spread, .. } => {
                let near = p.distance(*centre) - half[0].length().hypot(half[1].length());
                // From its middle to its rim the beam fades over this length; its curvature asks for half of it.
                let rim =
                    if *spread < PI { 0.5 * (p - *centre).dot(*normal).abs() * (0.5 * spread).tan() } else { near };
                near.min(rim)
            }
            Shape::Sphere { centre, radius, beam, .. } => {
                let near = p.distance(*centre) - radius;
                beam.map_or(near, |beam| near.min(beam.smoothness(p - *centre)))
            }
            Shape::Sun { .. } | Shape::Region(_) => f32::INFINITY,
            Shape::Portal(portal) => portal.distance(p),
            Shape::Triangles { centre, radius, .. } => p.distance(*centre) - radius,
        }
    }

    /// True if it has a beam, at whose rim irradiance may end within no distance.
    pub(super) fn has_rim(&self) -> bool {
        match &self.shape {
            Shape::Polygon { spread, .. } => *spread < PI,
            Shape::Sphere { beam, .. } => beam.is_some(),
            _ => false,
        }
    }

    /// Irradiance at a point with unit normal `n` if nothing blocks, W/m².
    pub fn unoccluded(&self, p: Vec3, n: Vec3) -> Rgb {
        match &self.shape {
            Shape::Polygon { corners, centre, normal, radiance, spread, .. } => {
                if (p - centre).dot(*normal) <= 0.0 {
                    return Rgb::ZERO;
                }
                let mut relative = [Vec3::ZERO; DISK_CORNERS];
                for (r, c) in relative.iter_mut().zip(corners) {
                    *r = *c - p;
                }
                let outline = &relative[..corners.len()];
                let factor = if *spread < PI {
                    soft_box::polygon(n, outline, *normal, *spread)
                } else {
                    form_factor::polygon(n, outline)
                };
                *radiance * (PI * factor)
            }
            Shape::Sphere { centre, radius, faces_receivers, intensity, beam, web } => {
                let v = *centre - p;
                let d2 = v.length_squared().max(1e-12);
                let toward = v / d2.sqrt();
                let v = if *faces_receivers { toward * silhouette(d2, *radius) } else { v };
                let falloff = falloff(beam, web, -toward);
                let per_intensity = if *radius > 0.0 {
                    form_factor::sphere(n, v, *radius) / (radius * radius)
                } else {
                    n.dot(toward).max(0.0) / d2
                };
                *intensity * (falloff * per_intensity)
            }
            Shape::Sun { direction, sine, irradiance } => {
                if *sine > 0.0 {
                    *irradiance * (form_factor::sphere(n, *direction, *sine) / (sine * sine))
                } else {
                    *irradiance * n.dot(*direction).max(0.0)
                }
            }
            Shape::Region(region) => region.unoccluded(n),
            Shape::Portal(portal) => portal.unoccluded(p, n),
            Shape::Triangles { centre, radius, .. } if n.dot(*centre - p) <= -radius => Rgb::ZERO,
            Shape::Triangles { triangles, .. } => triangles.iter().map(|t| t.unoccluded(p, n)).sum(),
        }
    }

    /// The lamp, to be sampled from within `reach` metres of `p`, where the unit normal is about `n`.
    pub(super) fn aim(&self, p: Vec3, n: Vec3, reach: f32) -> Aim<'_> {
        let view = match &self.shape {
            Shape::Portal(portal) if portal.distance(p) > FAR * reach => View::Portal(portal.view(p)),
            shape if is_near(shape, p) => NearView::new(shape, p, n)
                .filter(|view| view.nearest > FAR * reach)
                .map_or(View::OfEachPoint, View::Near),
            _ => View::Same,
        };
        Aim { lamp: self, view }
    }

    /// A point of the lamp as seen from `p`, from `u` in the unit square, and its weight without the receiver's cosine.
    fn sample(&self, p: Vec3, u: Vec2) -> Option<LampSample> {
        Some(match &self.shape {
            Shape::Polygon { centre, half, normal, round, radiance, spread, .. } => {
                let s = if *spread < PI {
                    within_beam(*centre - p, half, *normal, *round, *spread, u)?
                } else if *round {
                    uniform_disk(u)
                } else {
                    u * 2.0 - Vec2::ONE
                };
                let v = *centre + half[0] * s.x + half[1] * s.y - p;
                let area = half[0].cross(half[1]).length() * if *round { PI } else { 4.0 };
                let sample = area_sample(v, *normal, false, *radiance * area)?;
                let beam = spread_attenuation(-normal.dot(sample.direction), *spread);
                LampSample { weight: sample.weight * beam, ..sample }
            }
            Shape::Sphere { centre, radius, faces_receivers, intensity, beam, web } => {
                let v = *centre - p;
                let d = v.length().max(1e-6);
                let axis = v / d;
                let weight = *intensity * falloff(beam, web, -axis);
                let apparent = if *faces_receivers { silhouette(d * d, *radius) } else { d };
                let sine = (radius / apparent).min(1.0);
                LampSample { direction: cap_direction(axis, sine, u), distance: (d - radius).max(0.0), weight }
            }
            Shape::Sun { direction, sine, irradiance } => {
                let direction = cap_direction(*direction, *sine, u);
                LampSample { direction, distance: f32::INFINITY, weight: *irradiance }
            }
            Shape::Region(region) => region.sample(u),
            Shape::Portal(portal) => portal.view(p).sample(p, u)?,
            Shape::Triangles { triangles, draw, .. } => {
                let (i, within) = draw.draw(u.x);
                let t = &triangles[i];
                // Triangles are drawn by power, so only hue is left of the radiance.
                let hue = t.radiance / t.radiance.max_element().max(f32::MIN_POSITIVE);
                let v = t.point(Vec2::new(within, u.y)) - p;
                area_sample(v, t.normal, t.two_sided, hue * draw.total() as f32)?
            }
        })
    }
}

/// A lamp with what one receiver's samples of it share.
pub(super) struct Aim<'a> {
    pub(super) lamp: &'a Lamp,
    view: View<'a>,
}

/// How points of a lamp are drawn.
enum View<'a> {
    /// In the same way for all receivers.
    Same,
    /// As the receiver's middle sees the sky.
    Portal(PortalView<'a>),
    /// As the receiver's middle sees the lamp.
    Near(NearView<'a>),
    /// As each point of the receiver sees the lamp.
    OfEachPoint,
}

impl Aim<'_> {
    /// A point of the lamp as seen from `p`, from `u` in the unit square; none if it cannot light a surface with unit
    /// normal `n` from there.
    pub(super) fn sample(&self, p: Vec3, n: Vec3, u: Vec2) -> Option<LampSample> {
        let sample = match &self.view {
            View::Same => self.lamp.sample(p, u)?,
            View::Portal(view) => view.sample(p, u)?,
            View::Near(view) => view.sample(p, u)?,
            View::OfEachPoint => NearView::new(&self.lamp.shape, p, n)?.sample(p, u)?,
        };
        let cosine = n.dot(sample.direction);
        (cosine > 0.0).then_some(LampSample { weight: sample.weight * cosine, ..sample })
    }
}

/// Distance from which a sphere looks as large as a facing disk of its `radius` does from the square root of `d2`.
fn silhouette(d2: f32, radius: f32) -> f32 {
    (d2 + radius * radius).sqrt()
}

/// Relative intensity of a point-like lamp towards unit direction `d` (from the lamp).
fn falloff(beam: &Option<Beam>, web: &Option<Web>, d: Vec3) -> f32 {
    beam.map_or(1.0, |b| b.attenuation(d)) * web.as_ref().map_or(1.0, |w| w.attenuation(d))
}

/// A point of an area lamp in half axes, uniform over the part from which the beam reaches the receiver; the lamp's
/// centre is at `v` from there. None if there seems to be no such part.
fn within_beam(v: Vec3, half: &[Vec3; 2], normal: Vec3, round: bool, spread: f32, u: Vec2) -> Option<Vec2> {
    let reach = -v.dot(normal) * (0.5 * spread.max(NARROWEST_SPREAD as f32)).tan();
    let sides = Vec2::new(half[0].length(), half[1].length());
    // The receiver's foot on the lamp's plane, and the box around the beam's circle there.
    let foot = Vec2::new(-v.dot(half[0]), -v.dot(half[1])) / (sides * sides);
    let (low, high) = ((foot - reach / sides).max(Vec2::NEG_ONE), (foot + reach / sides).min(Vec2::ONE));
    if reach <= 0.0 || low.cmpge(high).any() {
        return None;
    }
    (0..TRIES).map(|k| shifted(u, k)).find_map(|u| {
        let s = low + u * (high - low);
        let inside = ((s - foot) * sides).length_squared() < reach * reach && (!round || s.length_squared() < 1.0);
        inside.then_some(s)
    })
}

/// Direction inside the cone with the given sine around `axis`, uniform in solid angle for narrow cones.
fn cap_direction(axis: Vec3, sine: f32, u: Vec2) -> Vec3 {
    let d = uniform_disk(u) * sine;
    let (x, y) = orthonormal_basis(axis);
    x * d.x + y * d.y + axis * (1.0 - d.length_squared()).max(0.0).sqrt()
}

/// Sample of a surface at offset `v` with unit `normal`; weight without the receiver's cosine.
pub(super) fn area_sample(v: Vec3, normal: Vec3, two_sided: bool, radiance: Rgb) -> Option<LampSample> {
    let d2 = v.length_squared();
    let distance = d2.sqrt();
    let direction = v / distance;
    let mut cosine = -normal.dot(direction);
    if two_sided {
        cosine = cosine.abs();
    }
    (cosine > 0.0 && d2 > 0.0).then(|| LampSample { direction, distance, weight: radiance * (cosine / d2) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamp(shape: LightShape) -> Lamp {
        let light = Light {
            name: String::new(),
            path: String::new(),
            group: None,
            casts_shadows: true,
            position: Vec3::Y * 2.0,
            // Shines straight down.
            axes: [Vec3::X, Vec3::NEG_Z, Vec3::Y],
            shape,
            profile: None,
            faces_receivers: false,
        };
        Lamp::new(&light, 0)
    }

    fn below(shape: LightShape) -> f32 {
        lamp(shape).unoccluded(Vec3::ZERO, Vec3::Y).x
    }

    #[test]
    fn irradiance_below_each_lamp() {
        let one = Rgb::ONE;
        let got = below(LightShape::Rect { radiance: one, size: [2.0, 2.0], spread: PI });
        assert!((got - PI * 0.2394565).abs() < 1e-5, "{got}");
        let got = below(LightShape::Disk { radiance: one, size: [2.0, 2.0], spread: PI });
        assert!((got - PI / 5.0).abs() < 2e-3, "{got}");
        assert!((below(LightShape::Point { intensity: one, radius: 0.0 }) - 0.25).abs() < 1e-6);
        assert!((below(LightShape::Point { intensity: one, radius: 0.5 }) - 0.25).abs() < 1e-6);
        assert!((below(LightShape::Sun { irradiance: one, angle: 0.01 }) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn samples_average_to_the_closed_form() {
        let l = lamp(LightShape::Rect { radiance: Rgb::ONE, size: [2.0, 1.0], spread: PI });
        let (p, n) = (Vec3::new(0.7, 0.2, -0.4), Vec3::new(0.2, 0.9, 0.1).normalize());
        let s = crate::math::Sequence::new(7);
        let mean = (0..4096).filter_map(|i| l.aim(p, n, 0.0).sample(p, n, s.first(i))).map(|s| s.weight.x).sum::<f32>()
            / 4096.0;
        assert!((mean / l.unoccluded(p, n).x - 1.0).abs() < 2e-3);
    }

    #[test]
    fn every_point_in_the_beam_of_a_narrow_lamp_gets_samples() {
        for (size, spread) in [([2.0, 1.0], 0.8), ([2.0, 1.0], 0.05), ([0.2, 0.1], 0.0)] {
            for round in [false, true] {
                let shape = match round {
                    true => LightShape::Disk { radiance: Rgb::ONE, size, spread },
                    false => LightShape::Rect { radiance: Rgb::ONE, size, spread },
                };
                let l = lamp(shape);
                let s = crate::math::Sequence::new(3);
                for p in (0..100).map(|i| s.second(i) * 3.0 - 1.5).map(|p| Vec3::new(p.x, 0.0, p.y)) {
                    let lit = l.unoccluded(p, Vec3::Y).x > 0.02 * l.unoccluded(Vec3::ZERO, Vec3::Y).x;
                    let count =
                        (0..16).filter(|&i| l.aim(p, Vec3::Y, 0.0).sample(p, Vec3::Y, s.first(i)).is_some()).count();
                    assert!(!lit || count >= 15, "{size:?} {spread} {p}: {count} of 16 samples");
                }
            }
        }
    }
}
