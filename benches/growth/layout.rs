//! Where faces lie on the lightmap: rectangles of whole cells of a square page, in shelves, edge to edge.
//!
//! Cells become whole texels at every resolution that is a multiple of their number, so the layout is always the same.

use crate::faces::Object;
use std::cmp::Reverse;

/// Lower left corners of all faces with a lightmap, in cells, in their order; none if `side`² cells do not hold them.
pub(crate) fn place(objects: &[Object], side: u32) -> Option<Vec<[u32; 2]>> {
    let mapped = objects.iter().filter(|o| o.has_lightmap);
    let sizes: Vec<[u32; 2]> = mapped.flat_map(|o| &o.faces).map(|f| f.cells).collect();
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&i| (Reverse(sizes[i][1]), Reverse(sizes[i][0]), i));
    let mut places = vec![[0, 0]; sizes.len()];
    // Where the next rectangle of every shelf would stand, and the first shelf that may have room.
    let mut shelves: Vec<[u32; 2]> = Vec::new();
    let (mut open, mut top) = (0, 0);
    for i in order {
        let [width, height] = sizes[i];
        while shelves.get(open).is_some_and(|[x, _]| *x == side) {
            open += 1;
        }
        let roomy = (open..shelves.len()).find(|&s| shelves[s][0] + width <= side);
        let shelf = roomy.unwrap_or_else(|| {
            shelves.push([0, top]);
            top += height;
            shelves.len() - 1
        });
        places[i] = shelves[shelf];
        shelves[shelf][0] += width;
        if width > side || top > side {
            return None;
        }
    }
    Some(places)
}
