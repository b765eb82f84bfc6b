//! Rough probes: where probes are close, each casts few rays and shares what it knows with those around. Probes → what
//! stands for them in the end.
//!
//! Which directions rough probes look into repeats every [`PERIOD`] texels along both axes, so that a plane fitted to a
//! texel and its neighbours has the rays of all sets in it and shows no pattern. Where the plane misses the probes by more
//! than their noise there is detail, and the probe counts itself.
//! Based on: Keller and Heidrich, "Interleaved Sampling", 2001.

use super::fill::Finished;
use super::{CLOSE, Care, NO_PROBE, Probe, State};
use crate::atlas::NO_TEXEL;
use crate::gather::alike::{Alike, FEWEST};
use crate::gather::tally::share_out;
use crate::math::{Known, PlaneFit, nearness};
use crate::progress::{Cancelled, Progress};
use crate::scene::Rgb;
use rayon::prelude::*;

/// Times the standard error of other probes that rough ones may have.
const ROUGH: f32 = 2.5;
/// Texels along each axis after which sets of directions repeat.
const PERIOD: u16 = 3;
/// Share of what is found that must be more than noise for a probe to be refined.
const DETAIL: f32 = 0.4;
/// Texels up to which others are looked for.
const WIDEST: i32 = 12;
/// Share of the allowed error that every probe is taken to have at least.
const LEAST: f32 = 0.25;

impl State<'_> {
    /// A probe at a texel, a rough one or not.
    pub(super) fn gathered(&self, texel: u32, is_rough: bool) -> Probe {
        let Self { source, footprint, settings, .. } = *self;
        if !is_rough {
            return Probe::gather(source, footprint, texel, 0, &settings.probe);
        }
        let [x, y] = self.texels.pixel[texel as usize].map(|v| u32::from(v % PERIOD));
        let probe = Probe::gather(source, footprint, texel, y * u32::from(PERIOD) + x, &settings.probe.rough(ROUGH));
        Probe { care: Care::Rough, ..probe }
    }

    /// True if a texel is like enough to those around for its first probe to be rough.
    pub(super) fn is_rough(&self, texel: u32) -> bool {
        self.alike().is_shared(texel)
    }

    fn alike(&self) -> Alike<'_> {
        Alike { atlas: self.atlas, texels: self.texels, footprint: self.footprint }
    }

    /// Finds what stands for the rough probes, now that all cells are known. Refines those that others do not explain.
    pub(super) fn smooth(
        &mut self,
        cells: &[Finished],
        look: &mut dyn FnMut(&State),
        progress: &dyn Progress,
    ) -> Result<(), Cancelled> {
        let mut reach = vec![1u8; self.probes.len()];
        for Finished { cell, corners, .. } in
            cells.iter().filter(|f| f.cell.size() <= CLOSE && f.corners[0] != NO_TEXEL)
        {
            for &corner in corners {
                let reach = &mut reach[self.probe_of[corner as usize] as usize];
                *reach = (*reach).max(cell.size() as u8);
            }
        }
        let rough = self.probes.par_iter().zip(reach).enumerate().filter(|(_, ((_, p), _))| p.care == Care::Rough);
        let found: Vec<(u32, Option<Probe>)> =
            rough.map(|(i, (&(t, _), reach))| (i as u32, self.smoothed(t, reach.into()))).collect();
        let alone = found.iter().filter(|(_, smoothed)| smoothed.is_none()).map(|&(i, _)| self.probes[i as usize].0);
        self.refine(alone.collect::<Vec<_>>().into_iter(), look, progress)?;
        self.smoothed = found.into_iter().filter_map(|(i, smoothed)| Some((i, smoothed?))).collect();
        Ok(())
    }

    /// What a rough probe and those around say together of its texel, if they are enough and explain it.
    fn smoothed(&self, texel: u32, reach: i32) -> Option<Probe> {
        let own = self.probe(texel);
        let value = |p: &Probe| p.irradiance.element_sum() / 3.0;
        let settings = &self.settings.probe;
        let least = LEAST * settings.tolerance * settings.yardstick(value(own) + self.source.direct(texel));
        let around = |reach: i32| -> (Vec<&Probe>, Vec<Known>) {
            let found = self.alike().around(texel, reach).filter(|(n, _)| self.probe_of[*n as usize] != NO_PROBE);
            let known = found.map(|(n, at)| {
                let p = self.probe(n);
                let variance = p.error.max(least).powi(2);
                (p, Known { at, value: value(p), variance, nearness: nearness(at, reach) })
            });
            known.unzip()
        };
        // Beside large cells the next ones are farther away.
        let mut wider =
            std::iter::successors(Some(reach), |reach| Some(2 * reach)).take_while(|&reach| reach <= WIDEST);
        let (probes, known) = wider.find_map(|reach| Some(around(reach)).filter(|(_, known)| known.len() >= FEWEST))?;
        let fit = PlaneFit::new(&known);
        let detail = fit.detail();
        if detail > DETAIL {
            return None;
        }
        let mix = |value: &dyn Fn(&Probe) -> Rgb| {
            let plane: Rgb = probes.iter().zip(&fit.weights).map(|(p, &w)| value(p) * w).sum();
            (plane + (value(own) - plane) * detail).max(Rgb::ZERO)
        };
        let irradiance = mix(&|p| p.irradiance);
        let mut groups: Box<[Rgb]> = (0..own.groups.len()).map(|g| mix(&|p| p.groups[g])).collect();
        share_out(irradiance, &mut groups);
        let left = (own.error.max(least).powi(2) - fit.variance).max(0.0);
        let error = (fit.variance + detail * detail * left).sqrt();
        Some(Probe { irradiance, groups, error, ..own.clone() })
    }
}
