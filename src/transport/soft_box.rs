//! Form factor of a polygon that shines through a grid: an area lamp whose beam is narrower than π.
//!
//! The grid's slats leave (tan h − tan t) / (tan h − h) of the radiance at angle t to the axis, with h half the spread;
//! the power is that of the open polygon. Based on: the ratio that Blender's Cycles documents for area lights. Around
//! the receiver's foot on the polygon's plane the integral along t has a closed form; the one around the axis is left
//! to Gauss–Legendre quadrature edge by edge, as Green's theorem allows.

use super::form_factor::{MAX_VERTICES, clip_to_horizon};
use crate::math::orthonormal_basis;
use crate::scene::NARROWEST_SPREAD;
use glam::{DVec2, Vec3};
use std::f64::consts::PI;

/// Nodes and weights of Gauss–Legendre quadrature with eight points on −1..1, the positive half.
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
    (0.960_289_856_497_536_2, 0.101_228_536_290_376_3),
];

/// Form factor from a differential area at the origin with unit `normal` to the convex polygon `vertices` (relative to
/// the receiver, any winding) that shines along unit `axis` with full angle `spread` in radians, below π. Clipped at
/// the receiver's horizon; zero behind the polygon and outside its beam. Within 1e-4 of the exact value.
pub fn polygon(normal: Vec3, vertices: &[Vec3], axis: Vec3, spread: f32) -> f32 {
    let height = -axis.dot(vertices[0]) as f64;
    if height <= 0.0 {
        return 0.0;
    }
    let grid = Grid::new(spread);
    let mut clipped = [Vec3::ZERO; MAX_VERTICES];
    let count = clip_to_horizon(normal, vertices, &mut clipped);
    if count < 3 {
        return 0.0;
    }
    // Coordinates in the polygon's plane, around the receiver's foot, in heights: lengths are tangents of t.
    let (x, y) = orthonormal_basis(-axis);
    let flat = |v: Vec3| DVec2::new(v.dot(x) as f64, v.dot(y) as f64) / height;
    let mut plane = [DVec2::ZERO; MAX_VERTICES];
    for (p, v) in plane.iter_mut().zip(&clipped[..count]) {
        *p = flat(*v);
    }
    let outline = &plane[..count];
    if is_beyond(outline, grid.tangent) {
        return 0.0;
    }
    let receiver =
        Receiver { up: -normal.dot(axis) as f64, across: DVec2::new(normal.dot(x) as f64, normal.dot(y) as f64) };
    let mut sum = 0.0;
    let mut previous = outline[count - 1];
    for &next in outline {
        sum += edge(&grid, &receiver, previous, next);
        previous = next;
    }
    (sum.abs() / PI) as f32
}

/// The grid in front of the lamp.
struct Grid {
    /// tan h.
    tangent: f64,
    /// 1 / (tan h − h).
    scale: f64,
}

impl Grid {
    fn new(spread: f32) -> Self {
        let half = 0.5 * (spread as f64).max(NARROWEST_SPREAD);
        let tangent = half.tan();
        Self { tangent, scale: 1.0 / (tangent - half) }
    }

    /// Integrals from 0 to t of (tan h − tan t)·sin t times cos t and times sin t; `tangent` is tan t.
    fn integrals(&self, tangent: f64) -> [f64; 2] {
        let square = tangent * tangent / (1.0 + tangent * tangent);
        let lens = 0.5 * (tangent.atan() - tangent / (1.0 + tangent * tangent));
        let shadow = 0.5 * ((tangent * tangent).ln_1p() - square);
        [self.scale * (0.5 * self.tangent * square - lens), self.scale * (self.tangent * lens - shadow)]
    }
}

/// The receiver's normal: its parts along the direction to the polygon's plane and within the plane.
struct Receiver {
    up: f64,
    across: DVec2,
}

