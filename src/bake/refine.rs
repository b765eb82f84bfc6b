//! Which parts of a lightmap to gather again once an audit has found it worse than wanted.
//!
//! The audit that chooses them never judges them: the next one draws other texels and other paths. What is spent is
//! bounded by what the bake has cost: at most [`ROUNDS`] times, and together no more rays than before the first audit,
//! as far as can be foretold.

use super::observer::Refinement;
use crate::audit::{Audit, Verdict};
use crate::gather::Probe;
use crate::output::report::RefinementFacts;
use std::ops::Range;

/// Most refinements of one bake.
pub(super) const ROUNDS: usize = 2;
/// Each aims for this share of the error that the one before aimed for.
const STEP: f32 = 0.5;
/// Times the rays for half the error.
const COST: f64 = 4.0;
/// Share of the squared error that it takes away.
const GAIN: f64 = 0.75;
/// Share of the target that is aimed for, so that the next audit has room to be certain.
const MARGIN: f64 = 0.8;

/// Rays that the bake has cast for every texel.
pub(super) struct Costs {
    /// Those of all texels before each; one more entry than texels.
    before: Vec<f64>,
}

impl Costs {
    /// Of so many texels, from the probes among them; the rest of `rays` is shared evenly.
    pub(super) fn new(texels: usize, probes: &[(u32, Probe)], rays: u64) -> Self {
        let gathered: f64 = probes.iter().map(|(_, probe)| f64::from(probe.rays)).sum();
        let mut before = vec![0.0; texels + 1];
        before[1..].fill((rays as f64 - gathered).max(0.0) / texels.max(1) as f64);
        probes.iter().for_each(|(texel, probe)| before[*texel as usize + 1] += f64::from(probe.rays));
        for i in 1..before.len() {
            before[i] += before[i - 1];
        }
        Self { before }
    }

    fn of(&self, tile: &Range<u32>) -> f64 {
        self.before[tile.end as usize] - self.before[tile.start as usize]
    }

    fn texels(&self) -> usize {
        self.before.len() - 1
    }
}

/// The tiles that bring the most error for what they cost, until what is left meets the target or a `budget` of rays is
/// spent. None if the target is met or nothing can be done. `round` counts from 0.
pub(super) fn worst_tiles(audit: &Audit, costs: &Costs, round: usize, budget: f64) -> Option<Refinement> {
    let is_met = match audit.verdict {
        Verdict::Met => true,
        Verdict::Uncertain => audit.error.value <= audit.target,
        Verdict::Missed => false,
    };
    if is_met || round >= ROUNDS {
        return None;
    }
    let mut tiles = audit.tiles(costs.texels());
    let mut left = audit.error.value.powi(2) - (MARGIN * audit.target).powi(2);
    let density = |t: &(Range<u32>, f64)| t.1 / costs.of(&t.0).max(1.0);
    tiles.sort_by(|a, b| density(b).total_cmp(&density(a)));
    let mut budget = budget;
    let worst = tiles.into_iter().take_while(|(tile, square)| {
        let is_wanted = left > 0.0 && *square > 0.0;
        left -= GAIN * square;
        budget -= COST.powi(round as i32 + 1) * costs.of(tile);
        is_wanted && budget >= 0.0
    });
    let mut tiles: Vec<_> = worst.map(|(tile, _)| tile).collect();
    tiles.sort_by_key(|tile| tile.start);
    let error = audit.target as f32 * STEP.powi(round as i32 + 1);
    (!tiles.is_empty()).then_some(Refinement { tiles, error })
}

/// What the report says of a `refinement` of a lightmap of so many texels, after `audit`.
pub(super) fn refined_facts(refinement: &Refinement, audit: &Audit, texels: usize) -> RefinementFacts {
    let chosen: usize = refinement.tiles.iter().map(|tile| tile.len()).sum();
    // Through text, so that 0.01 does not become 0.009999999776482582.
    let aim = refinement.error.to_string().parse().unwrap_or_else(|_| f64::from(refinement.error));
    RefinementFacts { error_before: audit.error, texels: chosen as f64 / texels.max(1) as f64, aim }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::{AuditedTexel, ESTIMATES, Estimate};
    use crate::scene::Rgb;

    /// An audit of every tenth of 1000 texels, the last hundred of which are off by `off`.
    fn audited(off: f32, target: f64, verdict: Verdict) -> Audit {
        let texel = |i: u32| AuditedTexel {
            texel: 10 * i,
            instance: 0,
            page: 0,
            pixel: [0, 0],
            weight: 10.0,
            baked: Rgb::splat(if i < 90 { 1.0 } else { 1.0 + off }),
            estimates: [Rgb::ONE; ESTIMATES],
        };
        let value = f64::from(off) * 0.1f64.sqrt();
        let error = Estimate { value, low: value, high: value };
        Audit {
            target,
            verdict,
            error,
            bias: error,
            median: None,
            p95: None,
            rounds: 1,
            paths_per_texel: 1,
            rays: 0,
            population: 1000,
            audited: 100,
            objects: Vec::new(),
            texels: (0..100).map(texel).collect(),
        }
    }

    /// One ray for each of 1000 texels.
    fn costs() -> Costs {
        Costs::new(1000, &[], 1000)
    }

    #[test]
    fn texels_with_probes_cost_more() {
        let probe = Probe { rays: 50, ..Probe::default() };
        let costs = Costs::new(10, &[(3, probe.clone()), (9, probe)], 200);
        assert_eq!((costs.of(&(0..3)), costs.of(&(3..4)), costs.of(&(0..10))), (30.0, 60.0, 200.0));
    }

    #[test]
    fn the_worst_tiles_are_chosen_and_no_others() {
        let refinement =
            worst_tiles(&audited(0.3, 0.02, Verdict::Missed), &costs(), 0, 1000.0).expect("the target was missed");
        assert_eq!(refinement.error, 0.01);
        assert!(refinement.tiles.iter().all(|tile| tile.start >= 880), "{:?}", refinement.tiles);
        let chosen: usize = refinement.tiles.iter().map(|tile| tile.len()).sum();
        assert!((100..=130).contains(&chosen), "{chosen}");
        let second = worst_tiles(&audited(0.3, 0.02, Verdict::Missed), &costs(), 1, 1000.0).expect("once more");
        assert_eq!(second.error, 0.005);
    }

    #[test]
    fn the_budget_bounds_them() {
        let some = worst_tiles(&audited(0.3, 0.02, Verdict::Missed), &costs(), 0, 400.0).expect("there is a budget");
        let chosen: usize = some.tiles.iter().map(|tile| tile.len()).sum();
        assert!(chosen > 0 && COST * chosen as f64 <= 400.0, "{chosen}");
        assert!(worst_tiles(&audited(0.3, 0.02, Verdict::Missed), &costs(), 0, 10.0).is_none());
        assert!(worst_tiles(&audited(0.3, 0.02, Verdict::Missed), &costs(), ROUNDS, 1000.0).is_none());
    }

    #[test]
    fn what_is_met_stays() {
        assert!(worst_tiles(&audited(0.03, 0.02, Verdict::Met), &costs(), 0, 1000.0).is_none());
        assert!(worst_tiles(&audited(0.03, 0.02, Verdict::Uncertain), &costs(), 0, 1000.0).is_none());
        assert!(worst_tiles(&audited(0.3, 0.02, Verdict::Uncertain), &costs(), 0, 1000.0).is_some());
    }
}
