//! A portal: panes through which a neighbourhood sees the sky, as a lamp that shines with the sky's own radiance.
//!
//! A window fills little of the view of a room and yet lights all of it: rays that look all around find it by chance,
//! rays that are sent to it do not miss it.

use super::lamp::LampSample;
use crate::math::SphericalRect;
use crate::scene::{Environment, Rgb};
use crate::transport::form_factor;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Most panes of one portal.
pub(super) const MOST_PANES: usize = 8;
/// Angle that a part of a pane spans along a side for which the sky's radiance is asked once, radians.
const PART: f32 = 0.5;
/// Share of a pane's size that a receiver must be in front of it.
const IN_FRONT: f32 = 1e-3;

/// A rectangle across one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pane {
    /// The axis across which it lies.
    pub(super) axis: usize,
    /// Sign of the direction in which light leaves the neighbourhood through it.
    pub(super) outward: f32,
    /// Position on the axis, metres.
    pub(super) plane: f32,
    /// Bounds on the next two axes in cyclic order, metres.
    pub(super) low: Vec2,
    pub(super) high: Vec2,
}

impl Pane {
    /// Coordinates of `v` on the two axes that the pane spans.
    pub(super) fn across(axis: usize, v: Vec3) -> Vec2 {
        Vec2::new(v[(axis + 1) % 3], v[(axis + 2) % 3])
    }

    /// The vector with these coordinates.
    fn vector(&self, across: Vec2, along: f32) -> Vec3 {
        let mut v = Vec3::ZERO;
        v[self.axis] = along;
        v[(self.axis + 1) % 3] = across.x;
        v[(self.axis + 2) % 3] = across.y;
        v
    }

    /// How far `p` lies in front of the pane, metres; none if it is behind it or as good as in its plane.
    fn depth(&self, p: Vec3) -> Option<f32> {
        let depth = (self.plane - p[self.axis]) * self.outward;
        (depth > IN_FRONT * (self.high - self.low).max_element()).then_some(depth)
    }

    /// Distance of its nearest point from `p`, metres.
    fn distance(&self, p: Vec3) -> f32 {
        let at = Self::across(self.axis, p);
        (at.clamp(self.low, self.high) - at).length().hypot(self.plane - p[self.axis])
    }

    /// True if the ray passes through it from the inside.
    fn is_passed(&self, origin: Vec3, direction: Vec3) -> bool {
        let slope = direction[self.axis] * self.outward;
        let Some(depth) = self.depth(origin).filter(|_| slope > 0.0) else { return false };
        let at = Self::across(self.axis, origin + direction * (depth / slope));
        at.cmpge(self.low).all() && at.cmple(self.high).all()
    }

    /// Corners relative to `p` of the part of the pane between two points on it.
    fn part(&self, p: Vec3, from: Vec2, to: Vec2) -> [Vec3; 4] {
        [from, Vec2::new(to.x, from.y), to, Vec2::new(from.x, to.y)].map(|at| self.vector(at, self.plane) - p)
    }

    /// Coordinates along one of its sides between which it spans even angles of at most [`PART`] as seen from `p`: however
    /// close it is, it falls into few parts.
    fn cuts(&self, p: Vec3, side: usize) -> Vec<f32> {
        let at = Self::across(self.axis, p);
        let aside = (at.clamp(self.low, self.high) - at)[1 - side];
        let distance = aside.hypot(self.plane - p[self.axis]);
        let angle = |c: f32| ((c - at[side]) / distance).atan();
        let (first, last) = (angle(self.low[side]), angle(self.high[side]));
        let count = ((last - first) / PART).ceil().max(1.0) as u32;
        let inner = (1..count).map(|i| at[side] + distance * (first + (last - first) * i as f32 / count as f32).tan());
        std::iter::once(self.low[side]).chain(inner).chain([self.high[side]]).collect()
    }

    /// Share of the view from a point with unit normal `n` that it fills, weighted by the cosine.
    pub(super) fn fill(&self, p: Vec3, n: Vec3) -> f32 {
        match self.depth(p) {
            Some(_) => form_factor::polygon(n, &self.part(p, self.low, self.high)),
            None => 0.0,
        }
    }

    /// The parts of the pane below and above height `y`.
    fn cut_at_height(&self, y: f32) -> [Option<Self>; 2] {
        // The second of the axes x, y, z is height; a pane across it has all of itself on one side of a receiver.
        let height = match self.axis {
            0 => 0,
            1 => return [Some(*self), None],
            _ => 1,
        };
        let (mut below, mut above) = (*self, *self);
        below.high[height] = below.high[height].min(y);
        above.low[height] = above.low[height].max(y);
        [below, above].map(|part| (part.low[height] < part.high[height]).then_some(part))
    }

