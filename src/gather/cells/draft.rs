//! How the gathered light looks before its cells are finished: probes so far → irradiance of every texel.

use super::blend::Blend;
use super::fill::Finished;
use super::{Cell, Look, NO_PROBE, Probe, Rect, State};
use crate::atlas::NO_TEXEL;
use crate::scene::Rgb;
use glam::Vec2;
use rayon::prelude::*;

/// A gather on its way.
pub struct Gathering<'a> {
    pub(super) state: &'a State<'a>,
    /// Cells that are not finished.
    pub(super) cells: &'a [Cell],
    /// Those that are.
    pub(super) finished: &'a [Finished],
    /// Of texels that are not gathered, W/m².
    pub(super) irradiance: &'a [Rgb],
}

impl Gathering<'_> {
    /// Texels with their probes so far.
    pub fn probes(&self) -> &[(u32, Probe)] {
        &self.state.probes
    }

    /// Irradiance of every texel as far as it is known, W/m², with the sum of the squared errors to be expected: finished
    /// cells as they are; others by their corners or by those of the cell that they were cut from; where there are none,
    /// `rest` with the error `off`.
    pub fn draft(&self, rest: &[Rgb], off: f32) -> (Vec<Rgb>, f64) {
        let state = self.state;
        let guess = |cell: &Cell| -> (Vec<(u32, Rgb)>, f64) {
            let owned = state.owned(cell);
            let corners = state.corners(cell);
            let is_known = |c: &u32| *c != NO_TEXEL && state.probe_of[*c as usize] != NO_PROBE;
            let (rect, parent) = match (&cell.parent, corners.iter().all(is_known)) {
                (parent, true) => (Some(Rect { x: cell.x, y: cell.y, corners }), parent.as_ref()),
                (parent, false) => (parent.clone(), None),
            };
            let Some(rect) = rect else {
                let square = f64::from(off).powi(2) * owned.len() as f64;
                return (owned.iter().map(|&(t, _)| (t, rest[t as usize])).collect(), square);
            };
            let blend = Blend::new(state, &rect);
            let value = |&(t, p): &(u32, Vec2)| (t, state.told(rect.corners, &blend, p, Look::Best).max(Rgb::ZERO));
            let square = f64::from(state.likely_error(parent, rect.corners, Look::Best)).powi(2) * owned.len() as f64;
            (owned.iter().map(value).collect(), square)
        };
        let known = self.finished.par_iter().map(|cell| {
            let filled = state.fill(cell);
            (filled.values, filled.squared_error)
        });
        let all: Vec<_> = known.chain(self.cells.par_iter().map(guess)).collect();
        let (mut irradiance, mut squared_error) = (self.irradiance.to_vec(), 0.0);
        for (values, square) in all {
            squared_error += square;
            for (texel, value) in values {
                irradiance[texel as usize] = value;
            }
        }
        (irradiance, squared_error)
    }
}
