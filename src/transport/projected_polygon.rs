//! The directions from a receiver to a near polygon, drawn by the receiver's cosine: each brings the same irradiance.
//!
//! The azimuth around the receiver's normal is drawn from a density that is linear in slices, the elevation exactly.
//!
//! Based on: Peters, "BRDF Importance Sampling for Polygonal Lights", 2021 (its split into sectors; the density of the
//! azimuth is tabulated here instead of inverted).

use super::form_factor::{MAX_VERTICES, clip_to_horizon};
use crate::math::orthonormal_basis;
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Corners that the polygon may have before it is clipped at the horizon.
const MOST_CORNERS: usize = 4;
/// Edges that are left when it is.
const MOST_EDGES: usize = MOST_CORNERS + 1;
/// Slices between the azimuths of two corners.
const PARTS: usize = 3;
/// Share of a slice by which its ends are drawn in: an edge that points to the zenith makes the density jump there.
const INSIDE: f32 = 1e-3;

/// A convex polygon as a receiver sees it above its horizon.
#[derive(Clone, Copy, Debug)]
pub struct ProjectedPolygon {
    /// The receiver's tangents and normal.
    frame: [Vec3; 3],
    /// Normals of the planes through the receiver and each edge, inwards, in that frame.
    edges: [Vec3; MOST_EDGES],
    edge_count: usize,
    slices: [Slice; MOST_EDGES * PARTS],
    slice_count: usize,
    /// Projected solid angle by the trapezoid rule, sr.
    total: f32,
}

/// A range of azimuths.
#[derive(Clone, Copy, Debug, Default)]
struct Slice {
    start: f32,
    width: f32,
    /// Projected solid angle per azimuth at its ends.
    density: [f32; 2],
}

impl Slice {
    fn mass(&self) -> f32 {
        0.5 * (self.density[0] + self.density[1]) * self.width
    }
}

impl ProjectedPolygon {
    /// The polygon with three or four `corners` (relative to the receiver, in order) for a receiver with unit `normal`.
    /// None if there is nothing of it above the horizon.
    pub fn new(normal: Vec3, corners: &[Vec3]) -> Option<Self> {
        debug_assert!(corners.len() <= MOST_CORNERS, "a triangle or a quadrilateral");
        let mut clipped = [Vec3::ZERO; MAX_VERTICES];
        let corner_count = clip_to_horizon(normal, corners, &mut clipped);
        if corner_count < 3 {
            return None;
        }
        let (x, y) = orthonormal_basis(normal);
        let local = |v: Vec3| Vec3::new(x.dot(v), y.dot(v), normal.dot(v).max(0.0)).normalize_or_zero();
        let corners: [Vec3; MOST_EDGES] =
            std::array::from_fn(|i| if i < corner_count { local(clipped[i]) } else { Vec3::ZERO });
        let corners = &corners[..corner_count];
        let middle: Vec3 = corners.iter().sum();
        let mut polygon = Self {
            frame: [x, y, normal],
            edges: [Vec3::ZERO; MOST_EDGES],
            edge_count: corner_count,
            slices: [Slice::default(); MOST_EDGES * PARTS],
            slice_count: 0,
            total: 0.0,
        };
        for i in 0..corner_count {
            let m = corners[i].cross(corners[(i + 1) % corner_count]);
            polygon.edges[i] = if m.dot(middle) < 0.0 { -m } else { m }.normalize_or_zero();
        }
        polygon.slice(corners);
        (polygon.total > 0.0).then_some(polygon)
    }

    /// Cuts the polygon at the azimuths of its corners, and what is between into slices.
    fn slice(&mut self, corners: &[Vec3]) {
        // If an edge parts the zenith from the polygon, that lies within a right angle of the edge's normal.
        let parting = self.edges.into_iter().min_by(|a, b| a.z.total_cmp(&b.z)).filter(|edge| edge.z < 0.0);
        let axis = parting.map_or(0.0, |edge| edge.y.atan2(edge.x));
        let relative = |c: &Vec3| {
            let angle = c.y.atan2(c.x) - axis;
            let turned = angle - TAU * (angle / TAU).round();
            if parting.is_some() { turned.clamp(-FRAC_PI_2, FRAC_PI_2) } else { turned }
        };
        let mut bounds = [PI; MOST_EDGES + 1];
        bounds.iter_mut().zip(corners).for_each(|(bound, corner)| *bound = relative(corner));
        bounds[..corners.len()].sort_unstable_by(f32::total_cmp);
        bounds[corners.len()] = bounds[0] + TAU;
        let sectors = if parting.is_some() { corners.len() - 1 } else { corners.len() };
        for sector in bounds[..=sectors].windows(2) {
            let width = (sector[1] - sector[0]) / PARTS as f32;
            for part in 0..PARTS {
                let start = axis + sector[0] + part as f32 * width;
                let at = |share: f32| {
                    let [inner, outer] = self.elevations(Vec2::from_angle(start + share * width));
                    0.5 * (outer - inner)
                };
                let slice = Slice { start, width, density: [at(INSIDE), at(1.0 - INSIDE)] };
                self.slices[self.slice_count] = slice;
                self.slice_count += 1;
                self.total += slice.mass();
            }
        }
    }

