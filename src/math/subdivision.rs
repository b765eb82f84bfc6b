//! Cuts triangles into equal parts, to average over them.

use glam::Vec2;

/// Barycentrics (of the second and third corner) of the middles of the `parts`² equal triangles that cutting each side
/// of a triangle into `parts` makes.
pub fn triangle_middles(parts: u32) -> impl Iterator<Item = Vec2> {
    let row = move |i: u32| (0..parts - i).map(move |j| (i, j));
    (0..parts).flat_map(row).flat_map(move |(i, j)| {
        let corner = Vec2::new(i as f32, j as f32);
        let upright = corner + Vec2::splat(1.0 / 3.0);
        // The one that stands on its tip.
        let other = (i + j + 1 < parts).then_some(corner + Vec2::splat(2.0 / 3.0));
        [Some(upright), other].into_iter().flatten().map(move |p| p / parts as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn middles_average_to_the_triangles() {
        for parts in 1..20 {
            let middles: Vec<Vec2> = triangle_middles(parts).collect();
            assert_eq!(middles.len() as u32, parts * parts);
            let mean = middles.iter().sum::<Vec2>() / middles.len() as f32;
            assert!(mean.distance(Vec2::splat(1.0 / 3.0)) < 1e-6, "{parts}: {mean}");
        }
    }
}
