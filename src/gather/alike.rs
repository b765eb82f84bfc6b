//! Which texels around one see so much the same light that what they find can be put together.

use super::footprint::Footprint;
use crate::atlas::{Atlas, Texels};
use glam::Vec2;

/// Cosine of the largest angle between normals that still count as one.
pub(super) const COS_NORMAL: f32 = 0.99;
/// Fewest texels with which one shares what it finds, itself included.
pub(super) const FEWEST: usize = 6;

/// The layout, as one looks for texels that are alike.
#[derive(Clone, Copy)]
pub(super) struct Alike<'a> {
    pub(super) atlas: &'a Atlas,
    pub(super) texels: &'a Texels,
    pub(super) footprint: &'a Footprint<'a>,
}

impl<'a> Alike<'a> {
    /// True if a texel has enough neighbours that are alike.
    pub(super) fn is_shared(self, texel: u32) -> bool {
        self.is_plain(texel) && self.around(texel, 1).count() >= FEWEST
    }

    /// True if geometry neither touches a texel in part nor parts it from its neighbours.
    fn is_plain(self, texel: u32) -> bool {
        !self.footprint.is_hidden(texel) && !self.footprint.is_touched(texel)
    }

    /// The texels up to `reach` columns and rows away that are like one, itself included, with their places relative to
    /// it: on its chart, facing as it does, and covered if it is.
    pub(super) fn around(self, texel: u32, reach: i32) -> impl Iterator<Item = (u32, Vec2)> + 'a {
        let Self { atlas, texels, footprint } = self;
        let t = texel as usize;
        let (normal, covered) = (texels.shading_normal[t], footprint.covered()[t]);
        let chart = &atlas.charts[texels.chart[t] as usize];
        let (own, page) = (&texels.charts[texels.chart[t] as usize], &texels.pages[chart.page]);
        let [x, y] = texels.pixel[t].map(i32::from);
        let within = move |at: i32, bounds: &std::ops::Range<u32>| {
            (at - reach).max(bounds.start as i32)..(at + reach + 1).min(bounds.end as i32)
        };
        let columns = within(x, &chart.x);
        let places = within(y, &chart.y).flat_map(move |v| columns.clone().map(move |u| (u, v)));
        places.filter_map(move |(u, v)| {
            let n = page.texel[v as usize * page.width as usize + u as usize];
            let is_alike = own.contains(&n)
                && self.is_plain(n)
                && texels.shading_normal[n as usize].dot(normal) >= COS_NORMAL
                && footprint.covered()[n as usize] == covered;
            is_alike.then(|| (n, Vec2::new((u - x) as f32, (v - y) as f32)))
        })
    }
}
