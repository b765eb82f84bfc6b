//! Dilation: texels that no chart covers take over their neighbours' values, so that filtering at a chart's edge finds
//! nothing foreign.

use crate::atlas::PageImage;
use crate::scene::Rgb;

/// The eight neighbours.
const NEIGHBOURS: [(i64, i64); 8] = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];

/// Fills the invalid texels within `rings` texels of valid ones, ring by ring, with the mean of the neighbours filled
/// before. Valid texels keep their values, and `valid` says afterwards what it said before.
pub(super) fn dilate(page: &mut PageImage, rings: u32) {
    let mut filled = page.valid.clone();
    dilate_from(page, &mut filled, rings);
}

/// The same, starting from the texels that are `filled`, which grow with the rings.
pub(super) fn dilate_from(page: &mut PageImage, filled: &mut [bool], rings: u32) {
    let mut frontier: Vec<u32> = (0..filled.len() as u32).filter(|&i| filled[i as usize]).collect();
    for _ in 0..rings {
        let ring = next_ring(page, filled, &frontier);
        if ring.is_empty() {
            break;
        }
        for &(i, value) in &ring {
            page.rgb[i as usize] = value;
            filled[i as usize] = true;
        }
        frontier = ring.into_iter().map(|(i, _)| i).collect();
    }
}

/// The texels next to `frontier` that are not filled, with their values, in the order of their index.
fn next_ring(page: &PageImage, filled: &[bool], frontier: &[u32]) -> Vec<(u32, Rgb)> {
    let mut ring: Vec<u32> =
        frontier.iter().flat_map(|&i| neighbours(page, i)).filter(|&n| !filled[n as usize]).collect();
    ring.sort_unstable();
    ring.dedup();
    let mean = |i: u32| {
        let (mut sum, mut count) = (Rgb::ZERO, 0.0);
        for n in neighbours(page, i).filter(|&n| filled[n as usize]) {
            sum += page.rgb[n as usize];
            count += 1.0;
        }
        sum / count
    };
    ring.into_iter().map(|i| (i, mean(i))).collect()
}

/// Indices of the neighbours of texel `i` that lie on the page.
fn neighbours(page: &PageImage, i: u32) -> impl Iterator<Item = u32> + use<> {
    let (width, height) = (i64::from(page.width), i64::from(page.height));
    let (x, y) = (i64::from(i) % width, i64::from(i) / width);
    NEIGHBOURS.into_iter().filter_map(move |(dx, dy)| {
        let (x, y) = (x + dx, y + dy);
        (x >= 0 && y >= 0 && x < width && y < height).then(|| (y * width + x) as u32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spot() -> PageImage {
        let mut page = PageImage::black(9, 9);
        page.rgb[4 * 9 + 4] = Rgb::new(1.0, 2.0, 3.0);
        page.valid[4 * 9 + 4] = true;
        page
    }

    #[test]
    fn fills_as_many_rings_as_asked() {
        let mut page = spot();
        dilate(&mut page, 2);
        for (i, value) in page.rgb.iter().enumerate() {
            let (dx, dy) = ((i % 9).abs_diff(4), (i / 9).abs_diff(4));
            let expected = if dx.max(dy) <= 2 { Rgb::new(1.0, 2.0, 3.0) } else { Rgb::ZERO };
            assert_eq!(*value, expected, "texel {i}");
        }
        assert_eq!(page.valid, spot().valid);
    }

    #[test]
    fn valid_texels_stay() {
        let mut page = spot();
        page.valid[4 * 9 + 5] = true;
        dilate(&mut page, 20);
        assert_eq!(page.rgb[4 * 9 + 4], Rgb::new(1.0, 2.0, 3.0));
        assert_eq!(page.rgb[4 * 9 + 5], Rgb::ZERO);
        assert!(page.rgb.iter().all(|c| c.is_finite()));
    }

    #[test]
    fn an_empty_page_stays_black() {
        let mut page = PageImage::black(5, 3);
        dilate(&mut page, 4);
        assert_eq!(page, PageImage::black(5, 3));
    }
}