    /// The pane as seen from `p`.
    fn seen_from(&self, p: Vec3) -> Option<SphericalRect> {
        let at = Self::across(self.axis, p);
        self.depth(p).map(|depth| SphericalRect::new(self.low - at, self.high - at, depth))
    }
}

/// Panes that no ray from the neighbourhood passes two of, and the sky behind them.
#[derive(Clone, Debug)]
pub struct Portal {
    pub(super) panes: Vec<Pane>,
    pub(super) environment: Environment,
}

impl Portal {
    /// True if what a ray sees of the sky is sent by this lamp.
    pub(super) fn shows(&self, origin: Vec3, direction: Vec3) -> bool {
        self.panes.iter().any(|pane| pane.is_passed(origin, direction))
    }

    /// Distance of the nearest pane, metres.
    pub(super) fn distance(&self, p: Vec3) -> f32 {
        self.panes.iter().map(|pane| pane.distance(p)).fold(f32::INFINITY, f32::min)
    }

    /// Irradiance at a point with unit normal `n` if nothing blocks, W/m².
    pub(super) fn unoccluded(&self, p: Vec3, n: Vec3) -> Rgb {
        self.panes.iter().map(|pane| self.through(pane, p, n)).sum()
    }

    /// The same through one pane.
    fn through(&self, pane: &Pane, p: Vec3, n: Vec3) -> Rgb {
        if pane.depth(p).is_none() {
            return Rgb::ZERO;
        }
        match self.environment {
            Environment::Constant(l) => l * (PI * pane.fill(p, n)),
            // The gradient has a step at the horizon, which no part may straddle.
            Environment::Gradient { .. } => {
                pane.cut_at_height(p.y).iter().flatten().map(|pane| self.parts(pane, p, n)).sum()
            }
            _ => self.parts(pane, p, n),
        }
    }

    /// The same, part by part, where the sky's radiance changes smoothly.
    fn parts(&self, pane: &Pane, p: Vec3, n: Vec3) -> Rgb {
        let [columns, rows] = [0, 1].map(|side| pane.cuts(p, side));
        let mut sum = Rgb::ZERO;
        for y in rows.windows(2) {
            for x in columns.windows(2) {
                let (from, to) = (Vec2::new(x[0], y[0]), Vec2::new(x[1], y[1]));
                let corners = pane.part(p, from, to);
                let factor = form_factor::polygon(n, &corners);
                if factor > 0.0 {
                    let middle = pane.vector(from.midpoint(to), pane.plane) - p;
                    let direction = middle.normalize_or_zero();
                    let facing = (to - from).element_product() * (direction[pane.axis] * pane.outward).max(0.0);
                    let solid_angle = (facing / middle.length_squared().max(1e-12)).min(2.0 * PI);
                    sum += self.environment.mean_radiance(direction, solid_angle) * (PI * factor);
                }
            }
        }
        sum
    }

    /// The panes as they are seen from `from`, to be sampled from there and nearby.
    pub(super) fn view(&self, from: Vec3) -> PortalView<'_> {
        let mut seen = [None; MOST_PANES];
        let mut total = 0.0;
        for (seen, pane) in seen.iter_mut().zip(&self.panes) {
            *seen = pane.seen_from(from).map(|rect| (pane, rect));
            total += seen.map_or(0.0, |(_, rect)| rect.solid_angle());
        }
        PortalView { environment: &self.environment, from, seen, total }
    }
}

