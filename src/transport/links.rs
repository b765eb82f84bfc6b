//! Links: stored interactions between nodes, replayed by every iteration and by relighting.

use half::f16;

/// Form factors are stored times this, so that small ones keep their digits in half floats.
const SCALE: f32 = 32768.0;

/// An interaction as its receiver sees it. Eight bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// Source node.
    pub source: u32,
    form_factor: f16,
    visibility: f16,
}

impl Link {
    /// A link to node `source` with unoccluded form factor 0..1 and visibility 0..1.
    pub fn new(source: u32, form_factor: f32, visibility: f32) -> Self {
        let form_factor = f16::from_f32((form_factor * SCALE).min(f16::MAX.to_f32()));
        Self { source, form_factor, visibility: f16::from_f32(visibility) }
    }

    /// Form factor times visibility: irradiance received per radiosity of the source.
    pub fn weight(&self) -> f32 {
        self.form_factor.to_f32() * self.visibility.to_f32() * (1.0 / SCALE)
    }
}

/// All links, by receiver.
#[derive(Clone, Debug, Default)]
pub struct Links {
    /// Start of each receiver node's run; one more entry than nodes.
    pub first: Vec<u32>,
    /// Links, receiver by receiver.
    pub links: Vec<Link>,
}

impl Links {
    /// Sorts exchanges `(a, b, kernel, visibility)` to both their receivers. `kernel` is the mean point-to-point
    /// kernel in 1/m², so that F_ab = kernel·A_b and reciprocity holds by construction.
    pub fn from_exchanges(areas: &[f32], exchanges: &[(u32, u32, f32, f32)]) -> Self {
        let mut first = vec![0u32; areas.len() + 1];
        for &(a, b, ..) in exchanges {
            first[a as usize + 1] += 1;
            first[b as usize + 1] += 1;
        }
        for i in 1..first.len() {
            first[i] += first[i - 1];
        }
        let mut next = first.clone();
        let mut links = vec![Link::new(0, 0.0, 0.0); exchanges.len() * 2];
        for &(a, b, kernel, visibility) in exchanges {
            for (receiver, source) in [(a, b), (b, a)] {
                let slot = &mut next[receiver as usize];
                links[*slot as usize] = Link::new(source, kernel * areas[source as usize], visibility);
                *slot += 1;
            }
        }
        Self { first, links }
    }

    /// Links of a receiver.
    pub fn of(&self, receiver: u32) -> &[Link] {
        let r = receiver as usize;
        &self.links[self.first[r] as usize..self.first[r + 1] as usize]
    }

    /// Number of links.
    pub fn len(&self) -> usize {
        self.links.len()
    }

    /// True if nothing exchanges light.
    pub fn is_empty(&self) -> bool {
        self.links.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_directions_are_reciprocal() {
        let areas = [2.0, 5.0, 0.01];
        let links = Links::from_exchanges(&areas, &[(0, 1, 0.03, 0.5), (2, 0, 0.2, 1.0)]);
        assert_eq!(size_of::<Link>(), 8);
        for r in 0..3 {
            for l in links.of(r) {
                let back = links.of(l.source).iter().find(|b| b.source == r).expect("stored both ways");
                let (ab, ba) = (areas[r as usize] * l.weight(), areas[l.source as usize] * back.weight());
                assert!((ab / ba - 1.0).abs() < 2e-3, "{ab} {ba}");
            }
        }
        assert!((links.of(0)[0].weight() - 0.075).abs() < 1e-4);
    }
}
