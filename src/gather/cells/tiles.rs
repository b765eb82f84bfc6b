//! Parts of a gather that can be done apart: layout → a tile per texel.
//!
//! A tile is a run of the largest cells, chart by chart and row by row, that ends with the cell with which it has
//! [`TILE`] texels or more; the last tile may have less. It depends on the layout alone.

use super::lines;
use crate::atlas::{Atlas, Texels};

/// Texels of a tile at least.
const TILE: usize = 1024;

/// Which texels belong to which tile.
pub struct Tiles {
    /// Number of tiles; they are numbered from 0.
    pub count: u32,
    /// Tile of every texel.
    pub of_texel: Vec<u32>,
}

impl Tiles {
    /// Of a layout.
    pub fn new(atlas: &Atlas, texels: &Texels) -> Self {
        let mut of_texel = vec![0; texels.len()];
        let (mut tile, mut filled) = (0, 0);
        for (chart, range) in atlas.charts.iter().zip(&texels.charts) {
            let (xs, ys) = (lines(&chart.x), lines(&chart.y));
            // A cell owns its first column and row; the last cells own those at which they end as well.
            let place = |lines: &[u32], at: u16| {
                let after = lines.partition_point(|&line| line <= u32::from(at));
                after.clamp(1, lines.len() - 1) - 1
            };
            let cell_of = |t: u32| {
                let [x, y] = texels.pixel[t as usize];
                place(&ys, y) * (xs.len() - 1) + place(&xs, x)
            };
            let cells: Vec<usize> = range.clone().map(cell_of).collect();
            let mut sizes = vec![0; (xs.len() - 1) * (ys.len() - 1)];
            cells.iter().for_each(|&cell| sizes[cell] += 1);
            let tile_of = |&size: &usize| {
                if filled >= TILE {
                    (tile, filled) = (tile + 1, 0);
                }
                filled += size;
                tile
            };
            let tiles: Vec<u32> = sizes.iter().map(tile_of).collect();
            range.clone().zip(cells).for_each(|(t, cell)| of_texel[t as usize] = tiles[cell]);
        }
        let count = of_texel.iter().max().map_or(0, |&last| last + 1);
        Self { count, of_texel }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atlas::{Chart, NO_TEXEL, PageTexels};

    /// Charts of so many columns and rows beside each other, all of whose texels are covered.
    fn layout(sizes: &[(u32, u32)]) -> (Atlas, Texels) {
        let (mut atlas, mut texels) = (Atlas::default(), Texels::default());
        let mut left = 0;
        for &(width, height) in sizes {
            let first = texels.pixel.len() as u32;
            atlas.charts.push(Chart { instance: 0, page: 0, x: left..left + width, y: 0..height });
            texels.pixel.extend((0..height).flat_map(|y| (left..left + width).map(move |x| [x as u16, y as u16])));
            texels.charts.push(first..texels.pixel.len() as u32);
            left += width;
        }
        texels.pages.push(PageTexels { width: left, height: 1, texel: vec![NO_TEXEL; left as usize] });
        (atlas, texels)
    }

    #[test]
    fn tiles_are_runs_of_cells_of_about_a_size() {
        let (atlas, texels) = layout(&[(100, 60), (7, 3), (300, 1), (64, 64)]);
        let tiles = Tiles::new(&atlas, &texels);
        let mut sizes = vec![0; tiles.count as usize];
        tiles.of_texel.iter().for_each(|&t| sizes[t as usize] += 1);
        let (last, others) = sizes.split_last().expect("there are texels");
        assert!(others.iter().all(|size| (TILE..TILE + 17 * 17).contains(size)), "{sizes:?}");
        assert!((1..TILE + 17 * 17).contains(last), "{sizes:?}");
        // No cell is cut: the neighbours within one have its tile.
        assert_eq!(tiles.of_texel[0], tiles.of_texel[13 + 100 * 13]);
    }

    #[test]
    fn nothing_has_no_tile() {
        assert_eq!(Tiles::new(&Atlas::default(), &Texels::default()).count, 0);
    }
}
