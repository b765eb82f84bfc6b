//! An area lamp or emissive triangles as a receiver close to them sees them: points drawn by what they bring to it.
//!
//! Points that are drawn evenly over a large plane nearby differ in what they bring by orders of magnitude, so that few
//! rays say little about how much of its light is blocked.

use super::emitter_triangle::EmitterTriangle;
use super::emitters::BUNDLE;
use super::lamp::{LampSample, Shape, area_sample};
use crate::scene::Rgb;
use crate::transport::ProjectedPolygon;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Radii of a lamp within which its parts bring unlike light to a receiver.
const NEAR: f32 = 2.0;

/// A lamp as one receiver sees it.
pub(super) struct NearView<'a> {
    from: Vec3,
    normal: Vec3,
    /// Lower bound of its distance, metres.
    pub(super) nearest: f32,
    seen: Seen<'a>,
}

enum Seen<'a> {
    /// A Lambertian rectangle.
    Panel { polygon: ProjectedPolygon, corner: Vec3, normal: Vec3, radiance: Rgb },
    /// Emissive triangles with the running sum of what they bring, W/m².
    Triangles { triangles: &'a [EmitterTriangle], cumulative: [f32; BUNDLE] },
}

/// True if points of the lamp should be drawn for a receiver at `p` in particular.
pub(super) fn is_near(shape: &Shape, p: Vec3) -> bool {
    let within = |centre: Vec3, radius: f32| p.distance_squared(centre) < (NEAR * radius).powi(2);
    match shape {
        Shape::Polygon { centre, half, round: false, spread, .. } if *spread >= PI => {
            within(*centre, half[0].length().hypot(half[1].length()))
        }
        Shape::Triangles { centre, radius, .. } => within(*centre, *radius),
        _ => false,
    }
}

impl<'a> NearView<'a> {
    /// A lamp that is near for a receiver at `from` with unit `normal`; none if it brings nothing there.
    pub(super) fn new(shape: &'a Shape, from: Vec3, normal: Vec3) -> Option<Self> {
        match shape {
            Shape::Polygon { corners, centre, half, normal: front, radiance, .. } => {
                let facing = (from - centre).dot(*front);
                let relative: [Vec3; 4] = std::array::from_fn(|i| corners[i] - from);
                let polygon = (facing > 0.0).then(|| ProjectedPolygon::new(normal, &relative)).flatten()?;
                let nearest = facing.max(from.distance(*centre) - half[0].length().hypot(half[1].length()));
                let seen = Seen::Panel { polygon, corner: corners[0], normal: *front, radiance: *radiance };
                Some(Self { from, normal, nearest, seen })
            }
            Shape::Triangles { triangles, .. } => {
                let (mut cumulative, mut sum, mut nearest) = ([0.0; BUNDLE], 0.0, f32::INFINITY);
                for (t, cumulative) in triangles.iter().zip(&mut cumulative) {
                    let brings = t.unoccluded(from, normal).max_element();
                    if brings > 0.0 {
                        sum += brings;
                        nearest = nearest.min(t.distance(from));
                    }
                    *cumulative = sum;
                }
                let seen = Seen::Triangles { triangles, cumulative };
                (sum > 0.0).then_some(Self { from, normal, nearest, seen })
            }
            _ => None,
        }
    }

    /// A point of the lamp from `u` in the unit square, and what it is worth at `p`, which is the receiver's or another
    /// close by: without the cosine there.
    pub(super) fn sample(&self, p: Vec3, u: Vec2) -> Option<LampSample> {
        match &self.seen {
            Seen::Panel { polygon, corner, normal, radiance } => {
                let (point, area) = self.point(polygon, *corner, *normal, u)?;
                area_sample(point - p, *normal, false, *radiance * area)
            }
            Seen::Triangles { triangles, cumulative } => {
                let sums = &cumulative[..triangles.len()];
                let wanted = u.x * sums[sums.len() - 1];
                let i = sums.partition_point(|&sum| sum <= wanted).min(sums.len() - 1);
                let before = if i == 0 { 0.0 } else { sums[i - 1] };
                let brings = sums[i] - before;
                if brings <= 0.0 {
                    return None;
                }
                let (t, u) = (&triangles[i], Vec2::new(((wanted - before) / brings).clamp(0.0, 1.0), u.y));
                let (point, area) = if t.is_far(self.from) {
                    (t.point(u), t.area)
                } else {
                    let corners = t.corners.map(|c| c - self.from);
                    self.point(&ProjectedPolygon::new(self.normal, &corners)?, t.corners[0], t.normal, u)?
                };
                let area = area * sums[sums.len() - 1] / brings;
                area_sample(point - p, t.normal, t.two_sided, t.radiance * area)
            }
        }
    }

