//! A probe: irradiance at one texel from all directions, by stratified rays into the coarse solution.

use super::footprint::Footprint;
use super::source::Source;
use crate::accel::offset_origin;
use crate::math::{Sequence, cosine_hemisphere, hash2};
use crate::scene::Rgb;
use std::f32::consts::PI;

/// How many rays a probe casts.
#[derive(Clone, Copy, Debug)]
pub struct ProbeSettings {
    /// Rays per round, a power of two.
    pub round: u32,
    /// Most rounds.
    pub rounds: u32,
    /// Standard error, relative to the irradiance, at which a probe is content.
    pub tolerance: f32,
    /// Irradiance below which errors do not matter, W/m².
    pub floor: f32,
}

/// Irradiance at a texel, with what is needed to judge how far it reaches.
#[derive(Clone, Copy, Debug, Default)]
pub struct Probe {
    /// W/m².
    pub irradiance: Rgb,
    /// Harmonic mean distance to what is seen, metres.
    pub distance: f32,
    /// Standard error of the irradiance's mean channel, W/m².
    pub error: f32,
    /// Rays cast.
    pub rays: u32,
}

impl Probe {
    /// Gathers at `texel`. Rays start all over the texel's usable part, so that the value is its mean.
    pub fn gather(source: &Source, footprint: &Footprint, texel: u32, settings: &ProbeSettings) -> Self {
        let sequence = Sequence::new(hash2(texel, 0x9a7e));
        let (mut sum, mut inverse) = (Rgb::ZERO, 0.0f32);
        let mut rays = 0;
        let (mut square_rounds, mut error) = (0.0f32, f32::INFINITY);
        for round in 0..settings.rounds {
            // Halves of a round are stratified themselves: their difference tells the error.
            let mut halves = [Rgb::ZERO; 2];
            for (h, half) in halves.iter_mut().enumerate() {
                let n = settings.round / 2;
                for i in 0..n {
                    let index = round * settings.round + h as u32 * n + i;
                    let p = footprint.point(texel, sequence.second(index));
                    let direction = cosine_hemisphere(p.shading_normal, sequence.first(index));
                    if direction.dot(p.geometric_normal) <= 0.0 {
                        continue;
                    }
                    let origin = offset_origin(p.position, p.geometric_normal);
                    // Cosine-weighted rays stand for more of the view towards the horizon.
                    let cosine = direction.dot(p.shading_normal).max(0.05);
                    let solid_angle = PI / (settings.round as f32 * cosine);
                    let seen = source.look(origin, direction, solid_angle);
                    *half += seen.radiance;
                    inverse += 1.0 / seen.distance.max(1e-6);
                }
            }
            rays += settings.round;
            sum += halves[0] + halves[1];
            let difference = (halves[0] - halves[1]).element_sum() / 3.0;
            square_rounds += difference * difference;
            error = PI * square_rounds.sqrt() / rays as f32;
            let mean = PI * sum.element_sum() / 3.0 / rays as f32;
            // Full stratification does about twice as well as two independent halves would.
            if 0.5 * error <= settings.tolerance * (mean + settings.floor) {
                break;
            }
        }
        Self { irradiance: sum * (PI / rays as f32), distance: rays as f32 / inverse.max(1e-12), error, rays }
    }
}
