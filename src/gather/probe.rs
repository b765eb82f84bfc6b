//! A probe: irradiance at one texel from all directions, by stratified rays into the coarse solution.
//!
//! The hemisphere is cut into strata of equal irradiance with one ray each; more rays go where the view changes, such
//! as along the frame of a window. How many a stratum gets is told by its neighbours and not by its own ray: otherwise
//! small bright things would be looked at again where a ray met them but not where it missed, and come out too dark.
//! Only where several rays were cast anyhow do these speak for themselves.

use super::footprint::{Footprint, Usable};
use super::source::{Followed, Source};
use super::tally::{Grouped, Sums};
use super::visibility::Screen;
use crate::accel::offset_origin;
use crate::hierarchy::Side;
use crate::math::{Sequence, cosine_hemisphere, hash2};
use crate::scene::Rgb;
use glam::Vec2;
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;

/// Strata along a side of the square that maps to the hemisphere.
const SIDE: usize = 16;
/// All strata.
const STRATA: usize = SIDE * SIDE;
/// Most rays of one stratum.
const MOST: f32 = 4096.0;
/// Rays of a stratum in which neighbours saw something bright.
const LOOKS: u32 = 4;
/// Places of a stratum, in units of strata, at which the guide is asked.
const INSIDE: [Vec2; 5] =
    [Vec2::new(0.5, 0.5), Vec2::new(0.1, 0.1), Vec2::new(0.9, 0.1), Vec2::new(0.1, 0.9), Vec2::new(0.9, 0.9)];
/// Times that rays are shared out.
const ROUNDS: u32 = 2;

/// How many rays a probe casts.
#[derive(Clone, Copy, Debug)]
pub struct ProbeSettings {
    /// Most rays on top of one per stratum.
    pub extra: u32,
    /// Standard error, relative to the irradiance with that from lamps, at which a probe is content.
    pub tolerance: f32,
    /// Irradiance below which errors do not matter, W/m².
    pub floor: f32,
}

/// Irradiance at a texel, with what is needed to judge how far it reaches.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Probe {
    /// W/m².
    pub irradiance: Rgb,
    /// The same by light group, if light is kept apart.
    pub groups: Box<[Rgb]>,
    /// Harmonic mean distance to what is seen, metres.
    pub distance: f32,
    /// Standard error of the irradiance's mean channel, W/m².
    pub error: f32,
    /// Rays cast.
    pub rays: u32,
}

impl Probe {
    /// Gathers at `texel`. Rays start all over the texel's usable part, so that the value is its mean.
    pub fn gather(source: &Source, footprint: &Footprint, texel: u32, settings: &ProbeSettings) -> Self {
        let usable = footprint.usable(texel);
        let view = View { source, usable: &usable, screen: source.start(texel, Side::Front).screen };
        let mut strata = [Stratum::default(); STRATA];
        let mut groups = Grouped::new(source.groups(), STRATA);
        let (mut inverse, mut rays) = (0.0f32, 0);
        let sequence = Sequence::new(0x9a7e);
        for i in 0..STRATA as u32 {
            let u = sequence.first(i);
            let s = stratum(u);
            let seen = view.cast(u, sequence.second(i), 1.0, groups.of_mut(s));
            strata[s].add(seen.radiance);
            inverse += 1.0 / seen.distance.max(1e-6);
            rays += seen.rays;
        }
        if let Some(bright) = source.bright(texel) {
            let normal = usable.centre.shading_normal;
            for (s, stratum) in strata.iter_mut().enumerate() {
                // A stratum is wider than the directions that the guide tells apart.
                let is_bright =
                    |inside: &Vec2| bright.contains(cosine_hemisphere(normal, (corner(s) + *inside) / SIDE as f32));
                if INSIDE.iter().any(is_bright) {
                    rays += view.look_closer(s, stratum, LOOKS, groups.of_mut(s));
                }
            }
        }
        let mut spread = spread(&strata.map(|s| s.mean()), &strata.map(|s| s.variance()));
        let mean = strata.iter().map(Stratum::mean).sum::<f32>() / STRATA as f32;
        let all = PI * mean + source.direct(texel) + settings.floor;
        let mut parts = vec![Rgb::ZERO; source.groups()];
        let sent = source.sent_to(&usable, 0.5 * settings.tolerance * all, &mut parts);
        rays += sent.rays;
        let mean = mean + sent.irradiance.element_sum() / 3.0 / PI;
        // What the eye compares is all the light at the texel, not the part gathered here.
        let tolerance = settings.tolerance * (mean + (source.direct(texel) + settings.floor) / PI);
        for _ in 0..ROUNDS {
            let counts = allot(&spread, tolerance, settings.extra);
            for (s, stratum) in strata.iter_mut().enumerate() {
                rays += view.look_closer(s, stratum, counts[s], groups.of_mut(s));
                // So many rays may speak for themselves: whether one of them met something hardly matters.
                if stratum.count >= LOOKS {
                    spread[s] = stratum.variance().sqrt();
                }
            }
        }
        let variance: f32 = spread.iter().zip(&strata).map(|(&spread, s)| spread * spread / s.count as f32).sum();
        for (s, stratum) in strata.iter().enumerate() {
            let share = PI / (STRATA as f32 * stratum.count as f32);
            parts.iter_mut().zip(groups.of(s)).for_each(|(part, &sum)| *part += sum * share);
        }
        Self {
            irradiance: sent.irradiance
                + strata.iter().map(|s| s.sum / s.count as f32).sum::<Rgb>() * (PI / STRATA as f32),
            groups: parts.into(),
            distance: STRATA as f32 / inverse.max(1e-12),
            error: (PI * variance.sqrt() / STRATA as f32).hypot(sent.error),
            rays,
        }
    }
}

