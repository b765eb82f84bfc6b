//! From a cell and what its probes tell to the irradiance of its texels.

use super::blend::Blend;
use super::judge::Verdict;
use super::{Cell, Look, NO_PROBE, Rect, State, split};
use crate::atlas::NO_TEXEL;
use crate::gather::tally::{Grouped, share_out};
use crate::scene::Rgb;
use glam::Vec2;

/// Mean over a cell of the square of an error that is one in its middle and falls to none at its corners.
const SAG: f32 = 0.28;

pub(super) enum Outcome {
    Split(Vec<Cell>),
    Done(Finished),
}

/// A cell that needs no further cut.
pub(super) struct Finished {
    pub(super) cell: Cell,
    pub(super) corners: [u32; 4],
    /// The texel in its middle that was asked, if one was.
    pub(super) asked: Option<u32>,
}

/// The texels of a cell.
pub(super) struct Filled {
    /// With their irradiance, W/m².
    pub(super) values: Vec<(u32, Rgb)>,
    /// The same by light group.
    pub(super) groups: Grouped,
    /// Sum of their squared errors as far as these are known, mean of channels, (W/m²)².
    pub(super) squared_error: f64,
}

impl State<'_> {
    /// Splits the cell, or is done with it.
    pub(super) fn settle(&self, cell: &Cell, corners: [u32; 4], verdict: Verdict) -> Outcome {
        let asked = match verdict {
            Verdict::Split => return Outcome::Split(split(cell, corners)),
            Verdict::Ask(middle) => {
                let blend = Blend::new(self, &Rect { x: cell.x, y: cell.y, corners });
                if !self.is_foretold(corners, &blend, middle) {
                    return Outcome::Split(split(cell, corners));
                }
                Some(middle)
            }
            Verdict::Fine => None,
        };
        Outcome::Done(Finished { cell: cell.clone(), corners, asked })
    }

    /// Interpolates the texels of a cell.
    pub(super) fn fill(&self, &Finished { ref cell, corners, asked }: &Finished) -> Filled {
        let owned = self.owned(cell);
        let mut groups = Grouped::new(self.source.groups(), owned.len());
        if corners[0] == NO_TEXEL {
            // Nothing in reach can be lit.
            let values = owned.into_iter().map(|(t, _)| (t, Rgb::ZERO)).collect();
            return Filled { values, groups, squared_error: 0.0 };
        }
        let blend = Blend::new(self, &Rect { x: cell.x, y: cell.y, corners });
        // One probe more in the middle of a smooth cell would show as a dot.
        let has_own = |t: u32| self.probe_of[t as usize] != NO_PROBE && asked != Some(t);
        let value = |&(t, p): &(u32, Vec2)| {
            let e = match has_own(t) {
                true => self.best(t).irradiance,
                false => self.told(corners, &blend, p, Look::Best).max(Rgb::ZERO),
            };
            (t, e * self.footprint.lit(t))
        };
        let values: Vec<_> = owned.iter().map(value).collect();
        if groups.groups() > 0 {
            for (i, (&(t, p), &(_, whole))) in owned.iter().zip(&values).enumerate() {
                let row = groups.of_mut(i);
                match has_own(t) {
                    true => row.copy_from_slice(&self.best(t).groups),
                    false => self.told_groups(corners, &blend, p, row),
                }
                share_out(whole, row);
            }
        }
        let between = corners.iter().map(|&c| self.best(c).error.powi(2)).sum::<f32>() / 4.0;
        let bend = match asked {
            Some(middle) => SAG * self.miss((corners, Look::Best), &blend, (middle, Look::Best)).powi(2),
            None if cell.size() > 1 => self.likely_error(cell.parent.as_ref(), corners, Look::Best).powi(2),
            None => 0.0,
        };
        let square = |&(t, _): &(u32, Rgb)| {
            let noise = if has_own(t) { self.best(t).error.powi(2) } else { between };
            f64::from(noise + bend)
        };
        let squared_error = values.iter().map(square).sum();
        Filled { values, groups, squared_error }
    }

    /// What [`State::told`] says, by light group.
    pub(super) fn told_groups(&self, corners: [u32; 4], blend: &Blend, p: Vec2, row: &mut [Rgb]) {
        for (corner, weight) in corners.into_iter().zip(blend.weights(p)) {
            row.iter_mut().zip(&self.best(corner).groups).for_each(|(sum, &e)| *sum += e * weight);
        }
    }

    /// Irradiance at a page position as the corners have it, W/m².
    pub(super) fn told(&self, corners: [u32; 4], blend: &Blend, p: Vec2, look: Look) -> Rgb {
        blend.value(p, |k| self.tells(corners[k], look).irradiance)
    }
}
