//! Pages of changed light from the pages of its groups.

use super::layout::NO_PATCH;
use super::{Changes, GroupPage, PageLayout, SolutionError, SolutionReader};
use crate::atlas::PageImage;
use crate::gather::Grouped;
use crate::post;
use crate::progress::{Cancelled, Progress, Stage};
use crate::scene::Rgb;
use half::f16;
use half::slice::HalfFloatSliceExt;
use std::io::Read;

/// Texels to each side over which a change of bounced light is smoothed: about the size of a patch.
const SMOOTHING: usize = 4;
/// Times that is done; twice makes a tent of a box.
const PASSES: usize = 2;
/// Error to be expected of bounced light that was changed by reflectances, as a share of that change.
const UNCERTAINTY: f64 = 0.25;

/// A page of every light group and the whole, after changes.
pub struct Relit {
    /// All light, page by page: irradiance, borders filled.
    pub pages: Vec<PageImage>,
    /// Layout of the pages.
    pub layouts: Vec<PageLayout>,
    /// Root mean square error that the change of reflectances is expected to bring, as a share of the mean irradiance.
    pub expected_error: f64,
}

/// Recombines the groups of `solution`. `group_page` takes the pages of each group as they come: the group's number, the
/// page's, its layout, and the page with its borders filled.
pub fn relight<R: Read, E: From<SolutionError> + From<Cancelled>>(
    mut solution: SolutionReader<R>,
    changes: &Changes,
    progress: &dyn Progress,
    mut group_page: impl FnMut(usize, usize, &PageLayout, PageImage) -> Result<(), E>,
) -> Result<Relit, E> {
    let bounced =
        (!changes.keeps_reflectance()).then(|| solution.patches.change(|material| changes.reflectance[material]));
    progress.report(Stage::Solve, 1.0);
    let page_count = solution.header.report["atlas"]["pages"].as_array().map_or(0, Vec::len);
    let layouts = (0..page_count).map(|_| solution.page()).collect::<Result<Vec<_>, SolutionError>>()?;
    let rings = solution.header.rings;
    let mut pages: Vec<PageImage> = layouts.iter().map(|layout| layout.black().0).collect();
    let mut moved: Vec<Vec<Rgb>> = layouts.iter().map(|l| vec![Rgb::ZERO; l.places.len()]).collect();
    let steps = (changes.light.len() * page_count).max(1);
    for (group, &factor) in changes.light.iter().enumerate() {
        for (k, layout) in layouts.iter().enumerate() {
            let stored = solution.group_page(layout)?;
            let before: Vec<Rgb> = floats(&stored);
            let mut values = before.clone();
            if let Some(bounced) = &bounced {
                scale_bounced(&mut values, &stored, &smoothed(layout, bounced, group));
                let differences = values.iter().zip(&before).map(|(&after, &before)| factor * (after - before));
                moved[k].iter_mut().zip(differences).for_each(|(sum, d)| *sum += d);
            }
            let (mut image, mut filled) = layout.black();
            for (&place, &value) in layout.places.iter().zip(&values) {
                image.rgb[place as usize] = value * factor;
                pages[k].rgb[place as usize] += value * factor;
            }
            post::fill_borders(std::slice::from_mut(&mut image), std::slice::from_mut(&mut filled), rings, progress)?;
            group_page(group, k, layout, image)?;
            progress.report(Stage::Post, (group * page_count + k + 1) as f64 / steps as f64);
        }
    }
    solution.finish()?;
    let mut filled: Vec<Vec<bool>> = layouts.iter().map(|layout| layout.black().1).collect();
    post::fill_borders(&mut pages, &mut filled, rings, progress)?;
    let expected_error = expected_error(&layouts, &pages, &moved);
    Ok(Relit { pages, layouts, expected_error })
}

fn floats(page: &GroupPage) -> Vec<Rgb> {
    let halves: &[f16] = page.irradiance.as_flattened();
    let mut values = vec![0.0; halves.len()];
    halves.convert_to_f32_slice(&mut values);
    values.chunks_exact(3).map(Rgb::from_slice).collect()
}