/// What the rays of one stratum brought.
#[derive(Clone, Copy, Default)]
struct Stratum {
    /// Sum of radiance, W/(m²·sr).
    sum: Rgb,
    /// Sum of squares of the channels' mean.
    squares: f32,
    /// Rays.
    count: u32,
}

impl Stratum {
    fn add(&mut self, radiance: Rgb) {
        self.sum += radiance;
        self.squares += (radiance.element_sum() / 3.0).powi(2);
        self.count += 1;
    }

    fn mean(&self) -> f32 {
        self.sum.element_sum() / 3.0 / self.count as f32
    }

    /// Of single rays; zero if there is but one.
    fn variance(&self) -> f32 {
        if self.count < 2 {
            return 0.0;
        }
        let n = self.count as f32;
        ((self.squares / n - self.mean().powi(2)) * n / (n - 1.0)).max(0.0)
    }
}

/// Lower corner of stratum `s` in units of strata.
fn corner(s: usize) -> Vec2 {
    Vec2::new((s % SIDE) as f32, (s / SIDE) as f32)
}

/// Rays from one texel.
struct View<'a> {
    source: &'a Source<'a>,
    usable: &'a Usable<'a>,
    screen: Screen<'a>,
}

impl View<'_> {
    /// Casts rays into stratum `s` until it has `count`, with sums by light group beside it. Returns how many that took,
    /// turns included.
    fn look_closer(&self, s: usize, stratum: &mut Stratum, count: u32, groups: &mut [Rgb]) -> u32 {
        let sequence = Sequence::new(hash2(s as u32, 0x57a7));
        let mut rays = 0;
        for i in stratum.count..count {
            let u = (corner(s) + sequence.first(i)) / SIDE as f32;
            let seen = self.cast(u, sequence.second(i), 1.0 / count as f32, groups);
            stratum.add(seen.radiance);
            rays += seen.rays;
        }
        rays
    }

    /// What lies in the direction that belongs to `u`. The ray stands for `share` of a stratum and starts where `place`
    /// says. Adds to the sums by light group, if there are any.
    fn cast(&self, u: Vec2, place: Vec2, share: f32, groups: &mut [Rgb]) -> Followed {
        let p = self.usable.point(place);
        let direction = cosine_hemisphere(p.shading_normal, u);
        if direction.dot(p.geometric_normal) <= 0.0 {
            return Followed { radiance: Rgb::ZERO, distance: f32::INFINITY, rays: 0 };
        }
        // Cosine-weighted rays stand for more of the view towards the horizon.
        let cosine = direction.dot(p.shading_normal).max(0.05);
        let solid_angle = share * PI / (STRATA as f32 * cosine);
        let seed = hash2(u.x.to_bits(), u.y.to_bits());
        let origin = offset_origin(p.position, p.geometric_normal);
        // What is sent to the texel is sent to its centre.
        let (source, receiver) = (self.source, self.usable.centre.position);
        match groups.is_empty() {
            true => source.follow(origin, direction, solid_angle, self.screen, receiver, seed, &mut ()),
            false => source.follow(origin, direction, solid_angle, self.screen, receiver, seed, &mut Sums(groups)),
        }
    }
}

