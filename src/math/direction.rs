//! Directions and their densities.

use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Two unit vectors that complete unit `n` to a right-handed frame.
///
/// Based on: Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017.
pub fn orthonormal_basis(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// Concentric map of the unit square to the unit disk, area-preserving.
///
/// Based on: Shirley and Chiu, "A Low Distortion Map Between Disk and Square", 1997.
pub fn uniform_disk(u: Vec2) -> Vec2 {
    let p = u * 2.0 - Vec2::ONE;
    if p == Vec2::ZERO {
        return Vec2::ZERO;
    }
    let (r, phi) =
        if p.x.abs() > p.y.abs() { (p.x, PI / 4.0 * (p.y / p.x)) } else { (p.y, PI / 2.0 - PI / 4.0 * (p.x / p.y)) };
    r * Vec2::new(phi.cos(), phi.sin())
}

/// Unit direction around `normal` with density cosθ/π.
pub fn cosine_hemisphere(normal: Vec3, u: Vec2) -> Vec3 {
    let d = uniform_disk(u);
    let (x, y) = orthonormal_basis(normal);
    x * d.x + y * d.y + normal * (1.0 - d.length_squared()).max(0.0).sqrt()
}

/// Octahedral map of unit directions to the unit square.
///
/// Based on: Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014.
pub fn octahedral(direction: Vec3) -> Vec2 {
    let d = direction / (direction.x.abs() + direction.y.abs() + direction.z.abs());
    let p = if d.z >= 0.0 {
        Vec2::new(d.x, d.y)
    } else {
        Vec2::new((1.0 - d.y.abs()) * 1f32.copysign(d.x), (1.0 - d.x.abs()) * 1f32.copysign(d.y))
    };
    p * 0.5 + Vec2::splat(0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bases_are_orthonormal() {
        for n in [Vec3::X, Vec3::NEG_Z, Vec3::Y, Vec3::new(0.3, -0.5, -0.7).normalize()] {
            let (x, y) = orthonormal_basis(n);
            assert!(x.dot(y).abs() < 1e-6 && x.dot(n).abs() < 1e-6 && y.dot(n).abs() < 1e-6);
            assert!((x.cross(y) - n).length() < 1e-6);
        }
    }

    #[test]
    fn cosine_directions_have_mean_cosine_two_thirds() {
        let n = Vec3::new(0.1, 0.9, -0.4).normalize();
        let s = crate::math::Sequence::new(1);
        let mean = (0..4096).map(|i| cosine_hemisphere(n, s.first(i)).dot(n)).sum::<f32>() / 4096.0;
        assert!((mean - 2.0 / 3.0).abs() < 1e-3, "{mean}");
    }
}
