//! Analytic form factors from a differential receiver, all dimensionless: irradiance = π · radiance · form factor.
//!
//! Based on: Lambert, "Photometria", 1760 (polygon by edge integral); Howell, "A Catalog of Radiation Heat Transfer
//! Configuration Factors" (sphere, B-45); Baum, Rushmeier, Winget, "Improving Radiosity Solutions Through the Use of
//! Analytically Determined Form-Factors", 1989 (horizon clip).

use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI};

/// Most vertices that a clipped polygon may have; callers pass at most one fewer.
pub(super) const MAX_VERTICES: usize = 34;

/// Form factor from a differential area at the origin with unit `normal` to the polygon `vertices` (relative to the
/// receiver, planar, any winding), clipped at the receiver's horizon. Exact up to rounding (about 1e-6); zero for a
/// receiver in the polygon's plane.
pub fn polygon(normal: Vec3, vertices: &[Vec3]) -> f32 {
    let mut clipped = [Vec3::ZERO; MAX_VERTICES];
    let count = clip_to_horizon(normal, vertices, &mut clipped);
    if count < 3 {
        return 0.0;
    }
    let mut sum = 0.0;
    let mut previous = clipped[count - 1].normalize_or_zero();
    for v in &clipped[..count] {
        let next = v.normalize_or_zero();
        let cross = previous.cross(next);
        let sine = cross.length();
        if sine > 1e-12 {
            // atan2 keeps full precision for edges seen at nearly 0 and nearly π.
            let angle = sine.atan2(previous.dot(next));
            sum += angle * cross.dot(normal) / sine;
        }
        previous = next;
    }
    sum.abs() * 0.5 * FRAC_1_PI
}

/// Copies the part of the polygon above the horizon to `out`, returns its vertex count.
pub(super) fn clip_to_horizon(normal: Vec3, vertices: &[Vec3], out: &mut [Vec3; MAX_VERTICES]) -> usize {
    debug_assert!(vertices.len() < MAX_VERTICES, "a clip adds one vertex");
    let mut count = 0;
    let Some(&last) = vertices.last() else { return 0 };
    let (mut a, mut ha) = (last, last.dot(normal));
    for &b in vertices {
        let hb = b.dot(normal);
        if (ha > 0.0) != (hb > 0.0) {
            out[count] = a + (b - a) * (ha / (ha - hb));
            count += 1;
        }
        if hb > 0.0 {
            out[count] = b;
            count += 1;
        }
        (a, ha) = (b, hb);
    }
    count
}

/// Form factor from a differential area with unit `normal` to a sphere of `radius` centred at `centre` (relative to
/// the receiver), with the part below the horizon left out. Exact; 1 inside the sphere.
pub fn sphere(normal: Vec3, centre: Vec3, radius: f32) -> f32 {
    let d2 = centre.length_squared();
    if d2 <= radius * radius {
        return 1.0;
    }
    let cosine = (normal.dot(centre) / d2.sqrt()).clamp(-1.0, 1.0);
    let sin2 = radius * radius / d2;
    if cosine * cosine >= sin2 {
        // Wholly above or wholly below the horizon.
        return if cosine > 0.0 { cosine * sin2 } else { 0.0 };
    }
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let x = (1.0 / sin2 - 1.0).max(0.0).sqrt();
    let y = (-x * cosine / sine.max(1e-12)).clamp(-1.0, 1.0);
    let w = (1.0 - y * y).max(0.0).sqrt();
    (FRAC_1_PI * (cosine * y.acos() - x * sine * w) * sin2 + FRAC_1_PI * (sine * w / x.max(1e-12)).atan())
        .clamp(0.0, 1.0)
}