    /// A point in the plane through `corner` with unit `normal`, within the polygon that is seen there, and the inverse of
    /// its density, m².
    fn point(&self, polygon: &ProjectedPolygon, corner: Vec3, normal: Vec3, u: Vec2) -> Option<(Vec3, f32)> {
        let (direction, inverse) = polygon.sample(u)?;
        let slope = normal.dot(direction);
        let distance = normal.dot(corner - self.from) / slope;
        let cosines = slope.abs() * self.normal.dot(direction);
        let area = inverse * distance * distance / cosines;
        (distance > 0.0 && cosines > 0.0 && area.is_finite()).then_some((self.from + direction * distance, area))
    }
}

#[cfg(test)]
mod tests {
    use super::super::Lamp;
    use super::*;
    use crate::math::{Distribution, Sequence};
    use crate::transport::form_factor;

    /// A square over the origin in two triangles or as a lamp.
    fn squares(half: f32, height: f32) -> [Shape; 2] {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, z]| Vec3::new(half * x, height, half * z))
            .to_vec();
        let triangle = |corners: [Vec3; 3]| EmitterTriangle {
            corners,
            normal: Vec3::NEG_Y,
            radiance: Rgb::new(1.0, 0.5, 0.0),
            area: 2.0 * half * half,
            two_sided: false,
        };
        let c = &corners;
        let triangles = vec![triangle([c[0], c[1], c[2]]), triangle([c[0], c[2], c[3]])];
        let draw = Distribution::new([1.0, 1.0]);
        let (centre, radiance) = (Vec3::Y * height, Rgb::new(1.0, 0.5, 0.0));
        let mesh = Shape::Triangles { triangles, draw, centre, radius: half * 2f32.sqrt() };
        let half = [Vec3::X * half, Vec3::Z * half];
        [Shape::Polygon { corners, centre, half, normal: Vec3::NEG_Y, round: false, radiance, spread: PI }, mesh]
    }

    #[test]
    fn every_sample_brings_the_same_light() {
        for shape in squares(2.0, 0.25) {
            let (p, n) = (Vec3::new(1.7, 0.0, 0.3), Vec3::new(0.28, 0.96, 0.0));
            let view = NearView::new(&shape, p, n).expect("the square is above");
            let sequence = Sequence::new(9);
            let weights: Vec<f32> = (0..1024)
                .filter_map(|i| view.sample(p, sequence.first(i)))
                .map(|s| s.weight.x * n.dot(s.direction))
                .collect();
            let mean = weights.iter().sum::<f32>() / 1024.0;
            let lamp = Lamp { shape: shape.clone(), casts_shadows: true, group: 0 };
            let want = lamp.unoccluded(p, n).x;
            assert!((mean / want - 1.0).abs() < 5e-3, "{mean} instead of {want}");
            let squares: f32 = weights.iter().map(|w| (w / mean - 1.0).powi(2)).sum();
            assert!((squares / 1024.0).sqrt() < 0.1, "they vary by {}", (squares / 1024.0).sqrt());
        }
    }

    #[test]
    fn what_one_point_draws_serves_another_nearby() {
        for shape in squares(1.0, 0.5) {
            let (from, p, n) = (Vec3::new(0.2, 0.0, 0.3), Vec3::new(0.25, 0.0, 0.26), Vec3::Y);
            let view = NearView::new(&shape, from, n).expect("the square is above");
            let sequence = Sequence::new(2);
            let sum: f32 = (0..4096)
                .filter_map(|i| view.sample(p, sequence.first(i)))
                .map(|s| s.weight.y * n.dot(s.direction))
                .sum();
            let lamp = Lamp { shape: shape.clone(), casts_shadows: true, group: 0 };
            assert!((sum / 4096.0 / lamp.unoccluded(p, n).y - 1.0).abs() < 5e-3);
        }
    }

    #[test]
    fn one_sample_finds_as_much_of_it_hidden_as_is() {
        // What lies beyond x = 0.3 is hidden; of the rest the light is known in closed form.
        let (half, height, edge) = (2.0, 0.25, 0.3);
        let (p, n) = (Vec3::new(0.2, 0.0, 0.5), Vec3::Y);
        let part =
            [[-half, -half], [edge, -half], [edge, half], [-half, half]].map(|[x, z]| Vec3::new(x, height, z) - p);
        for shape in squares(half, height) {
            let lamp = Lamp { shape, casts_shadows: true, group: 0 };
            let want = PI * form_factor::polygon(n, &part) / lamp.unoccluded(p, n).x;
            let count = 1 << 14;
            let samples = (0..count).filter_map(|seed| lamp.aim(p, n, 0.0).sample(p, n, Sequence::new(seed).first(0)));
            let seen = samples.filter(|s| (p + s.direction * s.distance).x < edge).count();
            let got = seen as f32 / count as f32;
            assert!((got - want).abs() < 0.01, "{got} instead of {want}");
        }
    }
}