/// The stratum that a point of the unit square lies in.
fn stratum(u: Vec2) -> usize {
    let index = |x: f32| ((x * SIDE as f32) as usize).min(SIDE - 1);
    index(u.y) * SIDE + index(u.x)
}

/// Deviation to be expected inside each stratum, from the differences between its neighbours on opposite sides and from
/// the variance inside these.
fn spread(radiance: &[f32; STRATA], variance: &[f32; STRATA]) -> [f32; STRATA] {
    let value = |x: i32, y: i32| {
        let inside = |v: i32| (0..SIDE as i32).contains(&v);
        (inside(x) && inside(y)).then(|| y as usize * SIDE + x as usize)
    };
    std::array::from_fn(|s| {
        let (x, y) = ((s % SIDE) as i32, (s / SIDE) as i32);
        let (mut squares, mut pairs) = (0.0, 0);
        for (dx, dy) in [(1, 0), (0, 1), (1, 1), (1, -1)] {
            // At the horizon, where a side is missing, two that follow one another on the other side tell.
            let one = value(x + dx, y + dy).or_else(|| value(x - 2 * dx, y - 2 * dy));
            let other = value(x - dx, y - dy).or_else(|| value(x + 2 * dx, y + 2 * dy));
            if let (Some(a), Some(b)) = (one, other) {
                squares += (radiance[a] - radiance[b]).powi(2) + variance[a] + variance[b];
                pairs += 1;
            }
        }
        (squares / (2 * pairs) as f32).sqrt()
    })
}

/// Rays per stratum, one at least, so that the standard error of their mean stays below `tolerance` with the fewest
/// rays: in proportion to the spread.
fn allot(spread: &[f32; STRATA], tolerance: f32, extra: u32) -> [u32; STRATA] {
    let total: f32 = spread.iter().sum();
    let wanted = total / (STRATA as f32 * tolerance.max(f32::MIN_POSITIVE)).powi(2);
    let most = (STRATA as u32 + extra) as f32 / total.max(f32::MIN_POSITIVE);
    spread.map(|s| (wanted.min(most) * s).clamp(1.0, MOST).round() as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stratum_does_not_judge_itself() {
        let mut radiance = [1.0; STRATA];
        radiance[5 * SIDE + 7] = 100.0;
        let spread = spread(&radiance, &[0.0; STRATA]);
        assert_eq!(spread[5 * SIDE + 7], 0.0);
        assert!(spread[5 * SIDE + 8] > 10.0);
        assert_eq!(spread[5 * SIDE + 10], 0.0);
    }

    #[test]
    fn borders_are_judged_from_inside() {
        let mut radiance = [0.0; STRATA];
        for y in 0..SIDE {
            radiance[y * SIDE + 1] = 1.0;
        }
        let spread = spread(&radiance, &[0.0; STRATA]);
        assert!((0..SIDE).all(|y| spread[y * SIDE] > 0.3), "{:?}", spread[0]);
    }

    #[test]
    fn rays_follow_the_spread_and_meet_the_tolerance() {
        let mut spread = [0.0; STRATA];
        for (i, s) in spread.iter_mut().enumerate().take(64) {
            *s = 1.0 + (i % 4) as f32;
        }
        let counts = allot(&spread, 0.01, 100_000);
        let variance: f32 = counts.iter().zip(&spread).map(|(&c, &s)| s * s / c as f32).sum();
        assert!(variance.sqrt() / STRATA as f32 <= 0.0105, "{}", variance.sqrt() / STRATA as f32);
        assert!(counts[64..].iter().all(|&c| c == 1));
        // An even spread of rays would take 4,687.
        assert!(counts.iter().sum::<u32>() < 4200);
    }
}