/// Point-to-point kernel cosθ·cosθ'/(π·r²) in 1/m²: the form factor per area of source. Zero where either side
/// faces away; `two_sided` sources shine on both sides.
pub fn point_to_point(receiver: Vec3, normal: Vec3, source: Vec3, source_normal: Vec3, two_sided: bool) -> f32 {
    let v = source - receiver;
    let r2 = v.length_squared();
    let c = normal.dot(v);
    let mut cs = -source_normal.dot(v);
    if two_sided {
        cs = cs.abs();
    }
    if c <= 0.0 || cs <= 0.0 || r2 <= 0.0 { 0.0 } else { c * cs / (PI * r2 * r2) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(got: f32, want: f32) {
        assert!((got - want).abs() < 1e-5, "got {got}, want {want}");
    }

    fn square(height: f32, corner: bool) -> [Vec3; 4] {
        let o = if corner { Vec3::ZERO } else { Vec3::new(-0.5, 0.0, -0.5) };
        [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Z, Vec3::Z].map(|v| v + o + Vec3::Y * height)
    }

    #[test]
    fn point_to_unit_square() {
        check(polygon(Vec3::Y, &square(1.0, false)), 0.2394565);
        check(polygon(Vec3::Y, &square(1.0, true)), 0.1385316);
        // Receiver whose normal lies in the square's plane, at distance 1 from a corner.
        check(polygon(Vec3::X, &square(1.0, true)), 0.0557342);
    }

    #[test]
    fn parallel_and_perpendicular_squares_by_quadrature() {
        for (d, want) in [(1.0, 0.1998249), (0.5, 0.4152533), (2.0, 0.0685896)] {
            let n = 128;
            let mut sum = 0.0;
            for i in 0..n * n {
                let p = Vec3::new((i % n) as f32 + 0.5, 0.0, (i / n) as f32 + 0.5) / n as f32;
                sum += polygon(Vec3::Y, &square(d, true).map(|v| v - p)) as f64;
            }
            check((sum / (n * n) as f64) as f32, want);
        }
        // Common edge along Z: the kernel falls steeply there, so columns crowd towards it.
        let n = 256;
        let wall = [Vec3::ZERO, Vec3::Z, Vec3::Z + Vec3::Y, Vec3::Y];
        let mut sum = 0.0;
        for i in 0..n * n {
            let t = ((i % n) as f32 + 0.5) / n as f32;
            let p = Vec3::new(t * t, 0.0, ((i / n) as f32 + 0.5) / n as f32);
            sum += polygon(Vec3::Y, &wall.map(|v| v - p)) as f64 * 2.0 * t as f64;
        }
        check((sum / (n * n) as f64) as f32, 0.2000438);
    }

    #[test]
    fn closed_surroundings_sum_to_one() {
        let corners = |n: Vec3, u: Vec3, v: Vec3| [n - u - v, n + u - v, n + u + v, n - u + v];
        let normal = Vec3::new(0.3, 0.8, -0.5).normalize();
        let mut sum = 0.0;
        for (n, u, v) in [(Vec3::X, Vec3::Y, Vec3::Z), (Vec3::Y, Vec3::Z, Vec3::X), (Vec3::Z, Vec3::X, Vec3::Y)] {
            sum += polygon(normal, &corners(n, u, v)) + polygon(normal, &corners(-n, u, v));
        }
        check(sum, 1.0);
    }

    #[test]
    fn point_to_disc_and_sphere() {
        let disc: Vec<Vec3> =
            (0..32).map(|i| (i as f32 * PI / 16.0).sin_cos()).map(|(s, c)| Vec3::new(c, 1.0, s)).collect();
        assert!((polygon(Vec3::Y, &disc) - 0.5).abs() < 5e-3);
        check(sphere(Vec3::Y, Vec3::Y * 2.0, 1.0), 0.25);
        // Half below the horizon, against quadrature over the sphere's visible cap.
        let (centre, radius) = (Vec3::new(2.0, 0.3, 0.0), 1.0f32);
        let axis = centre.normalize();
        let (x, y) = crate::math::orthonormal_basis(axis);
        let cos_max = (1.0 - radius * radius / centre.length_squared()).sqrt();
        let (mut sum, n) = (0.0f64, 1000);
        for i in 0..n {
            let c = 1.0 - (1.0 - cos_max) * (i as f32 + 0.5) / n as f32;
            let s = (1.0 - c * c).sqrt();
            for j in 0..n {
                let (sp, cp) = ((j as f32 + 0.5) / n as f32 * 2.0 * PI).sin_cos();
                sum += (axis * c + (x * cp + y * sp) * s).y.max(0.0) as f64;
            }
        }
        let want = sum / (n * n) as f64 * 2.0 * (1.0 - cos_max) as f64;
        check(sphere(Vec3::Y, centre, radius), want as f32);
    }
}
