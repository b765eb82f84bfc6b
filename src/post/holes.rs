//! Texels without a value of their own, for example inside other geometry, take over those of their chart's others.

use crate::atlas::{Atlas, Texels};
use crate::scene::Rgb;

/// Replaces the values of texels that are not `usable` by the mean of their neighbours in the chart, ring by ring from
/// the usable ones. A chart without any keeps what it has. `values` and `usable` have one entry per texel.
pub fn fill_unusable(atlas: &Atlas, texels: &Texels, values: &mut [Rgb], usable: &[bool]) {
    let mut known = usable.to_vec();
    for (chart, range) in texels.charts.iter().enumerate() {
        let page = &texels.pages[atlas.charts[chart].page];
        let neighbours = |t: u32| {
            let [x, y] = texels.pixel[t as usize].map(u32::from);
            let columns = x.saturating_sub(1)..(x + 2).min(page.width);
            let around = (y.saturating_sub(1)..(y + 2).min(page.height))
                .flat_map(move |y| columns.clone().map(move |x| page.texel[(y * page.width + x) as usize]));
            // The chart's own texels are one range, in which no marker for empty places lies.
            around.filter(|n| range.contains(n))
        };
        let mut open: Vec<u32> = range.clone().filter(|&t| !known[t as usize]).collect();
        while !open.is_empty() {
            let mut ring = Vec::new();
            open.retain(|&t| {
                let (sum, count) = neighbours(t)
                    .filter(|&n| known[n as usize])
                    .fold((Rgb::ZERO, 0.0), |(sum, count), n| (sum + values[n as usize], count + 1.0));
                if count > 0.0 {
                    ring.push((t, sum / count));
                }
                count == 0.0
            });
            if ring.is_empty() {
                break;
            }
            for (t, value) in ring {
                values[t as usize] = value;
                known[t as usize] = true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atlas::{Chart, NO_TEXEL, Page, PageTexels};

    /// Two charts of three texels each in one row, with one empty place between them.
    fn row() -> (Atlas, Texels) {
        let chart = |x| Chart { instance: 0, page: 0, x, y: 0..1 };
        let atlas = Atlas {
            pages: vec![Page { width: 7, height: 1 }],
            charts: vec![chart(0..3), chart(4..7)],
            ..Atlas::default()
        };
        let texel = vec![0, 1, 2, NO_TEXEL, 3, 4, 5];
        let texels = Texels {
            pixel: [0, 1, 2, 4, 5, 6].map(|x| [x, 0]).to_vec(),
            charts: vec![0..3, 3..6],
            pages: vec![PageTexels { width: 7, height: 1, texel }],
            ..Texels::default()
        };
        (atlas, texels)
    }

    #[test]
    fn values_spread_within_their_chart_only() {
        let (atlas, texels) = row();
        let mut values: Vec<Rgb> = [1.0, 9.0, 9.0, 9.0, 2.0, 4.0].map(Rgb::splat).to_vec();
        fill_unusable(&atlas, &texels, &mut values, &[true, false, false, false, true, true]);
        assert_eq!(values, [1.0, 1.0, 1.0, 2.0, 2.0, 4.0].map(Rgb::splat));
    }

    #[test]
    fn a_chart_without_any_value_keeps_its_own() {
        let (atlas, texels) = row();
        let mut values = vec![Rgb::splat(3.0); 6];
        fill_unusable(&atlas, &texels, &mut values, &[false; 6]);
        assert_eq!(values, vec![Rgb::splat(3.0); 6]);
    }
}
