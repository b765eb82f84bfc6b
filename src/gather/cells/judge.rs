//! Whether interpolation between the probes at a cell's corners will do.
//!
//! Based on: Ward, Rubinstein, Clear, "A Ray Tracing Solution for Diffuse Interreflection", 1988 (how far irradiance
//! reaches follows from the harmonic mean distance to what is seen).

use super::blend::Blend;
use super::{Cell, Look, Rect, State};
use crate::atlas::NO_TEXEL;
use crate::gather::alike::COS_NORMAL;
use glam::Vec2;

/// Share of the irradiance that linear interpolation over one harmonic mean distance gets wrong.
const CURVATURE: f32 = 0.06;
/// Share of the difference between corners that may be curvature.
const BEND: f32 = 0.08;
/// A cell whose corners were foretold exactly still is this share as bad as its surroundings suggest.
const TRUST: f32 = 0.3;
/// Texels along a side from which on a cell is also looked at in its middle.
const CHECKED: u32 = 4;
/// Share of the irradiance that interpolation misses at most, as far as is foretold.
const MOST_OFF: f32 = 0.5;

/// What the corners of a cell say of it.
#[derive(Clone, Copy)]
pub(super) enum Verdict {
    /// Interpolation will do.
    Fine,
    /// It will not.
    Split,
    /// It will do if the corners foretell the probe of this texel.
    Ask(u32),
}

impl State<'_> {
    /// What the corners say of a cell whose corners have probes. A large cell that is fine by them is also asked in its
    /// middle, for what is narrow may pass between corners unseen.
    pub(super) fn judge(&self, cell: &Cell, corners: [u32; 4], look: Look) -> Verdict {
        let size = cell.size();
        if size <= 1 || corners[0] == NO_TEXEL {
            return Verdict::Fine;
        }
        let owned = self.owned(cell);
        if !owned.is_empty() && !self.is_fine(cell, corners, &owned, look) {
            return Verdict::Split;
        }
        let middle = || self.texel(cell.chart, (cell.x[0] + cell.x[1]) / 2, (cell.y[0] + cell.y[1]) / 2);
        match middle().filter(|&t| size >= CHECKED && !self.footprint.is_hidden(t)) {
            Some(middle) if !owned.is_empty() => Verdict::Ask(middle),
            _ => Verdict::Fine,
        }
    }

    /// True if the corners foretell the probe of the texel in the middle.
    pub(super) fn is_foretold(&self, corners: [u32; 4], blend: &Blend, middle: u32) -> bool {
        let found = self.probe(middle);
        let all = found.irradiance.element_sum() / 3.0 + self.source.direct(middle);
        let tolerance = self.settings.tolerance * self.settings.probe.yardstick(all);
        self.miss((corners, Look::Best), blend, (middle, Look::Best)) <= 2.0 * tolerance + 2.0 * found.error
    }

    /// Largest distance between corners on a diagonal, shortened to how far the middle is, and harmonic mean distance to
    /// what they see, metres.
    pub(super) fn size_and_reach(&self, corners: [u32; 4], look: Look) -> (f32, f32) {
        let position = |k: usize| self.texels.position[corners[k] as usize];
        let size = position(0).distance(position(3)).max(position(1).distance(position(2))) * 0.7;
        (size, corners.map(|c| self.tells(c, look).distance).into_iter().fold(f32::INFINITY, f32::min))
    }

    /// Mean irradiance of the corners, W/m², mean of channels.
    pub(super) fn mean(&self, corners: [u32; 4], look: Look) -> f32 {
        corners.iter().map(|&c| self.tells(c, look).irradiance.element_sum() / 3.0).sum::<f32>() / 4.0
    }

    /// By how much interpolation between the corners is expected to miss, W/m², mean of channels.
    pub(super) fn expected_error(&self, parent: Option<&Rect>, corners: [u32; 4], look: Look) -> f32 {
        let probes = corners.map(|c| self.tells(c, look));
        let values = probes.map(|p| p.irradiance.element_sum() / 3.0);
        let mean = self.mean(corners, look);
        let noise = probes.iter().map(|p| p.error).fold(0.0, f32::max);
        let low = values.iter().copied().fold(f32::INFINITY, f32::min);
        let high = values.iter().copied().fold(0.0, f32::max);
        let (size, reach) = self.size_and_reach(corners, look);
        let ratio = size / reach.max(1e-12);
        let mut expected = CURVATURE * ratio * ratio * mean + BEND * (high - low - 2.0 * noise).max(0.0);
        if let Some(parent) = parent {
            let blend = Blend::new(self, parent);
            let miss = corners
                .map(|c| self.miss((parent.corners, Look::First), &blend, (c, look)))
                .into_iter()
                .fold(0.0, f32::max);
            // Halving a cell quarters its curvature; what was foretold well needs no further cut.
            expected = expected.min((0.5 * miss).max(TRUST * expected));
        }
        expected
    }

    /// The same without the caution that makes cells fine in time.
    pub(super) fn likely_error(&self, parent: Option<&Rect>, corners: [u32; 4], look: Look) -> f32 {
        self.expected_error(parent, corners, look).min(MOST_OFF * self.mean(corners, look))
    }

    /// True if interpolation between the corners is expected to stay within the tolerance.
    pub(super) fn is_fine(&self, cell: &Cell, corners: [u32; 4], owned: &[(u32, Vec2)], look: Look) -> bool {
        let (source, settings) = (self.source, self.settings);
        let t = self.texels;
        let mean = self.mean(corners, look);
        let direct = corners.map(|c| source.direct(c)).into_iter().fold(f32::INFINITY, f32::min);
        let tolerance = settings.tolerance * settings.probe.yardstick(mean + direct);
        if self.expected_error(cell.parent.as_ref(), corners, look) > tolerance {
            return false;
        }
        let (size, reach) = self.size_and_reach(corners, look);
        // What something stands on shares no light with what lies around.
        let covered = self.footprint.covered();
        let first = covered[corners[0] as usize];
        if corners.iter().chain(owned.iter().map(|(t, _)| t)).any(|&t| covered[t as usize] != first) {
            return false;
        }
        // Folds and steps in the surface show in normals and positions before they show in light.
        let slack = 0.02 * reach + 0.25 * size / cell.size().max(1) as f32;
        let blend = Blend::new(self, &Rect { x: cell.x, y: cell.y, corners });
        owned.iter().all(|&(texel, p)| {
            let n = blend.value(p, |k| t.shading_normal[corners[k] as usize]);
            let at = blend.value(p, |k| t.position[corners[k] as usize]);
            let i = texel as usize;
            n.dot(t.shading_normal[i]) >= COS_NORMAL * n.length()
                && at.distance(t.position[i]) <= slack.max(size * 0.25)
        })
    }

    /// By how much a look at the corners misses one at a texel, W/m², mean of channels.
    pub(super) fn miss(&self, (corners, by): ([u32; 4], Look), blend: &Blend, (texel, own): (u32, Look)) -> f32 {
        let [x, y] = self.texels.pixel[texel as usize].map(f32::from);
        (self.told(corners, blend, Vec2::new(x, y), by) - self.tells(texel, own).irradiance).element_sum().abs() / 3.0
    }
}
