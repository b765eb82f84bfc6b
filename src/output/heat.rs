//! Where the error is: a page's audited texels as dots, coloured by how far they are off.

use super::thumbnail::{png, thumbnail};
use crate::atlas::PageImage;
use crate::audit::Audit;
use std::io;

/// Half width of a dot, pixels.
const DOT: i64 = 2;
/// Shade of the page behind the dots.
const DIM: f32 = 0.35;
/// Errors, in targets, at which the colours begin to turn from green to yellow, and end at red.
const TURNS: f64 = 1.0;
const ENDS: f64 = 10.0;

/// A PNG of page `index`: the page in dim grey under dots, the worst on top. Green texels are off by less than the target
/// as far as can be told, red ones by ten times as much, beside the mean irradiance of the whole lightmap.
pub(super) fn heat_map(page: &PageImage, index: usize, audit: &Audit) -> io::Result<Vec<u8>> {
    let mut picture = thumbnail(page);
    for pixel in picture.pixels.iter_mut() {
        let grey = pixel.iter().map(|&c| f32::from(c)).sum::<f32>() / 3.0;
        *pixel = [(DIM * grey) as u8; 3];
    }
    let mut dots: Vec<_> = audit.errors().filter(|(t, _)| t.page == index).collect();
    dots.sort_by(|a, b| a.1.total_cmp(&b.1));
    for (texel, error) in dots {
        let [x, y] = texel.pixel.map(|c| i64::from(c) / i64::from(picture.step));
        for (dx, dy) in (-DOT..=DOT).flat_map(|dy| (-DOT..=DOT).map(move |dx| (dx, dy))) {
            let (x, y) = (x + dx, y + dy);
            let inside = (0..i64::from(picture.width)).contains(&x) && (0..i64::from(picture.height)).contains(&y);
            if inside && dx * dx + dy * dy <= DOT * DOT + 1 {
                picture.pixels[y as usize * picture.width as usize + x as usize] = colour(error / audit.target);
            }
        }
    }
    png(&picture)
}

/// Green, yellow, red by the logarithm of an error in targets.
fn colour(targets: f64) -> [u8; 3] {
    let heat = ((targets / TURNS).max(f64::MIN_POSITIVE).log2() / (ENDS / TURNS).log2()).clamp(0.0, 1.0);
    let channel = |value: f64| (255.0 * value.clamp(0.0, 1.0)) as u8;
    [channel(0.1 + 1.8 * heat), channel(0.8 - 1.4 * (heat - 0.5).max(0.0)), channel(0.2 * (1.0 - heat))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_go_from_green_to_red() {
        let [green, yellow, red] = [0.5, 3.2, 20.0].map(colour);
        assert!(green[1] > green[0] && yellow[0] > 200 && yellow[1] > 180 && red[0] > 200 && red[1] < 50);
        assert_eq!(colour(0.0), colour(1.0));
    }
}
