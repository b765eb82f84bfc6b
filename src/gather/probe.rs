//! A probe: irradiance at one texel from all directions, by stratified rays into the coarse solution.
//!
//! The hemisphere is cut into strata of equal irradiance with one ray each; more rays go where the view changes, such
//! as along the frame of a window. How many a stratum gets is told by its neighbours and not by its own ray: otherwise
//! small bright things would be looked at again where a ray met them but not where it missed, and come out too dark.

use super::footprint::{Footprint, Usable};
use super::source::{Followed, Source};
use super::tally::{Grouped, Sums};
use super::visibility::Screen;
use crate::accel::offset_origin;
use crate::hierarchy::Side;
use crate::math::{Sequence, cosine_hemisphere, hash2, hash3};
use crate::scene::Rgb;
use glam::Vec2;
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;

/// Strata along a side of the square that maps to the hemisphere, where many rays are wanted.
const FINE: usize = 16;
/// Rays from which on many are wanted.
const DEMANDING: u32 = 128;
/// Most rays of one stratum.
const MOST: f32 = 4096.0;
/// Rays of a stratum in which neighbours saw something bright.
const LOOKS: u32 = 4;
/// Places of a stratum, in units of strata, at which the guide is asked.
const INSIDE: [Vec2; 5] =
    [Vec2::new(0.5, 0.5), Vec2::new(0.1, 0.1), Vec2::new(0.9, 0.1), Vec2::new(0.1, 0.9), Vec2::new(0.9, 0.9)];
/// Times as bright as others that the dark counts in gaps.
const GAP: f32 = 2.0;
/// Times that rays are shared out.
const ROUNDS: u32 = 2;

/// Rays that a probe casts at least: one in each stratum that it starts with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FewestRays {
    /// 16, which tell little of what is small.
    Few,
    /// 64.
    Many,
}

impl FewestRays {
    /// Strata along a side of the square that maps to the hemisphere.
    fn side(self) -> usize {
        match self {
            FewestRays::Few => 4,
            FewestRays::Many => 8,
        }
    }
}

/// How many rays a probe casts.
#[derive(Clone, Copy, Debug)]
pub struct ProbeSettings {
    /// Rays before it is known where more are wanted.
    pub fewest: FewestRays,
    /// Most rays on top of one per stratum.
    pub extra: u32,
    /// Standard error at which a probe is content, relative to the [yardstick](Self::yardstick) of all light at it.
    pub tolerance: f32,
    /// What is added to every yardstick, so that errors in the dark matter less, W/m².
    pub floor: f32,
    /// Irradiance above which a yardstick grows no more, W/m²: an error counts by what it adds to that of the whole
    /// lightmap, and in the few texels that are far brighter than the mean a relative one would outweigh all others.
    pub ceiling: f32,
}

impl ProbeSettings {
    /// The same for a standard error that is `times` as large.
    pub fn rough(self, times: f32) -> Self {
        Self { extra: (self.extra as f32 / (times * times)) as u32, tolerance: self.tolerance * times, ..self }
    }

    /// The same for a texel in a gap, such as between a thing and the floor that it stands on: hardly anything sees it.
    fn in_gap(self) -> Self {
        Self { floor: self.floor * GAP, ..self }
    }

    /// Irradiance by which errors are measured where all light together is `irradiance`, W/m².
    pub fn yardstick(&self, irradiance: f32) -> f32 {
        irradiance.min(self.ceiling) + self.floor
    }
}

/// Irradiance at a texel, with what is needed to judge how far it reaches.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
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
    /// How far it was taken.
    pub care: Care,
}

/// How far a probe was taken.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Care {
    /// To the error that the lightmap asks for, at once.
    #[default]
    Full,
    /// To a larger one, which its neighbours make up for.
    Rough,
    /// To the error asked for, after this rough one.
    Refined(Box<Probe>),
}

