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

/// Sources that are estimated together.
const LANES: usize = 8;

/// The bright elements of a scene.
pub(super) struct Secondary {
    /// Element of every source.
    elements: Vec<u32>,
    blocks: Vec<Block>,
    /// Source of every element.
    index: Vec<u32>,
}

/// [`LANES`] sources, number by number: a receiver asks all of them what they would bring, which is most of the work.
#[derive(Clone, Default)]
struct Block {
    /// Centres, metres.
    centre: [[f32; LANES]; 3],
    radius: [f32; LANES],
    /// Mean normals, unit.
    normal: [[f32; LANES]; 3],
    /// Sine of the largest angle to it among the source's normals; 1 from 90° on.
    bend: [f32; LANES],
    /// Radiance × area, mean of channels, W/sr; zero where there is no source.
    strength: [f32; LANES],
}

impl Block {
    /// True if source `lane` is sent to a receiver at `p`.
    fn is_sent(&self, lane: usize, p: Vec3) -> bool {
        let centre = Vec3::from_array(self.centre.map(|axis| axis[lane]));
        centre.distance_squared(p) > (NEAR * self.radius[lane]).powi(2)
    }

    /// About what each brings to a receiver if nothing blocks, W/m²; zero only if it brings nothing.
    fn estimates(&self, &Receiver { position: p, normal: n, bend }: &Receiver) -> [f32; LANES] {
        let ([cx, cy, cz], [nx, ny, nz]) = (&self.centre, &self.normal);
        let mut brings = [0.0; LANES];
        for i in 0..LANES {
            let (x, y, z) = (cx[i] - p.x, cy[i] - p.y, cz[i] - p.z);
            let d2 = x * x + y * y + z * z;
            let near = NEAR * self.radius[i];
            let inverse = 1.0 / d2.sqrt();
            // Some of it may face the receiver although its middle does not.
            let blur = self.radius[i] * inverse;
            let receives = (n.x * x + n.y * y + n.z * z) * inverse + blur + bend;
            let sends = self.bend[i] + blur - (nx[i] * x + ny[i] * y + nz[i] * z) * inverse;
            let facing = receives.clamp(0.0, 1.0) * sends.clamp(0.0, 1.0);
            let estimate = self.strength[i] * facing * (inverse * inverse);
            brings[i] = if d2 > near * near { estimate } else { 0.0 };
        }
        brings
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
pub(super) struct Senders<'a> {
    secondary: &'a Secondary,
    receiver: Receiver,
    /// Draws blocks.
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
        let mut blocks = vec![Block::default(); chosen.len().div_ceil(LANES)];
        for (i, &element) in chosen.iter().enumerate() {
            index[element as usize] = i as u32;
            let node = &tree.nodes[tree.elements[element as usize].node as usize];
            let (block, lane) = (&mut blocks[i / LANES], i % LANES);
            let (centre, normal) = (node.centre(), node.axis);
            for axis in 0..3 {
                block.centre[axis][lane] = centre[axis];
                block.normal[axis][lane] = normal[axis];
            }
            block.radius[lane] = node.radius();
            block.bend[lane] = if node.cone < FRAC_PI_2 { node.cone.sin() } else { 1.0 };
            block.strength[lane] = level(element as usize) * node.area;
        }
        Self { elements: chosen, blocks, index }
    }

    /// True if `element` is sent to receivers at `p`, so that their rays must not count it.
    pub(super) fn is_sent(&self, element: u32, p: Vec3) -> bool {
        match self.index.get(element as usize) {
            Some(&i) if i != NONE => self.blocks[i as usize / LANES].is_sent(i as usize % LANES, p),
            _ => false,
        }
    }

    /// The sources that a receiver may see.
    pub(super) fn senders(&self, receiver: Receiver) -> Senders<'_> {
        let brings = |block: &Block| f64::from(block.estimates(&receiver).iter().sum::<f32>());
        let draw = Distribution::new(self.blocks.iter().map(brings));
        Senders { secondary: self, receiver, draw }
    }
}

impl Senders<'_> {
    /// About what all of them bring if nothing blocks, W/m².
    pub(super) fn total(&self) -> f32 {
        self.draw.total() as f32
    }

    /// A surfel drawn by `u` in 0..1 from what the receiver may see, where `radiance` is what a surfel's side on an
    /// element sends, mean of channels; none if the element sends nothing.
    pub(super) fn draw(
        &self,
        tree: &Hierarchy,
        surfels: &Surfels,
        radiance: impl Fn(u32, Side, u32) -> f32,
        u: f32,
    ) -> Option<Sender> {
        let (block, within) = self.draw.draw(u);
        let lanes = Distribution::new(self.secondary.blocks[block].estimates(&self.receiver).map(f64::from));
        let (lane, within) = lanes.draw(within);
        let chance = self.draw.chance(block) * lanes.chance(lane);
        let index = *self.secondary.elements.get(block * LANES + lane)?;
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
        let area = surfels.area(surfel) * total / (power * chance as f32);
        Some(Sender { element: index, surfel, side: element.side, area })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_bring_what_a_small_patch_does_and_nothing_from_behind_or_close_by() {
        let mut block = Block::default();
        // Two metres above the receiver: facing it, turned away, and so large that it is near.
        for (lane, (radius, normal)) in [(0.01, -1.0), (0.01, 1.0), (1.0, -1.0)].into_iter().enumerate() {
            block.centre[1][lane] = 2.0;
            (block.radius[lane], block.normal[1][lane], block.strength[lane]) = (radius, normal, 3.0);
        }
        let receiver = Receiver { position: Vec3::ZERO, normal: Vec3::Y, bend: 0.0 };
        let brings = block.estimates(&receiver);
        assert!((brings[0] - 0.75).abs() < 1e-6, "{brings:?}");
        assert_eq!(brings[1..], [0.0; LANES - 1]);
        assert_eq!([0, 1, 2].map(|lane| block.is_sent(lane, receiver.position)), [true, true, false]);
    }
}
