//! Secondary sources: surfaces lit so brightly that they are sent to probes like lamps, not found by their rays.
//!
//! A patch of sun on the floor or the walls of a skylight's shaft light whole rooms and fill little of the view from
//! anywhere in them. Rays that look all around find them by chance; rays that are aimed at them do not miss them.
//! Based on: Shirley, Wang, Zimmerman, "Monte Carlo Techniques for Direct Lighting Calculations", 1996 (sources drawn by
//! an estimate of what they bring).

use crate::hierarchy::{Hierarchy, Side, Surfels};
use crate::math::Distribution;
use crate::scene::Rgb;
use glam::Vec3;
use std::f32::consts::FRAC_PI_2;

/// Times the mean radiance from which on an element is a source of its own.
const BRIGHT: f32 = 4.0;
/// Share of the scene's surface that such sources may be.
const MOST_AREA: f32 = 0.1;
/// Most of them.
const MOST: usize = 4096;
/// Radii of an element from which on it is sent: nearer ones fill enough of the view to be found.
const NEAR: f32 = 4.0;
/// Stands for an element that is no source.
const NONE: u32 = u32::MAX;

/// The bright elements of a scene.
pub(super) struct Secondary {
    sources: Vec<Bright>,
    /// Source of every element.
    index: Vec<u32>,
}

/// One bright element.
#[derive(Clone, Copy)]
struct Bright {
    element: u32,
    centre: Vec3,
    radius: f32,
    /// Mean normal, unit.
    normal: Vec3,
    /// Sine of the largest angle to it among its normals; 1 from 90° on.
    bend: f32,
    /// Radiance × area, mean of channels, W/sr.
    strength: f32,
}

impl Bright {
    /// True if it is sent to a receiver at `p`.
    fn is_sent(&self, p: Vec3) -> bool {
        self.centre.distance_squared(p) > (NEAR * self.radius).powi(2)
    }

    /// About what it brings to a receiver if nothing blocks, W/m²; zero only if it brings nothing.
    fn estimate(&self, &Receiver { position: p, normal: n, bend }: &Receiver) -> f32 {
        let v = self.centre - p;
        let d2 = v.length_squared();
        if d2 <= (NEAR * self.radius).powi(2) {
            return 0.0;
        }
        let d = d2.sqrt();
        // Some of it may face the receiver although its middle does not.
        let blur = self.radius / d;
        let cosine = |c: f32, bend: f32| (c / d + blur + bend).clamp(0.0, 1.0);
        self.strength * cosine(n.dot(v), bend) * cosine(-self.normal.dot(v), self.bend) / d2
    }
}

/// A texel that sources are sent to.
pub(super) struct Receiver {
    pub(super) position: Vec3,
    /// Unit.
    pub(super) normal: Vec3,
    /// Sine of the largest angle to it among the texel's normals.
    pub(super) bend: f32,
}

/// The sources as one receiver sees them.
pub(super) struct Senders {
    draw: Distribution,
}

/// A point of a source that was drawn.
pub(super) struct Sender {
    pub(super) element: u32,
    pub(super) surfel: u32,
    pub(super) side: Side,
    /// Area that the point stands for, m².
    pub(super) area: f32,
}

impl Secondary {
    /// Picks the elements that stand out by their `radiance`, W/(m²·sr).
    pub(super) fn new(tree: &Hierarchy, radiance: &[Rgb]) -> Self {
        let area = |e: usize| tree.nodes[tree.elements[e].node as usize].area;
        let level = |e: usize| radiance[e].element_sum() / 3.0;
        let total: f32 = (0..radiance.len()).map(area).sum();
        let mean = (0..radiance.len()).map(|e| level(e) * area(e)).sum::<f32>() / total.max(f32::MIN_POSITIVE);
        let mut order: Vec<u32> = (0..radiance.len() as u32).filter(|&e| level(e as usize) > BRIGHT * mean).collect();
        order.sort_by(|&a, &b| level(b as usize).total_cmp(&level(a as usize)).then(a.cmp(&b)));
        let mut left = MOST_AREA * total;
        let mut chosen: Vec<u32> = order
            .into_iter()
            .take(MOST)
            .take_while(|&e| {
                left -= area(e as usize);
                left >= 0.0
            })
            .collect();
        // Neighbours in the tree follow one another, so that draws by evenly spread numbers are spread in space.
        chosen.sort_unstable();
        let mut index = vec![NONE; radiance.len()];
        let sources: Vec<Bright> = chosen
            .iter()
            .enumerate()
            .map(|(i, &element)| {
                index[element as usize] = i as u32;
                let node = &tree.nodes[tree.elements[element as usize].node as usize];
                let strength = level(element as usize) * node.area;
                let bend = if node.cone < FRAC_PI_2 { node.cone.sin() } else { 1.0 };
                Bright { element, centre: node.centre(), radius: node.radius(), normal: node.axis, bend, strength }
            })
            .collect();
        Self { sources, index }
    }

    /// True if `element` is sent to receivers at `p`, so that their rays must not count it.
    pub(super) fn is_sent(&self, element: u32, p: Vec3) -> bool {
        match self.index.get(element as usize) {
            Some(&i) if i != NONE => self.sources[i as usize].is_sent(p),
            _ => false,
        }
    }

    /// The sources that a receiver may see.
    pub(super) fn senders(&self, receiver: &Receiver) -> Senders {
        Senders { draw: Distribution::new(self.sources.iter().map(|s| f64::from(s.estimate(receiver)))) }
    }

    /// A surfel drawn by `u` in 0..1 from what a receiver may see, where `radiance` is what a surfel's side on an
    /// element sends, mean of channels; none if the element sends nothing.
    pub(super) fn draw(
        &self,
        tree: &Hierarchy,
        surfels: &Surfels,
        radiance: impl Fn(u32, Side, u32) -> f32,
        senders: &Senders,
        u: f32,
    ) -> Option<Sender> {
        let (source, within) = senders.draw.draw(u);
        let index = self.sources[source].element;
        let element = &tree.elements[index as usize];
        // Shadows may cut an element: its surfels are drawn by what they send.
        let power = |s: u32| surfels.area(s) * radiance(s, element.side, index);
        let total: f32 = element.surfels.clone().map(power).sum();
        let mut left = within * total;
        let mut drawn = None;
        for surfel in element.surfels.clone() {
            let power = power(surfel);
            if power > 0.0 {
                drawn = Some((surfel, power));
            }
            left -= power;
            if left < 0.0 {
                break;
            }
        }
        let (surfel, power) = drawn?;
        let area = surfels.area(surfel) * total / (power * senders.draw.chance(source) as f32);
        Some(Sender { element: index, surfel, side: element.side, area })
    }
}

impl Senders {
    /// About what all of them bring if nothing blocks, W/m².
    pub(super) fn total(&self) -> f32 {
        self.draw.total() as f32
    }
}