/// What a probe tells of its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// W/m².
    pub irradiance: Rgb,
    /// Harmonic mean distance to what is seen, metres.
    pub distance: f32,
    /// Standard error of the irradiance's mean channel, W/m².
    pub error: f32,
}

impl Probe {
    /// What it tells by now.
    pub fn told(&self) -> Told {
        Told { irradiance: self.irradiance, distance: self.distance, error: self.error }
    }

    /// What its first look told.
    pub fn told_first(&self) -> Told {
        self.first().told()
    }

    /// This, a rough probe, taken further by a full one of the same texel.
    pub fn refined(&self, full: Self) -> Self {
        Self { rays: self.rays + full.rays, care: Care::Refined(Box::new(self.clone())), ..full }
    }

    /// The probe as it was first.
    pub fn first(&self) -> &Self {
        match &self.care {
            Care::Refined(rough) => rough,
            _ => self,
        }
    }

    /// The one of two probes of a texel that was taken further; none if they cannot both be right.
    pub fn further<'a>(&'a self, other: &'a Self) -> Option<&'a Self> {
        match (&self.care, &other.care) {
            _ if self == other => Some(self),
            (Care::Refined(rough), Care::Rough) if **rough == *other => Some(self),
            (Care::Rough, Care::Refined(rough)) if **rough == *self => Some(other),
            _ => None,
        }
    }

