//! Counter-based randomness: every value is a pure function of what it is for (texel, node, index), never of a thread.
//!
//! Based on: Burley, "Practical Hash-based Owen Scrambling", 2020 (nested scrambling by a Laine–Karras hash).

use glam::Vec2;

/// Mixes one 32-bit word to another, bijectively (murmur3 finaliser).
fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x85eb_ca6b);
    x ^= x >> 13;
    x = x.wrapping_mul(0xc2b2_ae35);
    x ^ (x >> 16)
}

/// Hash of two words.
pub fn hash2(a: u32, b: u32) -> u32 {
    mix(a.wrapping_mul(0x9e37_79b9) ^ mix(b.wrapping_add(0x7f4a_7c15)))
}

/// Hash of three words.
pub fn hash3(a: u32, b: u32, c: u32) -> u32 {
    hash2(hash2(a, b), c)
}

/// Upper 24 bits as a float in 0..1 (1 excluded).
pub fn unit_float(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / (1 << 24) as f32)
}

/// Owen-scrambles the bit-reversed sample `x`.
fn scramble(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits();
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

/// Direction numbers of the first four Sobol dimensions (Joe and Kuo, 2008): degree, coefficients, initial values.
const DIMENSIONS: [(usize, u32, [u32; 3]); 4] =
    [(0, 0, [0; 3]), (1, 0, [1, 0, 0]), (2, 1, [1, 3, 0]), (3, 1, [1, 3, 1])];

/// `DIRECTIONS[d][k]` is XORed into dimension `d` where bit `k` of the index is set.
static DIRECTIONS: [[u32; 32]; 4] = directions();

const fn directions() -> [[u32; 32]; 4] {
    let mut out = [[0; 32]; 4];
    let mut d = 0;
    while d < 4 {
        let (degree, coefficients, initial) = DIMENSIONS[d];
        let mut k = 0;
        while k < 32 {
            out[d][k] = if degree == 0 {
                1 << (31 - k)
            } else if k < degree {
                initial[k] << (31 - k)
            } else {
                let mut v = out[d][k - degree] ^ (out[d][k - degree] >> degree);
                let mut j = 1;
                while j < degree {
                    if (coefficients >> (degree - 1 - j)) & 1 == 1 {
                        v ^= out[d][k - j];
                    }
                    j += 1;
                }
                v
            };
            k += 1;
        }
        d += 1;
    }
    out
}

/// The first points of every dimension: most indices are small.
static POINTS: [[u32; POINT_COUNT]; 4] = points();
const POINT_COUNT: usize = 256;

const fn points() -> [[u32; POINT_COUNT]; 4] {
    let directions = directions();
    let mut out = [[0; POINT_COUNT]; 4];
    let mut d = 0;
    while d < 4 {
        let mut i = 1;
        while i < POINT_COUNT {
            // What its lowest bit adds to the point without it.
            out[d][i] = out[d][i & (i - 1)] ^ directions[d][i.trailing_zeros() as usize];
            i += 1;
        }
        d += 1;
    }
    out
}

/// Coordinate `dimension` of Sobol point `index`, as a 32-bit fraction.
fn sobol(dimension: usize, mut index: u32) -> u32 {
    let mut x = POINTS[dimension][index as usize % POINT_COUNT];
    index -= index % POINT_COUNT as u32;
    while index != 0 {
        x ^= DIRECTIONS[dimension][index.trailing_zeros() as usize];
        index &= index - 1;
    }
    x
}

/// An Owen-scrambled Sobol sequence in four dimensions. Its first two and its last two coordinates are each
/// stratified over every run of 2ⁿ points that starts at a multiple of 2ⁿ. Seeds give independent randomisations.
#[derive(Clone, Copy, Debug)]
pub struct Sequence {
    seed: u32,
}

impl Sequence {
    /// The randomisation that belongs to `seed`.
    pub fn new(seed: u32) -> Self {
        Self { seed: mix(seed) }
    }

    /// First two coordinates of point `index`: a (0, 2)-sequence.
    pub fn first(&self, index: u32) -> Vec2 {
        self.pair(index, 0)
    }

    /// Last two coordinates of point `index`.
    pub fn second(&self, index: u32) -> Vec2 {
        self.pair(index, 2)
    }

    fn pair(&self, index: u32, dimension: u32) -> Vec2 {
        let axis = |d: u32| unit_float(scramble(sobol(d as usize, index), hash2(self.seed, d)));
        Vec2::new(axis(dimension), axis(dimension + 1))
    }
}

/// What takes the place of `index` in an order that is shuffled by `seed`; every run of 2ⁿ that starts at a multiple of 2ⁿ
/// stays such a run. Sequences that are used side by side need orders of their own: with the same one, the n-th points of
/// all of them lie in halves of the unit square that the lowest bit of n decides, whatever their seeds.
pub fn shuffled(index: u32, seed: u32) -> u32 {
    scramble(index, mix(seed))
}

/// Point `k` of a low-discrepancy sequence that begins at `u`, in the unit square: the plastic number keeps its points apart.
///
/// Based on: Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018.
pub fn shifted(u: Vec2, k: u32) -> Vec2 {
    (u + Vec2::new(0.754_877_7, 0.569_840_3) * k as f32).fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_power_of_two_run_is_stratified() {
        for seed in 0..50 {
            let s = Sequence::new(seed);
            for (nx, ny) in [(16, 1), (1, 16), (4, 4), (8, 2), (2, 8)] {
                let mut seen = vec![0; 16];
                for i in 32..48 {
                    let p = s.first(i);
                    seen[(p.x * nx as f32) as usize + nx * (p.y * ny as f32) as usize] += 1;
                }
                assert!(seen.iter().all(|&c| c == 1), "seed {seed}: {nx}x{ny} {seen:?}");
            }
        }
    }

    #[test]
    fn last_coordinates_are_stratified_each_and_together_with_the_first() {
        for seed in 0..50 {
            let s = Sequence::new(seed);
            let mut joint = vec![0; 16];
            let mut single = [[0; 64]; 2];
            for i in 0..64 {
                let (a, b) = (s.first(i), s.second(i));
                joint[(a.x * 4.0) as usize + 4 * (b.x * 4.0) as usize] += 1;
                single[0][(b.x * 64.0) as usize] += 1;
                single[1][(b.y * 64.0) as usize] += 1;
            }
            assert!(single.iter().flatten().all(|&c| c == 1), "seed {seed}");
            assert!(joint.iter().all(|&c| c == 4), "seed {seed}: {joint:?}");
        }
    }

    #[test]
    fn shuffled_sequences_are_independent_of_each_other() {
        let (a, b) = (Sequence::new(1), Sequence::new(2));
        let n = 4096;
        let products = (0..n).map(|i| a.first(i).x * b.first(shuffled(i, 3)).x);
        let mean = products.map(f64::from).sum::<f64>() / f64::from(n);
        assert!((mean - 0.25).abs() < 0.005, "{mean}");
        let mut run: Vec<u32> = (64..128).map(|i| shuffled(i, 5)).collect();
        run.sort_unstable();
        assert!(run[0].is_multiple_of(64) && run.windows(2).all(|w| w[1] == w[0] + 1));
    }

    #[test]
    fn means_over_seeds_are_unbiased() {
        let mean: Vec2 = (0..4096).map(|s| Sequence::new(s).first(3)).sum::<Vec2>() / 4096.0;
        assert!((mean - Vec2::splat(0.5)).length() < 0.02, "{mean}");
    }
}
