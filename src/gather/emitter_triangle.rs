//! A triangle of an emissive surface: its irradiance in closed form, and points on it.

use crate::scene::Rgb;
use crate::transport::form_factor;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Sine of the angle to a source's plane below which it is seen edge-on, that is, not at all.
const COPLANAR: f32 = 1e-5;
/// Squared distance over area from which on the irradiance from a triangle is as good as that from its middle.
const FAR_TRIANGLE: f32 = 150.0;

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
}

impl EmitterTriangle {
    /// Its centroid.
    fn middle(&self) -> Vec3 {
        (self.corners[0] + self.corners[1] + self.corners[2]) / 3.0
    }

    /// True if it is small against its distance from `p`.
    pub(super) fn is_far(&self, p: Vec3) -> bool {
        p.distance_squared(self.middle()) > FAR_TRIANGLE * self.area
    }

    /// A lower bound of its distance from `p`, metres.
    pub(super) fn distance(&self, p: Vec3) -> f32 {
        let middle = self.middle();
        let radius = self.corners.iter().map(|c| c.distance_squared(middle)).fold(0.0, f32::max).sqrt();
        self.normal.dot(middle - p).abs().max(p.distance(middle) - radius)
    }

    /// A point of it from `u` in the unit square, uniform in area.
    pub(super) fn point(&self, u: Vec2) -> Vec3 {
        let (r, s) = (u.x.sqrt(), u.y);
        let [a, b, c] = self.corners;
        a + (b - a) * (r * (1.0 - s)) + (c - a) * (r * s)
    }

    /// Irradiance from it at a point with unit normal `n` if nothing blocks, W/m².
    pub(super) fn unoccluded(&self, p: Vec3, n: Vec3) -> Rgb {
        let v = self.middle() - p;
        let facing = -self.normal.dot(v);
        let d2 = v.length_squared();
        // In the triangle's own plane rounding would decide whether it fills the horizon or nothing.
        if facing * facing <= COPLANAR * COPLANAR * (d2 + self.area) || (!self.two_sided && facing <= 0.0) {
            return Rgb::ZERO;
        }
        // Far tier: within 0.1 % of the polygon once the triangle is small against its distance.
        if self.is_far(p) && d2 > 0.0 {
            let cosine = n.dot(v).max(0.0);
            return self.radiance * (self.area * cosine * facing.abs() / (d2 * d2));
        }
        self.radiance * (PI * form_factor::polygon(n, &self.corners.map(|c| c - p)))
    }
}
