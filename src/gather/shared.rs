//! What texels see of the sky through openings, put together with what those around see: few rays of each are enough
//! where all of them see the same part of it.

use super::alike::FEWEST;
use super::look::{CHUNK, FEW, Look, NEXT};
use super::visibility::{Seen, Visibility};
use crate::math::{Known, PlaneFit, nearness};
use crate::progress::Cancelled;
use crate::scene::Rgb;
use rayon::prelude::*;
use std::sync::atomic::Ordering;

/// Share of what is seen that must be more than noise for a texel to look again.
const DETAIL: f32 = 0.4;

/// What a texel sees of a lamp together with those around.
struct Together {
    /// Unblocked share per channel.
    share: Rgb,
    /// Of its mean channel.
    variance: f32,
    /// How much of its own look is more than noise, 0..=1.
    detail: f32,
}

impl Look<'_> {
    /// What texels see that share it, with its variance. Looks again with all rays where those around do not explain it.
    pub(super) fn shared(&self, seen: &mut [Visibility], free: &[Rgb]) -> Result<Vec<(u32, Rgb, f32)>, Cancelled> {
        if !self.lamps.is_sky(self.lamp) {
            return Ok(Vec::new());
        }
        let all: Vec<u32> = (0..seen.len() as u32).collect();
        let of_chunk = |texels: &[u32]| {
            let shared = texels.iter().filter(|&&t| seen[t as usize].seen() == Seen::Part && self.is_shared(t));
            let shared = shared.filter_map(|&t| Some((t, self.together(seen, t)?))).collect::<Vec<_>>();
            self.counter.advance(0).map(|()| shared)
        };
        let found: Vec<(u32, Together)> =
            all.par_chunks(CHUNK).map(of_chunk).collect::<Result<Vec<_>, Cancelled>>()?.into_iter().flatten().collect();
        let (detailed, smooth): (Vec<_>, Vec<_>) = found.into_iter().partition(|(_, found)| found.detail > DETAIL);
        let chunk = |texels: &[(u32, Together)]| {
            let mut cast = 0;
            let again = |&(t, _): &(u32, Together)| {
                let mut look = seen[t as usize];
                if let Some(test) = self.tester(t) {
                    cast += test(self.penumbra(t, free[t as usize], &look), &mut look);
                }
                (t, look)
            };
            let looked: Vec<(u32, Visibility)> = texels.iter().map(again).collect();
            self.rays.fetch_add(cast, Ordering::Relaxed);
            self.counter.advance(0).map(|()| looked)
        };
        let looked: Vec<Vec<_>> = detailed.par_chunks(FEW).map(chunk).collect::<Result<_, Cancelled>>()?;
        looked.into_iter().flatten().for_each(|(t, look)| seen[t as usize] = look);
        Ok(smooth.into_iter().map(|(t, found)| (t, found.share, found.variance)).collect())
    }

    /// What a texel and those around see together, if there are enough that look through the same openings.
    fn together(&self, seen: &[Visibility], texel: u32) -> Option<Together> {
        let lamp = |t: u32| self.lamps.get(self.lamp, &self.footprint.centre(t)).map(std::ptr::from_ref);
        let own = lamp(texel);
        let (looks, known): (Vec<&Visibility>, Vec<Known>) = self
            .alike()
            .around(texel, NEXT as i32)
            .filter(|&(n, _)| seen[n as usize].tried > 0 && lamp(n) == own)
            .map(|(n, at)| {
                let look = &seen[n as usize];
                // One ray fewer may have missed it, or one more met it.
                let least = (0.5 / look.tried as f32).powi(2);
                let value = look.share().element_sum() / 3.0;
                let known =
                    Known { at, value, variance: look.chance().max(least), nearness: nearness(at, NEXT as i32) };
                (look, known)
            })
            .unzip();
        let fit = (known.len() >= FEWEST).then(|| PlaneFit::new(&known))?;
        let plane: Rgb = looks.iter().zip(&fit.weights).map(|(look, &w)| look.share() * w).sum();
        let (detail, own) = (fit.detail(), &seen[texel as usize]);
        let share = (plane + (own.share() - plane) * detail).clamp(Rgb::ZERO, Rgb::ONE);
        let left = (own.chance() - fit.variance).max(0.0);
        Some(Together { share, variance: fit.variance + detail * detail * left, detail })
    }
}
