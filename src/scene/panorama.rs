//! Radiance in all directions as a latitude-longitude picture, and the geometry of its pixels.
//!
//! The centre of the picture looks along +X, its right half from there to +Z, its top row up (+Y): the layout that
//! Blender writes, in the frame of glTF.

use super::Rgb;
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::PI;

/// A latitude-longitude picture, W/(m²·sr), row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct Panorama {
    /// Pixels around.
    pub width: usize,
    /// Pixels from zenith to nadir.
    pub height: usize,
    /// `width × height` radiances.
    pub pixels: Vec<Rgb>,
}

/// Part of the sphere between two meridians and two parallels: a pixel, or a block of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Azimuth from −X towards −Z, radians, of its left side.
    pub azimuth: f64,
    /// Its width, radians.
    pub turn: f64,
    /// Sine of the elevation of its lower and its upper side.
    pub heights: [f64; 2],
}

impl Cell {
    /// Block (x, y) of a picture that has `columns` × `rows` blocks.
    pub fn new(x: usize, y: usize, columns: usize, rows: usize) -> Self {
        let height = |row: usize| (PI * row as f64 / rows as f64).cos();
        let turn = 2.0 * PI / columns as f64;
        Self { azimuth: x as f64 * turn, turn, heights: [height(y + 1), height(y)] }
    }

    /// Solid angle, sr.
    pub fn solid_angle(&self) -> f64 {
        self.turn * (self.heights[1] - self.heights[0])
    }

    /// A direction in it, from the unit square; uniform in solid angle.
    pub fn direction(&self, u: Vec2) -> Vec3 {
        let azimuth = self.azimuth + self.turn * u.x as f64;
        let height = self.heights[0] + (self.heights[1] - self.heights[0]) * u.y as f64;
        let across = (1.0 - height * height).max(0.0).sqrt();
        // Column 0 begins behind the centre, at −X.
        DVec3::new(-azimuth.cos() * across, height, -azimuth.sin() * across).as_vec3()
    }

    /// Integral of the direction over it, sr: irradiance per radiance on a surface that sees all of it.
    pub fn moment(&self) -> DVec3 {
        let [low, high] = self.heights;
        // ∫ √(1 − h²) dh.
        let across = |h: f64| 0.5 * (h * (1.0 - h * h).max(0.0).sqrt() + h.clamp(-1.0, 1.0).asin());
        let wide = across(high) - across(low);
        let (a, b) = (self.azimuth, self.azimuth + self.turn);
        DVec3::new(-wide * (b.sin() - a.sin()), 0.5 * self.turn * (high * high - low * low), wide * (b.cos() - a.cos()))
    }
}

/// Where a unit direction lies in a picture, 0..=1 from the left and from the top.
pub(super) fn position(d: Vec3) -> Vec2 {
    let around = 0.5 + d.z.atan2(d.x) * (0.5 * std::f32::consts::FRAC_1_PI);
    // Near the poles asin of the height would lose digits.
    let down = d.x.hypot(d.z).atan2(d.y) * std::f32::consts::FRAC_1_PI;
    Vec2::new(around, down)
}

impl Panorama {
    /// Half as wide and high, every pixel the mean of four by solid angle. Width and height must be even.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            let weight = |row: usize| Cell::new(0, row, self.width, self.height).solid_angle();
            let upper = (weight(2 * y) / (weight(2 * y) + weight(2 * y + 1))) as f32;
            for x in 0..width {
                let at = |dx: usize, dy: usize| self.pixels[(2 * y + dy) * self.width + 2 * x + dx];
                pixels.push((at(0, 0) + at(1, 0)) * (0.5 * upper) + (at(0, 1) + at(1, 1)) * (0.5 * (1.0 - upper)));
            }
        }
        Self { width, height, pixels }
    }

    /// True if [`Panorama::halved`] can be called.
    pub fn is_even(&self) -> bool {
        self.width.is_multiple_of(2) && self.height.is_multiple_of(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_and_positions_agree() {
        let (columns, rows) = (16, 8);
        for (x, y) in [(0, 0), (3, 2), (8, 4), (15, 7)] {
            let d = Cell::new(x, y, columns, rows).direction(Vec2::splat(0.5));
            let p = position(d) * Vec2::new(columns as f32, rows as f32);
            assert_eq!((p.x as usize, p.y as usize), (x, y), "{d}");
        }
        // The centre looks along +X, the right half of the middle to +Z.
        assert!(position(Vec3::X).distance(Vec2::splat(0.5)) < 1e-6);
        assert!(position(Vec3::Z).distance(Vec2::new(0.75, 0.5)) < 1e-6);
        assert!(position(Vec3::Y).y < 1e-6);
    }

    #[test]
    fn moments_are_what_directions_sum_to() {
        let cell = Cell::new(5, 1, 16, 8);
        let n = 200;
        let points = (0..n * n).map(|i| Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32);
        let sum: DVec3 = points.map(|u| cell.direction(u).as_dvec3()).sum::<DVec3>() / (n * n) as f64;
        assert!((sum * cell.solid_angle()).distance(cell.moment()) < 1e-5);
        let all: f64 = (0..8).map(|y| 16.0 * Cell::new(0, y, 16, 8).solid_angle()).sum();
        assert!((all - 4.0 * PI).abs() < 1e-9);
    }
}
