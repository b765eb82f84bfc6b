//! A lamp as the receiver sees it: unoccluded irradiance in closed form, and points to test visibility to.

use crate::math::{orthonormal_basis, uniform_disk};
use crate::scene::{Falloff, Light, LightShape, Rgb, spot_attenuation};
use crate::transport::form_factor;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Corners of the polygon that stands for a disk.
const DISK_CORNERS: usize = 32;
/// Sine of the angle to a source's plane below which it is seen edge-on, that is, not at all.
const COPLANAR: f32 = 1e-5;

/// A direction to test, and what arrives from there if nothing blocks it.
#[derive(Clone, Copy, Debug)]
pub struct LampSample {
    /// Unit direction from the receiver.
    pub direction: Vec3,
    /// Distance to the lamp's surface; infinite for a sun.
    pub distance: f32,
    /// Relative irradiance carried by the sample.
    pub weight: Rgb,
}

/// A source that is small or bright enough to be sent to every receiver.
#[derive(Clone, Debug)]
pub struct Lamp {
    /// Shape and strength.
    pub shape: Shape,
    /// False: its light passes through everything.
    pub casts_shadows: bool,
}

/// Shapes with closed-form irradiance.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Flat, one-sided, Lambertian.
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
    },
    /// A sphere or, with radius zero, a point.
    Sphere {
        /// Centre.
        centre: Vec3,
        /// Radius, metres.
        radius: f32,
        /// W/sr (on the axis, if it has a beam).
        intensity: Rgb,
        /// Beam of a spot.
        beam: Option<Beam>,
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
    /// Emissive triangles.
    Triangles {
        /// The triangles.
        triangles: Vec<EmitterTriangle>,
        /// Centre of a sphere around them.
        centre: Vec3,
        /// Its radius.
        radius: f32,
    },
}

/// A triangle of an emissive surface.
#[derive(Clone, Copy, Debug)]
pub struct EmitterTriangle {
    /// World-space corners, counter-clockwise from the front.
    pub corners: [Vec3; 3],
    /// Unit normal of the front.
    pub normal: Vec3,
    /// Mean radiance, W/(m²·sr).
    pub radiance: Rgb,
    /// Area, m².
    pub area: f32,
    /// True if the back emits too.
    pub two_sided: bool,
    /// Share of the group's power up to and with this triangle.
    pub cumulative: f32,
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

impl Beam {
    /// Relative intensity towards unit direction `d` (from the lamp).
    fn attenuation(&self, d: Vec3) -> f32 {
        spot_attenuation(self.axis.dot(d), self.outer, self.blend, self.falloff)
    }
}

impl Lamp {
    /// The lamp of the scene's contract.
    pub fn new(light: &Light) -> Self {
        let [x, y, z] = light.axes;
        let shape = match light.shape {
            LightShape::Rect { radiance, size, .. } => {
                let half = [x * (size[0] * 0.5), y * (size[1] * 0.5)];
                let c = light.position;
                let corners =
                    vec![c - half[0] - half[1], c + half[0] - half[1], c + half[0] + half[1], c - half[0] + half[1]];
                Shape::Polygon { corners, centre: c, half, normal: -z, round: false, radiance }
            }
            LightShape::Disk { radiance, size, .. } => {
                let half = [x * (size[0] * 0.5), y * (size[1] * 0.5)];
                // A regular polygon of the same area as the disk.
                let step = 2.0 * PI / DISK_CORNERS as f32;
                let grow = (step / step.sin()).sqrt();
                let corner = |i: usize| (i as f32 * step).sin_cos();
                let corners = (0..DISK_CORNERS)
                    .map(corner)
                    .map(|(s, c)| light.position + (half[0] * c + half[1] * s) * grow)
                    .collect();
                Shape::Polygon { corners, centre: light.position, half, normal: -z, round: true, radiance }
            }
            LightShape::Point { intensity, radius } => {
                Shape::Sphere { centre: light.position, radius, intensity, beam: None }
            }
            LightShape::Spot { intensity, radius, outer_cone_angle, blend, falloff } => {
                let beam = Beam { axis: -z, outer: outer_cone_angle, blend, falloff };
                Shape::Sphere { centre: light.position, radius, intensity, beam: Some(beam) }
            }
            LightShape::Sun { irradiance, angle } => Shape::Sun { direction: z, sine: (angle * 0.5).sin(), irradiance },
        };
        Self { shape, casts_shadows: light.casts_shadows }
    }

    /// A lower bound of the distance from `p` to the lamp, metres.
    pub fn distance(&self, p: Vec3) -> f32 {
        match &self.shape {
            Shape::Polygon { centre, half, .. } => p.distance(*centre) - half[0].length().hypot(half[1].length()),
            Shape::Sphere { centre, radius, .. } => p.distance(*centre) - radius,
            Shape::Sun { .. } => f32::INFINITY,
            Shape::Triangles { centre, radius, .. } => p.distance(*centre) - radius,
        }
    }

