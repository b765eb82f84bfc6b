//! Draws one lamp out of many for a point, by how much it may bring.

use super::lamp::{Lamp, Shape};
use glam::Vec3;
use std::f32::consts::PI;

/// What is needed to guess what a lamp brings.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    centre: Vec3,
    /// Radius of a sphere around it, metres.
    radius: f32,
    /// Radiance × area or intensity of the brightest channel, W/sr; none for what is infinitely far.
    strength: Option<f32>,
}

impl Reach {
    pub(super) fn new(lamp: &Lamp) -> Self {
        match &lamp.shape {
            Shape::Polygon { centre, half, round, radiance, .. } => {
                let shape = if *round { PI } else { 4.0 };
                let strength = Some(radiance.max_element() * shape * half[0].cross(half[1]).length());
                Self { centre: *centre, radius: half[0].length().hypot(half[1].length()), strength }
            }
            Shape::Sphere { centre, radius, intensity, .. } => {
                Self { centre: *centre, radius: *radius, strength: Some(intensity.max_element()) }
            }
            Shape::Triangles { triangles, centre, radius, .. } => {
                let strength = triangles.iter().map(|t| t.area * t.radiance.max_element()).sum();
                Self { centre: *centre, radius: *radius, strength: Some(strength) }
            }
            Shape::Sun { .. } | Shape::Region(_) | Shape::Portal(_) => {
                Self { centre: Vec3::ZERO, radius: 0.0, strength: None }
            }
        }
    }

    /// About what the lamp brings to a point with unit normal `n`, W/m². Zero only if it brings nothing.
    fn guess(&self, lamp: &Lamp, p: Vec3, n: Vec3) -> f32 {
        let Some(strength) = self.strength else { return lamp.unoccluded(p, n).max_element() };
        let v = self.centre - p;
        if n.dot(v) < -self.radius {
            return 0.0;
        }
        strength / v.length_squared().max(self.radius * self.radius).max(1e-6)
    }
}

/// Draws a lamp for a point with unit normal `n` from `u` in 0..1, with its probability; none if no lamp reaches it.
pub(super) fn draw(lamps: &[Lamp], reaches: &[Reach], p: Vec3, n: Vec3, u: f32) -> Option<(usize, f32)> {
    let guesses = || lamps.iter().zip(reaches).map(|(lamp, reach)| reach.guess(lamp, p, n));
    let total: f32 = guesses().sum();
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let mut left = u * total;
    let mut last = None;
    for (i, guess) in guesses().enumerate().filter(|&(_, guess)| guess > 0.0) {
        last = Some((i, guess / total));
        left -= guess;
        if left < 0.0 {
            break;
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Rgb;

    fn bulb(x: f32, intensity: f32) -> Lamp {
        let shape = Shape::Sphere {
            centre: Vec3::new(x, 1.0, 0.0),
            radius: 0.1,
            faces_receivers: false,
            intensity: Rgb::splat(intensity),
            beam: None,
            web: None,
        };
        Lamp { shape, casts_shadows: true, group: 0 }
    }

    #[test]
    fn what_is_drawn_averages_to_the_sum() {
        let lamps = [bulb(0.0, 1.0), bulb(3.0, 5.0), bulb(-8.0, 40.0)];
        let reaches = lamps.each_ref().map(Reach::new);
        let (p, n) = (Vec3::ZERO, Vec3::Y);
        let count = 10_000;
        let mean = (0..count)
            .map(|i| {
                let (lamp, chance) = draw(&lamps, &reaches, p, n, (i as f32 + 0.5) / count as f32).expect("all reach");
                lamps[lamp].unoccluded(p, n).x / chance
            })
            .sum::<f32>()
            / count as f32;
        let sum: f32 = lamps.iter().map(|l| l.unoccluded(p, n).x).sum();
        assert!((mean / sum - 1.0).abs() < 1e-3, "{mean} instead of {sum}");
        assert!(draw(&lamps, &reaches, Vec3::Y * 5.0, Vec3::Y, 0.5).is_none());
    }
}
