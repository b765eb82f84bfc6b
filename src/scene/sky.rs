//! An environment picture made ready for rays: what is so bright and small that few rays would find it is cut out
//! exactly, as regions that are sent like lamps; the rest is a pyramid of half floats, looked up by solid angle.
//!
//! Memory: 8 bytes per pixel, of at most 8192 × 4096.

use super::Rgb;
use super::panorama::{Cell, Panorama, position};
use glam::{Quat, Vec2, Vec3};
use half::f16;

/// Wider pictures are reduced by halves.
const WIDEST: usize = 8192;
/// Pixels are bright from this many times the mean radiance on.
const CONTRAST: f64 = 4.0;
/// Most solid angle that may be cut out, sr: what is larger, rays find.
const COMPACT: f64 = 0.4;
/// Regions are not worth having if they hold less than this share of all power.
const LEAST: f64 = 0.002;
/// Bright pixels are joined to blocks of at most this many degrees, where they differ by less than this factor.
const BLOCK: f64 = 1.5;
const ALIKE: f32 = 1.25;
/// Regions are divided until they are this small (sine of the angular radius), or this many.
const RADIUS: f32 = 0.12;
const REGIONS: usize = 24;
/// Share of a ray's solid angle that a lookup averages: more would carry light around the edges of what is near.
const SHARE: f32 = 0.25;
/// Values are stored so that the brightest is this.
const LARGEST: f32 = 6e4;

/// A picture of the environment.
#[derive(Clone, Debug, PartialEq)]
pub struct Sky {
    /// World directions to the picture's.
    rotation: Quat,
    levels: Vec<Level>,
    regions: Vec<BrightRegion>,
}

/// One picture of the pyramid.
#[derive(Clone, Debug, PartialEq)]
struct Level {
    width: usize,
    height: usize,
    /// Radiance of one unit of the pixels.
    scale: f32,
    pixels: Vec<[f16; 3]>,
}

/// Directions that were cut out of the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct BrightRegion {
    /// Its parts, neighbours close to each other.
    pub cells: Vec<BrightCell>,
    /// The picture's directions to the world's.
    pub rotation: Quat,
}

/// A block of pixels and what was taken from it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BrightCell {
    /// Where it is in the picture.
    pub cell: Cell,
    /// Radiance that the picture lacks now, W/(m²·sr).
    pub radiance: Rgb,
}

impl BrightCell {
    /// Radiance × solid angle, mean of channels.
    pub fn power(&self) -> f64 {
        brightness(self.radiance) as f64 * self.cell.solid_angle()
    }
}

fn brightness(radiance: Rgb) -> f32 {
    radiance.element_sum() / 3.0
}

impl Sky {
    /// Takes finite, non-negative radiances, and the rotation that turns the picture into the world.
    pub fn new(mut panorama: Panorama, rotation: Quat) -> Self {
        while panorama.width > WIDEST && panorama.is_even() {
            panorama = panorama.halved();
        }
        let regions = match threshold(&panorama) {
            Some(threshold) => divided(cut_out(&mut panorama, threshold), rotation),
            None => Vec::new(),
        };
        let mut levels = vec![Level::new(&panorama)];
        while panorama.is_even() && panorama.height > 8 {
            panorama = panorama.halved();
            levels.push(Level::new(&panorama));
        }
        Self { rotation: rotation.inverse(), levels, regions }
    }

    /// What was cut out and is to be sent like lamps.
    pub fn regions(&self) -> &[BrightRegion] {
        &self.regions
    }

    /// Mean radiance around unit direction `d` over about `solid_angle` sr, W/(m²·sr), without the bright regions.
    pub fn radiance(&self, d: Vec3, solid_angle: f32) -> Rgb {
        let finest = &self.levels[0];
        let pixel = 2.0 * std::f32::consts::PI.powi(2) / (finest.width * finest.height) as f32;
        let level = (0.5 * (SHARE * solid_angle / pixel).max(1.0).log2()) as usize;
        self.levels[level.min(self.levels.len() - 1)].sample(position(self.rotation * d))
    }

    /// True if nothing is left and nothing was cut out.
    pub fn is_black(&self) -> bool {
        self.regions.is_empty() && self.levels[0].scale == 0.0
    }
}

impl Level {
    fn new(panorama: &Panorama) -> Self {
        let scale = panorama.pixels.iter().map(|p| p.max_element()).fold(0.0, f32::max) / LARGEST;
        let unit = if scale > 0.0 { 1.0 / scale } else { 0.0 };
        let pixels = panorama.pixels.iter().map(|p| p.to_array().map(|c| f16::from_f32(c * unit))).collect();
        Self { width: panorama.width, height: panorama.height, scale, pixels }
    }