/// Integral over the part of the beam inside the triangle of the foot and one edge, negative if it winds clockwise.
fn edge(grid: &Grid, receiver: &Receiver, from: DVec2, to: DVec2) -> f64 {
    let winding = from.perp_dot(to);
    let Some(along) = (to - from).try_normalize() else { return 0.0 };
    let nearest = from - along * from.dot(along);
    let distance = nearest.length();
    if distance <= 0.0 || winding == 0.0 {
        return 0.0;
    }
    let out = nearest / distance;
    let angles = [from.dot(along).atan2(distance), to.dot(along).atan2(distance)];
    // Beyond this angle from the edge's nearest point the beam ends before the edge.
    let limit = (distance / grid.tangent).min(1.0).acos();
    let (left, right) = (receiver.across.dot(out), receiver.across.dot(along));

    let [up, across] = grid.integrals(grid.tangent);
    let whole = |a: f64, b: f64| {
        up * receiver.up * (b - a) + across * (left * (b.sin() - a.sin()) - right * (b.cos() - a.cos()))
    };
    // With sinh w the tangent of the angle, the integrand has no spike where the edge passes close by the foot.
    let piece = |a: f64, b: f64| {
        let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
        let at = |w: f64| {
            let cosine = 1.0 / w.cosh();
            let [up, across] = grid.integrals(distance / cosine);
            cosine * (up * receiver.up + across * (left * cosine + right * w.tanh()))
        };
        half * GAUSS.iter().map(|(x, w)| w * (at(middle - half * x) + at(middle + half * x))).sum::<f64>()
    };
    let cut = |a: f64, b: f64| {
        let (a, b) = (a.tan().asinh(), b.tan().asinh());
        if a < 0.0 && b > 0.0 { piece(a, 0.0) + piece(0.0, b) } else { piece(a, b) }
    };
    let clamp = |angle: f64| angle.clamp(-limit, limit);
    let [a, b] = angles;
    let mut sum = 0.0;
    if a < -limit {
        sum += whole(a, b.min(-limit));
    }
    if clamp(b) > clamp(a) {
        sum += cut(clamp(a), clamp(b));
    }
    if b > limit {
        sum += whole(a.max(limit), b);
    }
    sum * winding.signum()
}

/// True if the convex outline lies wholly outside the circle of `radius` around the origin.
fn is_beyond(outline: &[DVec2], radius: f64) -> bool {
    let (mut left, mut right) = (false, false);
    let mut nearest = f64::INFINITY;
    let mut a = outline[outline.len() - 1];
    for &b in outline {
        let turn = a.perp_dot(b);
        left |= turn > 0.0;
        right |= turn < 0.0;
        let v = b - a;
        let t = (-a.dot(v) / v.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        nearest = nearest.min((a + v * t).length());
        a = b;
    }
    left && right && nearest >= radius
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::spread_attenuation;

    /// Midpoint rule over a rectangle, `half` sides around `centre` in the plane z = 1 that shines down.
    fn by_brute_force(normal: Vec3, centre: [f64; 2], half: [f64; 2], spread: f32) -> f64 {
        let n = 1500;
        let cell = 4.0 * half[0] * half[1] / (n * n) as f64;
        let mut sum = 0.0;
        for i in 0..n * n {
            let at = |k: usize, i: usize| centre[k] + half[k] * (2.0 * (i as f64 + 0.5) / n as f64 - 1.0);
            let (x, y) = (at(0, i % n), at(1, i / n));
            let d2 = x * x + y * y + 1.0;
            let cosine = 1.0 / d2.sqrt();
            let receiver = (normal.x as f64 * x + normal.y as f64 * y + normal.z as f64) * cosine;
            sum += receiver.max(0.0) * cosine / d2 * cell * spread_attenuation(cosine as f32, spread) as f64;
        }
        sum / PI
    }

    fn check(normal: Vec3, centre: [f64; 2], half: [f64; 2], spread: f32) {
        let corner =
            |x: f64, y: f64| Vec3::new((centre[0] + x * half[0]) as f32, (centre[1] + y * half[1]) as f32, 1.0);
        let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        let got = polygon(normal, &corners, Vec3::NEG_Z, spread) as f64;
        let want = by_brute_force(normal, centre, half, spread);
        assert!((got - want).abs() < 4e-4 * want + 1e-6, "{normal} {centre:?} {half:?} {spread}: {got} not {want}");
    }

    #[test]
    fn agrees_with_brute_force() {
        let up = Vec3::Z;
        let tilted = Vec3::new(0.6, 0.3, 0.5).normalize();
        let averted = Vec3::new(0.9, 0.1, -0.3).normalize();
        for spread in [0.4, 1.2, 2.4, 3.1] {
            for normal in [up, tilted, averted] {
                check(normal, [0.0, 0.0], [0.5, 0.25], spread);
                check(normal, [0.4, 0.1], [0.5, 0.25], spread);
                check(normal, [0.7, -0.3], [0.5, 0.4], spread);
                check(normal, [0.17, 0.105], [0.2, 0.1], spread);
                check(normal, [0.15, 0.05], [0.01, 0.01], spread);
            }
        }
    }

    #[test]
    fn inside_the_beam_of_a_wide_lamp_all_light_arrives() {
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| Vec3::new(x, y, 1.0));
        for spread in [0.0, 1e-3, 0.1, 1.0, 1.5] {
            let got = polygon(Vec3::Z, &corners, Vec3::NEG_Z, spread);
            assert!((got - 1.0).abs() < 1e-4, "spread {spread}: {got}");
        }
        let outside = corners.map(|c| c + Vec3::X * 1.2);
        assert_eq!(polygon(Vec3::Z, &outside, Vec3::NEG_Z, 0.3), 0.0);
        assert_eq!(polygon(Vec3::Z, &corners.map(|c| -c), Vec3::NEG_Z, 0.3), 0.0);
    }
}