    /// Irradiance at a point with unit normal `n` if nothing blocks, W/m².
    pub fn unoccluded(&self, p: Vec3, n: Vec3) -> Rgb {
        match &self.shape {
            Shape::Polygon { corners, centre, normal, radiance, .. } => {
                if (p - centre).dot(*normal) <= 0.0 {
                    return Rgb::ZERO;
                }
                let mut relative = [Vec3::ZERO; DISK_CORNERS];
                for (r, c) in relative.iter_mut().zip(corners) {
                    *r = *c - p;
                }
                *radiance * (PI * form_factor::polygon(n, &relative[..corners.len()]))
            }
            Shape::Sphere { centre, radius, intensity, beam } => {
                let v = *centre - p;
                let d2 = v.length_squared().max(1e-12);
                let toward = v / d2.sqrt();
                let falloff = beam.map_or(1.0, |b| b.attenuation(-toward));
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
            Shape::Triangles { triangles, .. } => triangles.iter().map(|t| t.unoccluded(p, n)).sum(),
        }
    }

    /// A point of the lamp as seen from `p`, from `u` in the unit square; none if it cannot light a surface with unit
    /// normal `n` from there.
    pub fn sample(&self, p: Vec3, n: Vec3, u: Vec2) -> Option<LampSample> {
        let sample = match &self.shape {
            Shape::Polygon { centre, half, normal, round, radiance, .. } => {
                let s = if *round { uniform_disk(u) } else { u * 2.0 - Vec2::ONE };
                let v = *centre + half[0] * s.x + half[1] * s.y - p;
                area_sample(v, *normal, false, *radiance)?
            }
            Shape::Sphere { centre, radius, intensity, beam } => {
                let v = *centre - p;
                let d = v.length().max(1e-6);
                let axis = v / d;
                let weight = *intensity * beam.map_or(1.0, |b| b.attenuation(-axis));
                let sine = (radius / d).min(1.0);
                LampSample { direction: cap_direction(axis, sine, u), distance: (d - radius).max(0.0), weight }
            }
            Shape::Sun { direction, sine, irradiance } => {
                let direction = cap_direction(*direction, *sine, u);
                LampSample { direction, distance: f32::INFINITY, weight: *irradiance }
            }
            Shape::Triangles { triangles, .. } => {
                let i = triangles.partition_point(|t| t.cumulative <= u.x).min(triangles.len() - 1);
                let t = &triangles[i];
                let below = if i == 0 { 0.0 } else { triangles[i - 1].cumulative };
                let stretched = ((u.x - below) / (t.cumulative - below).max(1e-12)).clamp(0.0, 1.0);
                let (r, s) = (stretched.sqrt(), u.y);
                let [a, b, c] = t.corners;
                let v = a + (b - a) * (r * (1.0 - s)) + (c - a) * (r * s) - p;
                // Triangles are drawn by power, so only hue is left of the radiance.
                let hue = t.radiance / t.radiance.max_element().max(f32::MIN_POSITIVE);
                area_sample(v, t.normal, t.two_sided, hue)?
            }
        };
        let cosine = n.dot(sample.direction);
        (cosine > 0.0).then_some(LampSample { weight: sample.weight * cosine, ..sample })
    }
}

/// Direction inside the cone with the given sine around `axis`, uniform in solid angle for narrow cones.
fn cap_direction(axis: Vec3, sine: f32, u: Vec2) -> Vec3 {
    let d = uniform_disk(u) * sine;
    let (x, y) = orthonormal_basis(axis);
    x * d.x + y * d.y + axis * (1.0 - d.length_squared()).max(0.0).sqrt()
}

/// Sample of a surface at offset `v` with unit `normal`; weight without the receiver's cosine.
fn area_sample(v: Vec3, normal: Vec3, two_sided: bool, radiance: Rgb) -> Option<LampSample> {
    let d2 = v.length_squared();
    let distance = d2.sqrt();
    let direction = v / distance;
    let mut cosine = -normal.dot(direction);
    if two_sided {
        cosine = cosine.abs();
    }
    (cosine > 0.0 && d2 > 0.0).then(|| LampSample { direction, distance, weight: radiance * (cosine / d2) })
}

impl EmitterTriangle {
    fn unoccluded(&self, p: Vec3, n: Vec3) -> Rgb {
        let corners = self.corners.map(|c| c - p);
        let v = (corners[0] + corners[1] + corners[2]) / 3.0;
        let facing = -self.normal.dot(v);
        let d2 = v.length_squared();
        // In the triangle's own plane rounding would decide whether it fills the horizon or nothing.
        if facing * facing <= COPLANAR * COPLANAR * (d2 + self.area) || (!self.two_sided && facing <= 0.0) {
            return Rgb::ZERO;
        }
        // Far tier: within 0.1 % of the polygon once the triangle is small against its distance.
        if d2 > 150.0 * self.area && d2 > 0.0 {
            let cosine = n.dot(v).max(0.0);
            return self.radiance * (self.area * cosine * facing.abs() / (d2 * d2));
        }
        self.radiance * (PI * form_factor::polygon(n, &corners))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamp(shape: LightShape) -> Lamp {
        Lamp::new(&Light {
            name: String::new(),
            path: String::new(),
            group: None,
            casts_shadows: true,
            position: Vec3::Y * 2.0,
            // Shines straight down.
            axes: [Vec3::X, Vec3::NEG_Z, Vec3::Y],
            shape,
        })
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
        let mean = (0..4096).filter_map(|i| l.sample(p, n, s.first(i))).map(|s| s.weight.x).sum::<f32>() / 4096.0;
        assert!((mean * 2.0 / l.unoccluded(p, n).x - 1.0).abs() < 2e-3);
    }
}