    /// Bilinear; the picture goes on around, and ends at the poles.
    fn sample(&self, p: Vec2) -> Rgb {
        let (x, y) = (p.x * self.width as f32 - 0.5, p.y * self.height as f32 - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let at = |dx: i64, dy: i64| {
            let column = (x0 as i64 + dx).rem_euclid(self.width as i64) as usize;
            let row = (y0 as i64 + dy).clamp(0, self.height as i64 - 1) as usize;
            Rgb::from_array(self.pixels[row * self.width + column].map(f16::to_f32))
        };
        let upper = at(0, 0).lerp(at(1, 0), fx);
        upper.lerp(at(0, 1).lerp(at(1, 1), fx), fy) * self.scale
    }
}

/// Brightness above which pixels are cut out: the lowest for which they are compact. None if that gains nothing.
fn threshold(panorama: &Panorama) -> Option<f32> {
    let rows = || panorama.pixels.chunks(panorama.width).enumerate();
    let weight = |row: usize| Cell::new(0, row, panorama.width, panorama.height).solid_angle();
    let sum = |f: &dyn Fn(f64) -> f64| -> f64 {
        rows().map(|(y, row)| weight(y) * row.iter().map(|&p| f(brightness(p) as f64)).sum::<f64>()).sum()
    };
    let total = sum(&|b| b);
    let mean = total / (4.0 * std::f64::consts::PI);
    if total <= 0.0 {
        return None;
    }
    // Solid angle by octave above the first threshold.
    let mut octaves = [0.0f64; 64];
    for (y, row) in rows() {
        for &p in row {
            let octave = (brightness(p) as f64 / (CONTRAST * mean)).log2();
            if octave > 0.0 {
                octaves[(octave as usize).min(octaves.len() - 1)] += weight(y);
            }
        }
    }
    let mut above: f64 = octaves.iter().sum();
    let mut threshold = CONTRAST * mean;
    for octave in octaves {
        if above <= COMPACT {
            break;
        }
        above -= octave;
        threshold *= 2.0;
    }
    let excess = sum(&|b| (b - threshold).max(0.0));
    (excess > LEAST * total).then_some(threshold as f32)
}

/// Takes what exceeds `threshold` out of the picture, as blocks in the order of a quadtree.
fn cut_out(panorama: &mut Panorama, threshold: f32) -> Vec<BrightCell> {
    let depth = panorama.width.max(panorama.height).next_power_of_two().trailing_zeros();
    let mut blocks = Vec::new();
    collect(panorama, threshold, depth, 0, 0, &mut blocks);
    let size = |b: &Block| (panorama.width >> b.level, panorama.height >> b.level);
    blocks
        .iter()
        .map(|b| {
            let (columns, rows) = size(b);
            BrightCell { cell: Cell::new(b.x, b.y, columns, rows), radiance: b.radiance }
        })
        .collect()
}

/// Square block (x, y) of 2^level × 2^level pixels.
struct Block {
    level: u32,
    x: usize,
    y: usize,
    radiance: Rgb,
}

/// Blocks inside block (x, y) of `level`.
fn collect(panorama: &mut Panorama, threshold: f32, level: u32, x: usize, y: usize, out: &mut Vec<Block>) {
    let (width, height) = (panorama.width, panorama.height);
    if x << level >= width || y << level >= height {
        return;
    }
    if level == 0 {
        let pixel = &mut panorama.pixels[y * width + x];
        let bright = brightness(*pixel);
        if bright > threshold {
            let rest = *pixel * (threshold / bright);
            out.push(Block { level, x, y, radiance: *pixel - rest });
            *pixel = rest;
        }
        return;
    }
    let first = out.len();
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        collect(panorama, threshold, level - 1, 2 * x + dx, 2 * y + dy, out);
    }
    let children = &out[first..];
    let whole = (width >> level) << level == width && (height >> level) << level == height;
    let small = 360.0 * (1u64 << level) as f64 / width as f64 <= BLOCK;
    if !whole || !small || children.len() != 4 || children.iter().any(|c| c.level + 1 != level) {
        return;
    }
    let values = || children.iter().map(|c| brightness(c.radiance));
    if values().fold(0.0, f32::max) > ALIKE * values().fold(f32::INFINITY, f32::min) {
        return;
    }
    // The mean by solid angle, so that no energy is lost.
    let weight = |b: &Block| Cell::new(0, b.y, width >> b.level, height >> b.level).solid_angle() as f32;
    let sum: Rgb = children.iter().map(|c| c.radiance * weight(c)).sum();
    let radiance = sum / children.iter().map(weight).sum::<f32>();
    out.truncate(first);
    out.push(Block { level, x, y, radiance });
}

