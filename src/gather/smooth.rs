//! Irradiance of elements as a smooth function of the texels: for previews, and where no probe has been gathered yet.

use crate::atlas::{Atlas, Texels};
use crate::hierarchy::{Hierarchy, Side};
use crate::progress::{Cancelled, Progress};
use crate::scene::Rgb;
use glam::{UVec2, Vec2};
use rayon::prelude::*;

/// What elements say of texels.
pub struct Smooth {
    /// Irradiance of every texel, W/m².
    pub irradiance: Vec<Rgb>,
    /// Root of the mean squared change that smoothing made, W/m², mean of channels: about the error of what elements
    /// are too few or too noisy to show.
    pub change: f32,
}

/// Spreads `values`, the irradiance of elements of up to `side`×`side` texels, over the texels of each chart: bilinearly
/// between the means of aligned blocks, as far as the chart has them.
pub fn smooth(
    atlas: &Atlas,
    texels: &Texels,
    tree: &Hierarchy,
    values: &[Rgb],
    side: u32,
    progress: &dyn Progress,
) -> Result<Smooth, Cancelled> {
    let of_chart = |chart: usize| {
        if progress.is_cancelled() {
            return Err(Cancelled);
        }
        let blocks = Blocks::new(atlas, texels, tree, values, side, chart);
        let all = texels.charts[chart].clone().map(|t| blocks.at(texels.pixel[t as usize]));
        let smooth: Vec<Rgb> = all.collect();
        let own = |t: u32| tree.element_of(t, Side::Front).map_or(Rgb::ZERO, |e| values[e as usize]);
        let change = |(t, &value): (u32, &Rgb)| f64::from((value - own(t)).element_sum() / 3.0).powi(2);
        let changes: f64 = texels.charts[chart].clone().zip(&smooth).map(change).sum();
        Ok((smooth, changes))
    };
    let charts: Vec<(Vec<Rgb>, f64)> =
        (0..atlas.charts.len()).into_par_iter().map(of_chart).collect::<Result<_, Cancelled>>()?;
    let changes: f64 = charts.iter().map(|c| c.1).sum();
    let change = (changes / texels.len().max(1) as f64).sqrt() as f32;
    Ok(Smooth { irradiance: charts.into_iter().flat_map(|c| c.0).collect(), change })
}

/// Means over the aligned blocks of one chart.
struct Blocks {
    side: u32,
    /// First block of the chart on its page.
    first: UVec2,
    /// Blocks across.
    across: usize,
    /// Sum over the texels of each block and their number, row by row.
    sums: Vec<(Rgb, f32)>,
}

impl Blocks {
    fn new(atlas: &Atlas, texels: &Texels, tree: &Hierarchy, values: &[Rgb], side: u32, chart: usize) -> Self {
        let c = &atlas.charts[chart];
        let first = UVec2::new(c.x.start, c.y.start) / side;
        let last = UVec2::new(c.x.end.max(1) - 1, c.y.end.max(1) - 1) / side;
        let count = last.max(first) - first + 1;
        let mut sums = vec![(Rgb::ZERO, 0.0); count.x as usize * count.y as usize];
        for t in texels.charts[chart].clone() {
            let block = UVec2::from_array(texels.pixel[t as usize].map(u32::from)) / side - first;
            let (sum, weight) = &mut sums[(block.y * count.x + block.x) as usize];
            if let Some(e) = tree.element_of(t, Side::Front) {
                *sum += values[e as usize];
                *weight += 1.0;
            }
        }
        Self { side, first, across: count.x as usize, sums }
    }

    /// Value at the middle of a texel of the chart.
    fn at(&self, pixel: [u16; 2]) -> Rgb {
        let middle = Vec2::from_array(pixel.map(f32::from)) + 0.5;
        let p = middle / self.side as f32 - 0.5 - self.first.as_vec2();
        let (corner, f) = (p.floor(), p - p.floor());
        let (mut sum, mut weight) = (Rgb::ZERO, 0.0);
        for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let share = (1.0 - (f.x - x).abs()) * (1.0 - (f.y - y).abs());
            let (bx, by) = (corner.x + x, corner.y + y);
            let rows = self.sums.len() / self.across;
            if bx >= 0.0 && by >= 0.0 && (bx as usize) < self.across && (by as usize) < rows {
                // Blocks count by their texels, so that a sliver of a block does not speak for all around it.
                let (block, count) = self.sums[by as usize * self.across + bx as usize];
                sum += block * share;
                weight += count * share;
            }
        }
        sum / weight.max(f32::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_interpolated_and_missing_ones_left_out() {
        let value = |v: f32| (Rgb::splat(v * 16.0), 16.0);
        let blocks = Blocks {
            side: 4,
            first: UVec2::new(2, 3),
            across: 3,
            sums: vec![value(1.0), value(2.0), (Rgb::ZERO, 0.0), value(1.0), value(2.0), (Rgb::ZERO, 0.0)],
        };
        let at = |x: u16| blocks.at([x, 15]).x;
        let row: Vec<f32> = (8..16).map(at).collect();
        assert!(row.is_sorted(), "{row:?}");
        assert!((at(9) - 1.0).abs() < 1e-6 && (at(11) - 1.375).abs() < 1e-6, "{row:?}");
        // Beyond the last block with texels its value goes on.
        assert_eq!(at(15), 2.0);
    }
}
