//! The directions from a point to a rectangle, uniform in solid angle.
//!
//! Based on: Ureña, Fajardo, King, "An Area-Preserving Parametrization for Spherical Rectangles", 2013.

use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

/// Solid angle, sr, below which differences of angles are lost in rounding: the rectangle is then far away and flat.
const SMALL: f32 = 1e-2;

/// A rectangle as seen from the origin of its frame: it spans x and y at depth `depth` > 0 along z.
#[derive(Clone, Copy, Debug)]
pub struct SphericalRect {
    low: Vec2,
    high: Vec2,
    depth: f32,
    /// Sr.
    solid_angle: f32,
    /// Terms of the parametrisation: z of the normals of the two sides along x, and the angle that the area starts from.
    sides: [f32; 2],
    start: f32,
}

impl SphericalRect {
    /// The rectangle from `low` to `high` at `depth`.
    pub fn new(low: Vec2, high: Vec2, depth: f32) -> Self {
        let size = high - low;
        let middle = (0.5 * (low + high)).extend(depth);
        let flat = size.x * size.y * depth / middle.length().powi(3);
        let mut rect = Self { low, high, depth, solid_angle: flat, sides: [0.0; 2], start: 0.0 };
        if flat < SMALL {
            return rect;
        }
        // Depth counts downwards, as in the paper.
        let corner = |x: f32, y: f32| Vec3::new(x, y, -depth);
        let v = [corner(low.x, low.y), corner(high.x, low.y), corner(high.x, high.y), corner(low.x, high.y)];
        let n: [Vec3; 4] = std::array::from_fn(|i| v[i].cross(v[(i + 1) % 4]).normalize_or_zero());
        let angle = |i: usize| (-n[i].dot(n[(i + 1) % 4])).clamp(-1.0, 1.0).acos();
        rect.sides = [n[0].z, n[2].z];
        rect.start = TAU - angle(2) - angle(3);
        rect.solid_angle = (angle(0) + angle(1) - rect.start).max(0.0);
        rect
    }

    /// Sr.
    pub fn solid_angle(&self) -> f32 {
        self.solid_angle
    }

    /// A point of the rectangle from `u` in the unit square, and the density of its direction times the solid angle
    /// (one but for rectangles that are small and far).
    pub fn sample(&self, u: Vec2) -> (Vec3, f32) {
        if self.solid_angle < SMALL {
            let p = (self.low + u * (self.high - self.low)).extend(self.depth);
            let size = self.high - self.low;
            let flat = size.x * size.y * self.depth / p.length().powi(3);
            return (p, self.solid_angle / flat.max(f32::MIN_POSITIVE));
        }
        let (z0, [b0, b1]) = (-self.depth, self.sides);
        let (sine, cosine) = (u.x * self.solid_angle + self.start).sin_cos();
        let f = (cosine * b0 - b1) / sine;
        let c = (f.signum() / (f * f + b0 * b0).sqrt()).clamp(-1.0, 1.0);
        let x = (-(c * z0) / (1.0 - c * c).max(1e-12).sqrt()).clamp(self.low.x, self.high.x);
        let d = x.hypot(z0);
        let height = |y: f32| y / d.hypot(y);
        let h = height(self.low.y) + u.y * (height(self.high.y) - height(self.low.y));
        let y = (h * d / (1.0 - h * h).max(1e-12).sqrt()).clamp(self.low.y, self.high.y);
        (Vec3::new(x, y, self.depth), 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Sequence;

    #[test]
    fn a_face_of_a_cube_fills_a_sixth_of_the_sphere() {
        let rect = SphericalRect::new(Vec2::NEG_ONE, Vec2::ONE, 1.0);
        assert!((rect.solid_angle() - TAU / 3.0).abs() < 1e-5, "{}", rect.solid_angle());
    }

    #[test]
    fn samples_are_uniform_in_solid_angle() {
        for (low, high, depth) in [
            (Vec2::new(-0.3, 0.2), Vec2::new(2.0, 1.7), 0.4),
            (Vec2::new(1.0, -2.0), Vec2::new(3.0, -1.0), 1.0),
            (Vec2::new(4.0, 4.0), Vec2::new(4.5, 4.2), 7.0),
        ] {
            let rect = SphericalRect::new(low, high, depth);
            let sequence = Sequence::new(5);
            let count = 1 << 14;
            // The part in the half with the smaller x, against that half's own solid angle.
            let middle = 0.5 * (low.x + high.x);
            let inside = |i: &u32| rect.sample(sequence.first(*i)).0.x < middle;
            let weight = |i: u32| 1.0 / rect.sample(sequence.first(i)).1;
            let share = (0..count).filter(inside).map(weight).sum::<f32>() / (0..count).map(weight).sum::<f32>();
            let half = SphericalRect::new(low, Vec2::new(middle, high.y), depth);
            assert!((share - half.solid_angle() / rect.solid_angle()).abs() < 3e-3, "{share}");
        }
    }
}