/// A portal seen from one point.
pub(super) struct PortalView<'a> {
    environment: &'a Environment,
    from: Vec3,
    seen: [Option<(&'a Pane, SphericalRect)>; MOST_PANES],
    /// Solid angle of all panes, sr.
    total: f32,
}

impl PortalView<'_> {
    /// A direction from `p` through a pane, none if there is none. Its points are drawn as the view's own point sees them,
    /// uniformly in solid angle over all panes, and weigh what they are worth at `p`, without the receiver's cosine.
    pub(super) fn sample(&self, p: Vec3, u: Vec2) -> Option<LampSample> {
        let mut left = u.x * self.total;
        let mut chosen = None;
        for &(pane, rect) in self.seen.iter().flatten() {
            chosen = Some((pane, rect, left / rect.solid_angle().max(f32::MIN_POSITIVE)));
            left -= rect.solid_angle();
            if left < 0.0 {
                break;
            }
        }
        let (pane, rect, within) = chosen?;
        let depth = pane.depth(p)?;
        let (point, density) = rect.sample(Vec2::new(within.clamp(0.0, 1.0), u.y));
        let v = self.from + pane.vector(point.truncate(), point.z * pane.outward) - p;
        // What a part of the pane fills of the view goes as depth over distance cubed.
        let fills = depth / point.z * (point.length() / v.length()).powi(3);
        let direction = v.normalize();
        let weight = self.environment.radiance(direction) * (fills / density);
        Some(LampSample { direction, distance: f32::INFINITY, weight })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Sequence;

    fn window(environment: Environment) -> Portal {
        let pane = |low: Vec2, high: Vec2| Pane { axis: 2, outward: -1.0, plane: -2.0, low, high };
        let panes =
            vec![pane(Vec2::new(-1.0, -1.0), Vec2::new(0.5, 1.0)), pane(Vec2::new(1.0, 0.0), Vec2::new(1.5, 2.0))];
        Portal { panes, environment }
    }

    fn gradient() -> Environment {
        Environment::Gradient { zenith: Rgb::splat(3.0), horizon: Rgb::splat(2.0), ground: Rgb::splat(0.3) }
    }

    /// Irradiance by even directions over the hemisphere that pass a pane.
    fn by_rays(portal: &Portal, p: Vec3, n: Vec3) -> f32 {
        let sequence = Sequence::new(1);
        let count = 1 << 18;
        let ray = |i: u32| crate::math::cosine_hemisphere(n, sequence.first(i));
        let seen = (0..count).map(ray).filter(|&d| portal.shows(p, d));
        seen.map(|d| portal.environment.radiance(d).x).sum::<f32>() * PI / count as f32
    }

    #[test]
    fn irradiance_through_panes_is_that_of_the_sky_behind_them() {
        for environment in [Environment::Constant(Rgb::ONE), gradient()] {
            let portal = window(environment);
            for (p, n) in [
                (Vec3::new(0.2, 0.3, 0.0), Vec3::NEG_Z),
                (Vec3::new(0.9, 0.1, -1.5), Vec3::new(-0.5, 0.2, -0.8).normalize()),
                (Vec3::new(0.0, 0.9, -1.8), Vec3::NEG_Y),
            ] {
                let (got, want) = (portal.unoccluded(p, n).x, by_rays(&portal, p, n));
                assert!((got / want - 1.0).abs() < 0.01, "{p} {n}: {got} instead of {want}");
            }
        }
    }

    #[test]
    fn a_pane_that_is_almost_touched_shows_the_sky_where_it_is() {
        let environment =
            Environment::Gradient { zenith: Rgb::splat(0.5), horizon: Rgb::splat(4.0), ground: Rgb::splat(0.1) };
        let pane = Pane { axis: 2, outward: -1.0, plane: -2.0, low: Vec2::new(-6.0, -5.0), high: Vec2::new(6.0, 7.0) };
        let portal = Portal { panes: vec![pane], environment };
        for (p, n) in [
            (Vec3::new(0.3, 0.2, -1.98), Vec3::new(0.0, 0.7, -0.7).normalize()),
            (Vec3::new(2.0, -1.0, -1.9), Vec3::NEG_Z),
        ] {
            let (got, want) = (portal.unoccluded(p, n).x, by_rays(&portal, p, n));
            assert!((got / want - 1.0).abs() < 0.01, "{p} {n}: {got} instead of {want}");
        }
    }

    #[test]
    fn samples_weigh_the_sky_as_the_receiver_sees_it() {
        let portal = window(gradient());
        let (p, n) = (Vec3::new(0.4, 0.3, -0.5), Vec3::new(0.3, 0.4, -0.9).normalize());
        let sequence = Sequence::new(2);
        let upper = |d: Vec3| d.y > 0.2;
        // Seen from there, or from a point nearby.
        let shares = [p, p + Vec3::new(0.2, -0.1, 0.15)].map(|from| {
            let view = portal.view(from);
            let (mut all, mut part) = (0.0, 0.0);
            for i in 0..1 << 14 {
                let sample = view.sample(p, sequence.first(i)).expect("it lies in front of the panes");
                let weight = sample.weight.x * n.dot(sample.direction).max(0.0);
                all += weight;
                part += if upper(sample.direction) { weight } else { 0.0 };
            }
            part / all
        });
        let count = 1 << 18;
        let rays = (0..count).map(|i| crate::math::cosine_hemisphere(n, sequence.second(i)));
        let seen: Vec<Vec3> = rays.filter(|&d| portal.shows(p, d)).collect();
        let sum = |keep: &dyn Fn(Vec3) -> bool| -> f32 {
            seen.iter().filter(|&&d| keep(d)).map(|&d| portal.environment.radiance(d).x).sum()
        };
        let want = sum(&upper) / sum(&|_| true);
        assert!(shares.iter().all(|share| (share - want).abs() < 5e-3), "{shares:?} instead of {want}");
    }

    #[test]
    fn what_lies_behind_or_in_the_plane_of_a_pane_sees_nothing_through_it() {
        let portal = window(gradient());
        for z in [-2.0, -3.0] {
            let p = Vec3::new(0.0, 0.0, z);
            assert!(portal.view(p).sample(p, Vec2::splat(0.5)).is_none());
            assert_eq!(portal.unoccluded(p, Vec3::NEG_Z), Rgb::ZERO);
            assert!(!portal.shows(p, Vec3::NEG_Z));
        }
    }
}