/// Divides the cells at the median of power, the widest and strongest set first.
fn divided(cells: Vec<BrightCell>, rotation: Quat) -> Vec<BrightRegion> {
    let mut sets = vec![cells];
    while sets.len() < REGIONS {
        let importance = |cells: &Vec<BrightCell>| {
            let radius = extent(cells).max_element();
            let divisible = radius > 2.0 * RADIUS && cells.len() > 1;
            if divisible { radius as f64 * cells.iter().map(BrightCell::power).sum::<f64>() } else { 0.0 }
        };
        let ranked = sets.iter().map(importance).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((index, _)) = ranked.filter(|(_, importance)| *importance > 0.0) else { break };
        let (a, b) = halves(&sets[index]);
        sets[index] = a;
        sets.push(b);
    }
    sets.into_iter().map(|cells| BrightRegion { cells, rotation }).collect()
}

fn middle(cell: &BrightCell) -> Vec3 {
    cell.cell.direction(Vec2::splat(0.5))
}

/// Size of the box around the directions.
fn extent(cells: &[BrightCell]) -> Vec3 {
    let low = cells.iter().map(middle).fold(Vec3::INFINITY, Vec3::min);
    let high = cells.iter().map(middle).fold(Vec3::NEG_INFINITY, Vec3::max);
    high - low
}

/// Two sets on either side of the box's middle along its longest side, each in its old order.
fn halves(cells: &[BrightCell]) -> (Vec<BrightCell>, Vec<BrightCell>) {
    let size = extent(cells);
    let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).expect("three axes");
    let low = cells.iter().map(|c| middle(c)[axis]).fold(f32::INFINITY, f32::min);
    let cut = low + 0.5 * size[axis];
    cells.iter().partition(|c| middle(c)[axis] < cut)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dim sky with a sun of `sun` × `sun` pixels.
    fn picture(width: usize, sun: usize) -> Panorama {
        let height = width / 2;
        let mut pixels: Vec<Rgb> =
            (0..width * height).map(|i| Rgb::new(0.3, 0.5, 1.0) * (1.0 + (i % 7) as f32)).collect();
        for i in 0..sun * sun {
            pixels[(height / 4 + i / sun) * width + width / 3 + i % sun] = Rgb::new(3e5, 2e5, 1e5);
        }
        Panorama { width, height, pixels }
    }

    fn energy(panorama: &Panorama) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (i, p) in panorama.pixels.iter().enumerate() {
            let cell = Cell::new(i % panorama.width, i / panorama.width, panorama.width, panorama.height);
            (0..3).for_each(|c| sum[c] += p[c] as f64 * cell.solid_angle());
        }
        sum
    }

    #[test]
    fn what_is_cut_out_is_what_the_picture_lacks() {
        for (width, sun) in [(64, 1), (256, 6), (100, 2)] {
            let mut rest = picture(width, sun);
            let before = energy(&rest);
            let limit = threshold(&rest).expect("the sun stands out");
            let cells = cut_out(&mut rest, limit);
            assert!(rest.pixels.iter().all(|&p| brightness(p) <= 1.001 * limit));
            let after = energy(&rest);
            for c in 0..3 {
                let cut: f64 = cells.iter().map(|b| b.radiance[c] as f64 * b.cell.solid_angle()).sum();
                assert!(((after[c] + cut) / before[c] - 1.0).abs() < 1e-6, "{width}: {} + {cut}", after[c]);
            }
        }
    }

    #[test]
    fn alike_pixels_are_joined() {
        let mut rest = picture(2048, 16);
        let limit = threshold(&rest).expect("the sun stands out");
        assert!(cut_out(&mut rest, limit).len() < 128, "256 pixels are few blocks");
    }

    #[test]
    fn an_even_sky_has_no_bright_region() {
        let even = Panorama { width: 32, height: 16, pixels: vec![Rgb::splat(2.0); 512] };
        let sky = Sky::new(even, Quat::from_rotation_y(1.0));
        assert!(sky.regions().is_empty() && !sky.is_black());
        for solid_angle in [0.0, 0.1, 10.0] {
            assert!(sky.radiance(Vec3::new(0.6, 0.0, 0.8), solid_angle).distance(Rgb::splat(2.0)) < 1e-2);
        }
    }

    #[test]
    fn the_rotation_turns_the_picture() {
        let mut panorama = picture(64, 0);
        panorama.pixels = vec![Rgb::ONE; 64 * 32];
        panorama.pixels[16 * 64 + 32] = Rgb::splat(3.0);
        let sky = Sky::new(panorama, Quat::from_rotation_y(0.5));
        let bright = Quat::from_rotation_y(0.5) * Cell::new(32, 16, 64, 32).direction(Vec2::splat(0.5));
        assert!(sky.radiance(bright, 0.0).x > 2.9);
    }
}
