//! Packs rectangles on pages, bottom-left along a skyline, high ones first.
//! Based on: Jylänki, "A Thousand Ways to Pack the Bin", 2010.

use super::Page;

/// Where a rectangle lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    /// Page.
    pub(super) page: usize,
    /// First column.
    pub(super) x: u32,
    /// First row.
    pub(super) y: u32,
}

/// Room that rectangles keep on every page.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spacing {
    /// Empty texels between two rectangles.
    pub(super) between: u32,
    /// Empty texels along the page's border.
    pub(super) border: u32,
}

impl Spacing {
    /// `padding` between charts and half of it at the border, where no other chart is near.
    pub(super) fn of(padding: u32) -> Self {
        Self { between: padding, border: padding.div_ceil(2) }
    }

    /// Largest rectangle side that fits a page of side `page`.
    pub(super) fn usable(self, page: u32) -> u32 {
        page.saturating_sub(2 * self.border).max(1)
    }
}

/// Places rectangles (width, height), none larger than the page has room for, on as few pages of `page`² as the
/// heuristic finds, but gives up if they need more than `most`. The result has one place per rectangle.
pub(super) fn pack(rectangles: &[(u32, u32)], page: u32, spacing: Spacing, most: usize) -> Option<Vec<Place>> {
    // Behind the last rectangle there is only the border.
    let room = page.saturating_sub(2 * spacing.border) + spacing.between;
    let padded = |r: &(u32, u32)| u64::from(r.0 + spacing.between) * u64::from(r.1 + spacing.between);
    if rectangles.iter().map(padded).sum::<u64>().div_ceil(u64::from(room).pow(2).max(1)) > most as u64 {
        return None;
    }
    let mut order: Vec<usize> = (0..rectangles.len()).collect();
    // Stable, so that equal rectangles keep their order.
    order.sort_by_key(|&i| std::cmp::Reverse((rectangles[i].1, rectangles[i].0)));
    let mut pages: Vec<Skyline> = Vec::new();
    let mut places = vec![Place::default(); rectangles.len()];
    for i in order {
        let (width, height) = (rectangles[i].0 + spacing.between, rectangles[i].1 + spacing.between);
        let found = pages.iter_mut().enumerate().find_map(|(p, skyline)| Some((p, skyline.place(width, height)?)));
        let (p, (x, y)) = match found {
            Some(found) => found,
            None if pages.len() == most => return None,
            None => {
                let mut skyline = Skyline::new(room);
                let place = skyline.place(width, height)?;
                pages.push(skyline);
                (pages.len() - 1, place)
            }
        };
        places[i] = Place { page: p, x: x + spacing.border, y: y + spacing.border };
    }
    Some(places)
}

/// The smallest pages, in multiples of four texels and at most `page` wide and high, that hold what was placed.
pub(super) fn cropped(rectangles: &[(u32, u32)], places: &[Place], page: u32, spacing: Spacing) -> Vec<Page> {
    let count = places.iter().map(|p| p.page + 1).max().unwrap_or(0);
    let mut pages = vec![Page { width: 0, height: 0 }; count];
    for (&(width, height), place) in rectangles.iter().zip(places) {
        let p = &mut pages[place.page];
        p.width = p.width.max(place.x + width + spacing.border);
        p.height = p.height.max(place.y + height + spacing.border);
    }
    // Block compression works in squares of four.
    let rounded = |n: u32| n.next_multiple_of(4).min(page);
    pages.iter().map(|p| Page { width: rounded(p.width), height: rounded(p.height) }).collect()
}

/// The upper outline of what is placed on a square page: steps from left to right.
struct Skyline {
    side: u32,
    steps: Vec<Step>,
}

/// From column `x` to the next step, rows below `y` are taken.
#[derive(Clone, Copy)]
struct Step {
    x: u32,
    y: u32,
}

impl Skyline {
    fn new(side: u32) -> Self {
        Self { side, steps: vec![Step { x: 0, y: 0 }] }
    }

    /// Puts a rectangle where it ends lowest, leftmost of equals; none if it fits nowhere.
    fn place(&mut self, width: u32, height: u32) -> Option<(u32, u32)> {
        let (first, y) = (0..self.steps.len())
            .filter_map(|i| Some((i, self.floor(i, width)?)))
            .filter(|&(_, y)| y + height <= self.side)
            .min_by_key(|&(i, y)| (y, i))?;
        let x = self.steps[first].x;
        let end = x + width;

        // The step that the rectangle ends in goes on behind it.
        let past = self.steps[first..].iter().take_while(|s| s.x < end).count() + first;
        let behind = self.steps[past - 1].y;
        let resumes = self.steps.get(past).map_or(self.side, |s| s.x) > end;
        let new = [Step { x, y: y + height }, Step { x: end, y: behind }];
        self.steps.splice(first..past, new.into_iter().take(1 + usize::from(resumes)));
        Some((x, y))
    }

    /// The lowest row at which a rectangle can lie with its left side at step `i`.
    fn floor(&self, i: usize, width: u32) -> Option<u32> {
        let end = self.steps[i].x + width;
        (end <= self.side)
            .then(|| self.steps[i..].iter().take_while(|s| s.x < end).map(|s| s.y).max().unwrap_or(self.steps[i].y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn gap(a: (u32, u32), b: (u32, u32)) -> i64 {
        (i64::from(a.0.max(b.0)) - i64::from(a.1.min(b.1))).max(0)
    }

    proptest! {
        #[test]
        fn rectangles_keep_their_distance(
            rectangles in prop::collection::vec((1u32..20, 1u32..20), 0..60),
            padding in 0u32..4,
        ) {
            let spacing = Spacing::of(padding);
            let places = pack(&rectangles, 48, spacing, usize::MAX).expect("any number of pages may be used");
            let pages = cropped(&rectangles, &places, 48, spacing);
            for (i, (&(w, h), a)) in rectangles.iter().zip(&places).enumerate() {
                prop_assert!(a.x >= spacing.border && a.x + w + spacing.border <= pages[a.page].width);
                prop_assert!(a.y >= spacing.border && a.y + h + spacing.border <= pages[a.page].height);
                for (&(v, k), b) in rectangles.iter().zip(&places).skip(i + 1).filter(|(_, b)| b.page == a.page) {
                    let (dx, dy) = (gap((a.x, a.x + w), (b.x, b.x + v)), gap((a.y, a.y + h), (b.y, b.y + k)));
                    let apart = dx >= i64::from(padding.max(1)) || dy >= i64::from(padding.max(1));
                    let touching = a.x >= b.x + v || b.x >= a.x + w || a.y >= b.y + k || b.y >= a.y + h;
                    prop_assert!(apart || (padding == 0 && touching));
                }
            }
        }
    }

    #[test]
    fn a_full_page_is_filled() {
        let spacing = Spacing::of(0);
        assert!(pack(&[(8, 8); 16], 32, spacing, 1).is_some());
        assert!(pack(&[(8, 8); 17], 32, spacing, 1).is_none());
        assert_eq!(pack(&[(8, 8); 17], 32, spacing, 2).map(|p| p[16].page), Some(1));
    }

    #[test]
    fn what_is_larger_than_the_page_has_no_place() {
        assert!(pack(&[(33, 1)], 32, Spacing::of(0), 9).is_none());
        assert_eq!(pack(&[], 32, Spacing::of(2), 1), Some(vec![]));
    }
}