    /// Squared sines of the angles to the normal between which the polygon is seen in the direction `d` of an azimuth.
    fn elevations(&self, d: Vec2) -> [f32; 2] {
        let (mut inner, mut outer) = (0f32, 1f32);
        for m in &self.edges[..self.edge_count] {
            let slope = m.truncate().dot(d);
            let crossing = m.z * m.z / (m.z * m.z + slope * slope).max(f32::MIN_POSITIVE);
            match (slope > 0.0, m.z < 0.0) {
                (true, true) => inner = inner.max(crossing),
                (false, true) => return [0.0; 2],
                (false, false) if slope < 0.0 => outer = outer.min(crossing),
                _ => {}
            }
        }
        [inner, outer.max(inner)]
    }

    /// A unit direction to the polygon from `u` in the unit square, and the inverse of its density in projected solid
    /// angle, sr: alike for all but for a share of some tenths. None where rounding leaves nothing in it.
    pub fn sample(&self, u: Vec2) -> Option<(Vec3, f32)> {
        let mut left = u.x * self.total;
        let slices = &self.slices[..self.slice_count];
        let mut chosen = None;
        for slice in slices.iter().filter(|slice| slice.mass() > 0.0) {
            chosen = Some((slice, (left / slice.mass()).clamp(0.0, 1.0)));
            left -= slice.mass();
            if left < 0.0 {
                break;
            }
        }
        let (slice, within) = chosen?;
        let [a, b] = slice.density;
        // Where the integral of a linear density reaches its share.
        let share = within * (a + b) / (a + (a * a + within * (b * b - a * a)).max(0.0).sqrt());
        let d = Vec2::from_angle(slice.start + share * slice.width);
        let [inner, outer] = self.elevations(d);
        let sine2 = inner + u.y * (outer - inner);
        let density = (a + share * (b - a)) / self.total;
        let inverse = 0.5 * (outer - inner) / density;
        let [x, y, normal] = self.frame;
        let direction = (x * d.x + y * d.y) * sine2.sqrt() + normal * (1.0 - sine2).max(0.0).sqrt();
        (inverse > 0.0 && inverse.is_finite()).then_some((direction, inverse))
    }
}

#[cfg(test)]
mod tests {
    use super::super::form_factor;
    use super::*;
    use crate::math::Sequence;

    /// Holds the mean of the inverse densities, and the share of it on one side of a plane through the receiver, against
    /// Lambert's form factors; they vary by `spread` relatively.
    fn check(normal: Vec3, corners: &[Vec3], cut: Vec3, spread: f32) {
        let mut kept = [Vec3::ZERO; MAX_VERTICES];
        let count = clip_to_horizon(cut, corners, &mut kept);
        let want = [corners, &kept[..count]].map(|c| PI * form_factor::polygon(normal, c));
        let Some(polygon) = ProjectedPolygon::new(normal, corners) else {
            assert_eq!(want[0], 0.0, "normal {normal}, corners {corners:?}");
            return;
        };
        let sequence = Sequence::new(4);
        let tries = 1 << 14;
        let (mut sum, mut squares) = ([0.0f64; 2], 0.0);
        for (direction, inverse) in (0..tries).filter_map(|i| polygon.sample(sequence.first(i))) {
            let inverse = f64::from(inverse);
            sum[0] += inverse;
            sum[1] += if direction.dot(cut) > 0.0 { inverse } else { 0.0 };
            squares += inverse * inverse;
        }
        let got = sum.map(|s| (s / f64::from(tries)) as f32);
        let case = format!("normal {normal}, corners {corners:?}: {got:?} instead of {want:?}");
        assert!((got[0] / want[0] - 1.0).abs() < 2e-3 && (got[1] - want[1]).abs() < 3e-3 * want[0], "{case}");
        let variance = squares / f64::from(tries) - (sum[0] / f64::from(tries)).powi(2);
        let varies = variance.max(0.0).sqrt() as f32 / got[0];
        assert!(varies < spread, "{case}: they vary by {varies}");
    }

    #[test]
    fn samples_share_the_form_factor_evenly() {
        let square = |half: f32, height: f32, shift: Vec3| {
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
                .map(|[x, z]| Vec3::new(half * x, height, half * z) + shift)
        };
        let cut = Vec3::new(0.7, -0.1, 0.4).normalize();
        for shift in [Vec3::ZERO, Vec3::new(0.9, 0.0, 0.2), Vec3::new(1.0, 0.0, 0.0), Vec3::new(1.6, 0.0, -0.4)] {
            let q = square(1.0, 0.3, shift);
            // Towards the horizon the density bends most within slices.
            for (normal, spread) in
                [(Vec3::Y, 0.3), (Vec3::new(0.8, 0.6, 0.0), 0.4), (Vec3::new(-0.6, 0.48, 0.64), 0.5), (Vec3::X, 0.8)]
            {
                check(normal, &q, cut, spread);
                check(normal, &q[..3], cut, spread);
            }
        }
        // Nearly the whole hemisphere, and a small one.
        check(Vec3::Y, &square(100.0, 0.5, Vec3::ZERO), cut, 0.05);
        check(Vec3::Y, &square(0.1, 1.0, Vec3::X), Vec3::new(0.7, -0.75, 0.2).normalize(), 0.2);
    }

    #[test]
    fn what_is_below_the_horizon_or_seen_from_its_edge_has_no_samples() {
        let triangle = [Vec3::new(0.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(0.0, -1.0, 1.0)];
        assert!(ProjectedPolygon::new(Vec3::Y, &triangle).is_none());
        let flat = [Vec3::new(0.0, 1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), Vec3::new(-1.0, 1.0, 0.0)];
        assert!(ProjectedPolygon::new(Vec3::Y, &flat).is_none_or(|p| p.total < 1e-6));
    }
}
