//! Where bright things are seen from: so that a sliver of sky between two shelves is looked for where neighbours saw it.
//!
//! One ray per stratum misses what is bright and narrow, and nothing in a probe's own rays says so. The rays of the first
//! bounce, of all elements around, do.
//! Based on the idea of: Jensen, "Importance Driven Path Tracing using the Photon Map", 1995 (directions worth a look are
//! learned from what was found nearby).

use crate::hierarchy::Hierarchy;
use crate::math::octahedral;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Bins along a side of the octahedral map of directions.
const SIDE: usize = 32;
/// Elements that share what they saw, at most.
const GROUP: usize = 64;
/// Times the mean radiance from which on a ray is worth a closer look.
const HOT: f32 = 10.0;

/// One bit per direction bin.
type Bins = [u32; SIDE * SIDE / 32];

/// Bright directions per group of neighbouring elements.
#[derive(Serialize, Deserialize)]
pub struct Guide {
    /// Group of every element.
    group: Vec<u32>,
    hot: Vec<Bins>,
}

/// A ray that was cast: unit direction, and mean radiance over the channels in W/(m²·sr).
pub(super) type Glance = (Vec3, f32);

impl Guide {
    /// Neighbouring elements that share a group, in their order.
    pub fn groups(tree: &Hierarchy) -> Vec<Range<u32>> {
        let mut groups = Vec::new();
        let mut node = 0;
        while let Some(n) = tree.nodes.get(node as usize) {
            if n.elements.len() <= GROUP {
                groups.push(n.elements.clone());
                node = n.skip;
            } else {
                node += 1;
            }
        }
        groups
    }

    /// `hot` belongs to `groups`.
    pub fn new(groups: &[Range<u32>], hot: Vec<Bins>) -> Self {
        let group = groups.iter().enumerate().flat_map(|(g, r)| std::iter::repeat_n(g as u32, r.len())).collect();
        Self { group, hot }
    }

    /// The bright directions among the rays of one group.
    pub fn bright(glances: &[Glance]) -> Bins {
        let limit = HOT * glances.iter().map(|g| g.1).sum::<f32>() / glances.len().max(1) as f32;
        let mut bins = Bins::default();
        for &(direction, radiance) in glances {
            if radiance > limit {
                let bin = bin(direction);
                bins[bin / 32] |= 1 << (bin % 32);
            }
        }
        bins
    }

    /// What was bright around `element`.
    pub fn around(&self, element: u32) -> Bright<'_> {
        Bright(&self.hot[self.group[element as usize] as usize])
    }
}

/// Bright directions around one place.
#[derive(Clone, Copy)]
pub struct Bright<'a>(&'a Bins);

impl Bright<'_> {
    /// True if something bright was seen about there.
    pub fn contains(&self, direction: Vec3) -> bool {
        let bin = bin(direction);
        self.0[bin / 32] >> (bin % 32) & 1 == 1
    }
}

fn bin(direction: Vec3) -> usize {
    let p = octahedral(direction) * SIDE as f32;
    let index = |x: f32| (x as usize).min(SIDE - 1);
    index(p.y) * SIDE + index(p.x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_stands_out_is_bright() {
        let mut glances: Vec<Glance> =
            (0..100).map(|i| (Vec3::new(i as f32 - 50.0, 30.0, 10.0).normalize(), 1.0)).collect();
        assert_eq!(Guide::bright(&glances), Bins::default());
        let sun = Vec3::new(0.1, 0.2, -0.9).normalize();
        glances.push((sun, 50.0));
        let bins = Guide::bright(&glances);
        assert!(Bright(&bins).contains(sun));
        assert!(!Bright(&bins).contains(Vec3::Y));
    }
}
