//! Interpolation between the probes of a cell: corners and page positions → weights.

use super::{Rect, State};
use glam::{Vec2, Vec3};

/// Interpolation from four corners that reproduces linear functions of the page position.
pub(super) enum Blend {
    /// Probes sit at the corners of the rectangle.
    Bilinear { origin: Vec2, scale: Vec2 },
    /// Probes were moved: the plane that fits them best. Rows give value, slope in x and slope in y from the corners.
    Plane { centre: Vec2, rows: [[f32; 4]; 3] },
}

impl Blend {
    pub(super) fn new(state: &State, rect: &Rect) -> Self {
        let at: [Vec2; 4] = rect.corners.map(|t| {
            let [x, y] = state.texels.pixel[t as usize].map(f32::from);
            Vec2::new(x, y)
        });
        let exact = (0..4).all(|k| at[k] == Vec2::new(rect.x[k & 1] as f32, rect.y[k >> 1] as f32));
        if exact {
            let size = at[3] - at[0];
            return Blend::Bilinear { origin: at[0], scale: 1.0 / size.max(Vec2::ONE) };
        }
        Self::plane(at)
    }

    fn plane(at: [Vec2; 4]) -> Self {
        let centre = (at[0] + at[1] + at[2] + at[3]) / 4.0;
        let d = at.map(|p| p - centre);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for p in d {
            xx += p.x * p.x;
            xy += p.x * p.y;
            yy += p.y * p.y;
        }
        // A little stiffness keeps slopes finite where the probes lie on a line or in one place.
        let stiff = 0.01 * (xx + yy) + 0.25;
        let (xx, yy) = (xx + stiff, yy + stiff);
        let det = xx * yy - xy * xy;
        let rows = [[0.25; 4], d.map(|p| (yy * p.x - xy * p.y) / det), d.map(|p| (xx * p.y - xy * p.x) / det)];
        Blend::Plane { centre, rows }
    }

    pub(super) fn weights(&self, p: Vec2) -> [f32; 4] {
        match self {
            Blend::Bilinear { origin, scale } => {
                let f = ((p - *origin) * *scale).clamp(Vec2::ZERO, Vec2::ONE);
                [(1.0 - f.x) * (1.0 - f.y), f.x * (1.0 - f.y), (1.0 - f.x) * f.y, f.x * f.y]
            }
            Blend::Plane { centre, rows } => {
                let d = p - *centre;
                std::array::from_fn(|k| rows[0][k] + rows[1][k] * d.x + rows[2][k] * d.y)
            }
        }
    }

    pub(super) fn value(&self, p: Vec2, corner: impl Fn(usize) -> Vec3) -> Vec3 {
        let w = self.weights(p);
        corner(0) * w[0] + corner(1) * w[1] + corner(2) * w[2] + corner(3) * w[3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_reproduce_linear_functions() {
        let at = [Vec2::new(1.0, 0.0), Vec2::new(9.0, 1.0), Vec2::new(0.0, 7.0), Vec2::new(8.0, 9.0)];
        let f = |p: Vec2| Vec3::splat(3.0 + 0.5 * p.x - 0.25 * p.y);
        let blend = Blend::plane(at);
        let p = Vec2::new(4.0, 5.0);
        let got = blend.value(p, |k| f(at[k]));
        assert!((got - f(p)).length() < 0.1, "{got}");
        let constant = blend.value(p, |_| Vec3::ONE);
        assert!((constant - Vec3::ONE).length() < 1e-5);
    }
}