/// Multiplies what did not come straight from lamps.
fn scale_bounced(values: &mut [Rgb], stored: &GroupPage, change: &[Rgb]) {
    for ((value, direct), &change) in values.iter_mut().zip(&stored.direct).zip(change) {
        let direct = Rgb::from_array(direct.map(|d| f32::from(d) / 255.0));
        *value *= direct + (Rgb::ONE - direct) * change;
    }
}

/// The change of bounced light at every stored texel, from the patches and smoothed within charts.
fn smoothed(layout: &PageLayout, bounced: &Grouped, group: usize) -> Vec<Rgb> {
    let of_patch = |&p: &u32| if p == NO_PATCH { Rgb::ONE } else { bounced.of(p as usize)[group] };
    let mut values: Vec<Rgb> = layout.patch.iter().map(of_patch).collect();
    let rows: Vec<usize> = (0..layout.places.len()).collect();
    let mut columns = rows.clone();
    columns.sort_by_key(|&i| (layout.places[i] % layout.width, layout.places[i] / layout.width));
    for _ in 0..PASSES {
        average(&mut values, layout, &rows, 1);
        average(&mut values, layout, &columns, layout.width);
    }
    values
}

/// Averages over runs of one chart along a line: `order` lists the stored texels line by line, and neighbours in a line
/// lie `step` places apart.
fn average(values: &mut [Rgb], layout: &PageLayout, order: &[usize], step: u32) {
    let follows = |&a: &usize, &b: &usize| {
        let next = layout.places[a].wrapping_add(step);
        let same_row = step > 1 || !next.is_multiple_of(layout.width);
        layout.places[b] == next && same_row && layout.chart[a] == layout.chart[b]
    };
    for run in order.chunk_by(follows) {
        let mut before = vec![Rgb::ZERO];
        for &i in run {
            before.push(before[before.len() - 1] + values[i]);
        }
        for (k, &i) in run.iter().enumerate() {
            let (from, to) = (k.saturating_sub(SMOOTHING), (k + SMOOTHING + 1).min(run.len()));
            values[i] = (before[to] - before[from]) / (to - from) as f32;
        }
    }
}

/// What may be wrong with irradiance that was `moved` by reflectances, by the mean of all irradiance.
fn expected_error(layouts: &[PageLayout], pages: &[PageImage], moved: &[Vec<Rgb>]) -> f64 {
    let (mut squares, mut sum, mut count) = (0.0f64, 0.0f64, 0.0f64);
    for ((layout, page), moved) in layouts.iter().zip(pages).zip(moved) {
        for ((&place, &valid), d) in layout.places.iter().zip(&layout.valid).zip(moved) {
            if valid {
                squares += f64::from(d.length_squared());
                sum += f64::from(page.rgb[place as usize].element_sum());
                count += 3.0;
            }
        }
    }
    if sum > 0.0 { UNCERTAINTY * (squares / count).sqrt() / (sum / count) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_keeps_to_charts() {
        // Two charts side by side on two rows, the second brighter.
        let width = 12u32;
        let layout = PageLayout {
            width,
            height: 2,
            places: (0..2 * width).collect(),
            valid: vec![true; 24],
            chart: (0..2 * width).map(|i| u32::from(i % width >= 6)).collect(),
            patch: (0..2 * width).map(|i| u32::from(i % width >= 6)).collect(),
            ..PageLayout::default()
        };
        let bounced = Grouped::from_groups(&[vec![Rgb::ONE, Rgb::splat(3.0)]]);
        let values = smoothed(&layout, &bounced, 0);
        for (i, v) in values.iter().enumerate() {
            let expected = if i as u32 % width >= 6 { 3.0 } else { 1.0 };
            assert!((v.x - expected).abs() < 1e-5, "{i}: {v}");
        }
    }
}