    /// Gathers at `texel`. Rays start all over the texel's usable part, so that the value is its mean. Probes of one `set`
    /// look into the same directions.
    pub fn gather(source: &Source, footprint: &Footprint, texel: u32, set: u32, settings: &ProbeSettings) -> Self {
        let usable = footprint.usable(texel);
        let view = View { source, usable: &usable, screen: source.start(texel, Side::Front).screen };
        let lamps = source.direct(texel);
        let mut strata = Strata::new(settings.fewest.side(), set, source.groups());
        strata.fill(&view);
        let width = source.lit.surfels.extent(texel).sqrt();
        let is_gap = footprint.covered()[texel as usize] && strata.distance() < width;
        let settings = &if is_gap { settings.in_gap() } else { *settings };
        // What the eye compares is all the light at the texel, not the part gathered here.
        let allowed = |strata: &Strata, sent: f32| {
            settings.tolerance * settings.yardstick(PI * strata.mean() + lamps + sent) / PI
        };
        if allot(&strata.spread(), allowed(&strata, 0.0), settings.extra).iter().sum::<u32>() > DEMANDING {
            strata = strata.finer();
            strata.fill(&view);
        }
        if let Some(bright) = source.bright(texel) {
            let normal = usable.centre.shading_normal;
            for s in 0..strata.len() {
                // A stratum is wider than the directions that the guide tells apart.
                let is_bright = |inside: &Vec2| bright.contains(cosine_hemisphere(normal, strata.place(s, *inside)));
                if INSIDE.iter().any(is_bright) {
                    strata.look_closer(&view, s, LOOKS);
                }
            }
        }
        let mut groups = vec![Rgb::ZERO; source.groups()];
        let sent = source.sent_to(&usable, set, 0.5 * PI * allowed(&strata, 0.0), &mut groups);
        let tolerance = allowed(&strata, sent.irradiance.element_sum() / 3.0);
        for _ in 0..ROUNDS {
            let counts = allot(&strata.spread(), tolerance, settings.extra);
            for (s, &count) in counts.iter().enumerate() {
                strata.look_closer(&view, s, count);
            }
        }
        let variance: f32 =
            strata.spread().iter().zip(&strata.all).map(|(&spread, s)| spread * spread / s.count as f32).sum();
        strata.share_out(&mut groups);
        Self {
            irradiance: sent.irradiance + strata.irradiance(),
            groups: groups.into(),
            distance: strata.distance(),
            error: (PI * variance.sqrt() / strata.len() as f32).hypot(sent.error),
            rays: strata.rays + sent.rays,
            care: Care::Full,
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

/// The strata of one probe.
struct Strata {
    /// Along a side of the square.
    side: usize,
    /// Number of the directions.
    set: u32,
    all: Vec<Stratum>,
    /// Sums of radiance by light group, W/(m²·sr).
    groups: Grouped,
    /// Strata that have their first ray.
    filled: u32,
    /// Sum of inverse distances of first rays, 1/m.
    inverse: f32,
    /// Rays cast, turns included.
    rays: u32,
}

impl Strata {
    fn new(side: usize, set: u32, groups: usize) -> Self {
        let count = side * side;
        let (all, groups) = (vec![Stratum::default(); count], Grouped::new(groups, count));
        Self { side, set, all, groups, filled: 0, inverse: 0.0, rays: 0 }
    }

    fn len(&self) -> usize {
        self.all.len()
    }

    /// Harmonic mean distance to what first rays met, metres.
    fn distance(&self) -> f32 {
        self.filled as f32 / self.inverse.max(1e-12)
    }

    /// Point `i` of the first directions of a set; those of all sets together are as evenly spread.
    fn first(&self, i: u32) -> (Vec2, Vec2) {
        let (sequence, i) = (Sequence::new(0x9a7e), self.set * (FINE * FINE) as u32 + i);
        (sequence.first(i), sequence.second(i))
    }

    /// Casts the first rays that are lacking: so many points of the sequence as there are strata have one in each.
    fn fill(&mut self, view: &View) {
        for i in self.filled..self.len() as u32 {
            let (u, place) = self.first(i);
            let s = self.at(u);
            let seen = view.cast(u, place, 1.0 / self.len() as f32, self.groups.of_mut(s));
            self.all[s].add(seen.radiance);
            self.inverse += 1.0 / seen.distance.max(1e-6);
            self.rays += seen.rays;
        }
        self.filled = self.len() as u32;
    }

    /// The finer strata with the first rays cast so far.
    fn finer(&self) -> Self {
        let mut finer = Self::new(FINE, self.set, self.groups.groups());
        for i in 0..self.filled {
            let (u, _) = self.first(i);
            let (from, to) = (self.at(u), finer.at(u));
            finer.all[to] = self.all[from];
            finer.groups.of_mut(to).copy_from_slice(self.groups.of(from));
        }
        Self { filled: self.filled, inverse: self.inverse, rays: self.rays, ..finer }
    }

    /// Casts rays into stratum `s` until it has `count`.
    fn look_closer(&mut self, view: &View, s: usize, count: u32) {
        let sequence = Sequence::new(hash3(s as u32, self.set, 0x57a7));
        let share = 1.0 / (count as f32 * self.len() as f32);
        for i in self.all[s].count..count {
            let u = self.place(s, sequence.first(i));
            let seen = view.cast(u, sequence.second(i), share, self.groups.of_mut(s));
            self.all[s].add(seen.radiance);
            self.rays += seen.rays;
        }
    }

    /// The stratum that a point of the unit square lies in.
    fn at(&self, u: Vec2) -> usize {
        let index = |x: f32| ((x * self.side as f32) as usize).min(self.side - 1);
        index(u.y) * self.side + index(u.x)
    }

    /// The point of the unit square at place `inside` of stratum `s`.
    fn place(&self, s: usize, inside: Vec2) -> Vec2 {
        (Vec2::new((s % self.side) as f32, (s / self.side) as f32) + inside) / self.side as f32
    }

    /// Mean radiance, mean of channels.
    fn mean(&self) -> f32 {
        self.all.iter().map(Stratum::mean).sum::<f32>() / self.len() as f32
    }

    /// W/m².
    fn irradiance(&self) -> Rgb {
        self.all.iter().map(|s| s.sum / s.count as f32).sum::<Rgb>() * (PI / self.len() as f32)
    }

    /// Adds the irradiance by light group to `groups`, W/m².
    fn share_out(&self, groups: &mut [Rgb]) {
        for (s, stratum) in self.all.iter().enumerate() {
            let share = PI / (self.len() as f32 * stratum.count as f32);
            groups.iter_mut().zip(self.groups.of(s)).for_each(|(sum, &radiance)| *sum += radiance * share);
        }
    }

    /// Deviation to be expected inside each stratum.
    fn spread(&self) -> Vec<f32> {
        let means: Vec<f32> = self.all.iter().map(Stratum::mean).collect();
        let variances: Vec<f32> = self.all.iter().map(Stratum::variance).collect();
        spread(self.side, &means, &variances)
    }
}

/// Rays from one texel.
struct View<'a> {
    source: &'a Source<'a>,
    usable: &'a Usable<'a>,
    screen: Screen<'a>,
}

impl View<'_> {
    /// What lies in the direction that belongs to `u`. The ray stands for `share` of the view and starts where `place`
    /// says. Adds to the sums by light group, if there are any.
    fn cast(&self, u: Vec2, place: Vec2, share: f32, groups: &mut [Rgb]) -> Followed {
        let p = self.usable.point(place);
        let direction = cosine_hemisphere(p.shading_normal, u);
        if direction.dot(p.geometric_normal) <= 0.0 {
            return Followed { radiance: Rgb::ZERO, distance: f32::INFINITY, rays: 0 };
        }
        // Cosine-weighted rays stand for more of the view towards the horizon.
        let cosine = direction.dot(p.shading_normal).max(0.05);
        let solid_angle = share * PI / cosine;
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

/// Deviation to be expected inside each stratum, from the differences between its neighbours on opposite sides and from
/// the variance inside these.
fn spread(side: usize, radiance: &[f32], variance: &[f32]) -> Vec<f32> {
    let value = |x: i32, y: i32| {
        let inside = |v: i32| (0..side as i32).contains(&v);
        (inside(x) && inside(y)).then(|| y as usize * side + x as usize)
    };
    let of_stratum = |s: usize| {
        let (x, y) = ((s % side) as i32, (s / side) as i32);
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
    };
    (0..side * side).map(of_stratum).collect()
}

/// Rays per stratum, one at least, so that the standard error of their mean stays below `tolerance` with the fewest
/// rays: in proportion to the spread.
fn allot(spread: &[f32], tolerance: f32, extra: u32) -> Vec<u32> {
    let strata = spread.len();
    let total: f32 = spread.iter().sum();
    let wanted = total / (strata as f32 * tolerance.max(f32::MIN_POSITIVE)).powi(2);
    let most = (strata as u32 + extra) as f32 / total.max(f32::MIN_POSITIVE);
    spread.iter().map(|s| (wanted.min(most) * s).clamp(1.0, MOST).round() as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = FINE;
    const STRATA: usize = SIDE * SIDE;

    #[test]
    fn the_further_of_two_probes_of_a_texel_is_taken() {
        let full = Probe { irradiance: Rgb::ONE, error: 0.1, rays: 100, ..Probe::default() };
        let rough = Probe { irradiance: Rgb::splat(1.2), error: 0.3, rays: 20, care: Care::Rough, ..Probe::default() };
        let refined = rough.refined(full.clone());
        assert_eq!((refined.irradiance, refined.rays), (Rgb::ONE, 120));
        assert_eq!((refined.first(), refined.told_first(), refined.told()), (&rough, rough.told(), full.told()));
        assert_eq!(refined.further(&rough), Some(&refined));
        assert_eq!(rough.further(&refined), Some(&refined));
        assert_eq!(rough.further(&rough.clone()), Some(&rough));
        let other = Probe { irradiance: Rgb::splat(1.3), ..rough.clone() };
        assert_eq!(rough.further(&other), None);
        assert_eq!(other.further(&refined), None);
    }

    #[test]
    fn a_stratum_does_not_judge_itself() {
        let mut radiance = [1.0; STRATA];
        radiance[5 * SIDE + 7] = 100.0;
        let spread = spread(SIDE, &radiance, &[0.0; STRATA]);
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
        let spread = spread(SIDE, &radiance, &[0.0; STRATA]);
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
