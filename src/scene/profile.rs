//! Photometric profiles: how the intensity of a lamp varies with direction, as goniometers measure it.
//!
//! In the lamp's frame the beam (both angles zero) leaves along −Z, and the zero plane holds −Z and +X, as in
//! EXT_lights_ies. Based on: ANSI/IES LM-63-19 (types B and C of photometry and their symmetries).

use glam::Vec3;

/// How directions are measured. Angles in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Photometry {
    /// Vertical angles 0..=180 from the beam, horizontal ones 0..360 counter-clockwise seen from behind the lamp.
    C,
    /// Vertical angles −90..=90 within planes that share the X axis, horizontal ones −90..=90 that tell the planes
    /// apart, clockwise.
    B,
}

/// Which part of the horizontal circle is given; the rest mirrors it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Symmetry {
    /// The same in every plane.
    Axial,
    /// 0..90, mirrored at both main planes. Type B: mirrored at the zero plane.
    Quadrant,
    /// 0..180.
    Half,
    /// 90..270, as LM-63-1995 allows.
    SideHalf,
    /// Everything.
    None,
}

/// Intensities on a grid of angles.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    photometry: Photometry,
    symmetry: Symmetry,
    /// Ascending, degrees.
    vertical: Vec<f32>,
    /// Ascending, degrees.
    horizontal: Vec<f32>,
    /// Relative intensities, one row of verticals per horizontal angle; their maximum is 1.
    relative: Vec<f32>,
    /// Candela where `relative` is 1.
    peak: f32,
}

impl Profile {
    /// Takes ascending angles in degrees and finite, non-negative candela, a row of verticals per horizontal angle.
    /// Fails with the reason if the angles are none that the standard knows, or if it gives no light.
    pub fn new(
        photometry: Photometry,
        vertical: Vec<f32>,
        mut horizontal: Vec<f32>,
        mut candela: Vec<f32>,
    ) -> Result<Self, String> {
        let (Some(&first), Some(&last)) = (horizontal.first(), horizontal.last()) else {
            return Err("it has no angles".into());
        };
        if vertical.is_empty() || candela.len() != vertical.len() * horizontal.len() {
            return Err("its numbers of angles and intensities differ".into());
        }
        let near = |a: f32, b: f32| (a - b).abs() < 0.5;
        let symmetry = match photometry {
            _ if horizontal.len() == 1 => Symmetry::Axial,
            Photometry::B if near(first, 0.0) && last <= 90.5 => Symmetry::Quadrant,
            Photometry::B if first >= -90.5 && last <= 90.5 => Symmetry::None,
            Photometry::C if near(first, 0.0) && near(last, 90.0) => Symmetry::Quadrant,
            Photometry::C if near(first, 0.0) && near(last, 180.0) => Symmetry::Half,
            Photometry::C if near(first, 90.0) && near(last, 270.0) => Symmetry::SideHalf,
            Photometry::C if near(first, 0.0) && last > 180.0 && last <= 360.5 => Symmetry::None,
            _ => return Err(format!("its horizontal angles from {first}° to {last}° leave part of the circle open")),
        };
        if photometry == Photometry::C && symmetry == Symmetry::None && !near(last, 360.0) {
            // Files that leave out the last plane mean the first.
            horizontal.push(360.0);
            candela.extend_from_within(..vertical.len());
        }
        let peak = candela.iter().copied().fold(0.0, f32::max);
        if peak <= 0.0 {
            return Err("all its intensities are zero".into());
        }
        let relative = candela.iter().map(|c| c / peak).collect();
        Ok(Self { photometry, symmetry, vertical, horizontal, relative, peak })
    }

    /// Largest intensity, candela.
    pub fn peak(&self) -> f32 {
        self.peak
    }

    /// Intensity towards unit direction `d` in the lamp's frame as a share of the largest, bilinear in the angles; zero
    /// where nothing was measured.
    pub fn relative(&self, d: Vec3) -> f32 {
        let (horizontal, vertical) = match self.photometry {
            Photometry::C => {
                // atan2 keeps its precision where acos loses it: along the beam.
                let vertical = d.x.hypot(d.y).atan2(-d.z).to_degrees();
                (d.y.atan2(d.x).to_degrees().rem_euclid(360.0), vertical)
            }
            Photometry::B => {
                let vertical = d.x.clamp(-1.0, 1.0).asin().to_degrees();
                ((-d.y).atan2(-d.z).to_degrees(), vertical)
            }
        };
        let mirrored = self.photometry == Photometry::B && self.vertical[0] >= 0.0;
        let vertical = if mirrored { vertical.abs() } else { vertical };
        let (Some(h), Some(v)) =
            (bracket(&self.horizontal, self.folded(horizontal)), bracket(&self.vertical, vertical))
        else {
            return 0.0;
        };
        let at = |h: usize, v: usize| self.relative[h * self.vertical.len() + v];
        let row = |h: usize| at(h, v.0) + (at(h, v.1) - at(h, v.0)) * v.2;
        row(h.0) + (row(h.1) - row(h.0)) * h.2
    }

    /// The horizontal angle that was measured in place of another.
    fn folded(&self, angle: f32) -> f32 {
        let half = angle.min(360.0 - angle);
        match (self.symmetry, self.photometry) {
            // One plane stands for all; in type B it stands for as much as can be seen through it.
            (Symmetry::Axial, _) => self.horizontal[0],
            (Symmetry::Quadrant, Photometry::B) => angle.abs(),
            (Symmetry::Quadrant, Photometry::C) => half.min(180.0 - half),
            (Symmetry::Half, _) => half,
            (Symmetry::SideHalf, _) if angle < 90.0 => 180.0 - angle,
            (Symmetry::SideHalf, _) if angle > 270.0 => 540.0 - angle,
            _ => angle,
        }
    }
}

/// The two grid angles around `angle` and how far it is from the first to the second; none outside of the grid.
fn bracket(grid: &[f32], angle: f32) -> Option<(usize, usize, f32)> {
    // Rounding must not lose the ends.
    const SLACK: f32 = 1e-3;
    let last = grid.len() - 1;
    if !(angle >= grid[0] - SLACK && angle <= grid[last] + SLACK) {
        return None;
    }
    let upper = grid.partition_point(|&g| g <= angle).clamp(1, last.max(1)).min(last);
    let lower = upper.saturating_sub(1);
    let step = grid[upper] - grid[lower];
    let share = if step > 0.0 { ((angle - grid[lower]) / step).clamp(0.0, 1.0) } else { 0.0 };
    Some((lower, upper, share))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Direction at type-C angles, degrees.
    fn towards(horizontal: f32, vertical: f32) -> Vec3 {
        let (h, v) = (horizontal.to_radians(), vertical.to_radians());
        Vec3::new(v.sin() * h.cos(), v.sin() * h.sin(), -v.cos())
    }

    fn check(profile: &Profile, d: Vec3, expected: f32) {
        let got = profile.relative(d) * profile.peak();
        assert!((got - expected).abs() < 1e-3, "{d}: {got} instead of {expected}");
    }

    #[test]
    fn angles_are_interpolated_and_planes_mirrored() {
        let of = |horizontal: &[f32]| {
            // 10 cd more per plane, 1 cd less per degree from the beam.
            let candela = horizontal.iter().enumerate().flat_map(|(i, _)| [90.0, 0.0].map(|c| c + 10.0 * i as f32));
            Profile::new(Photometry::C, vec![0.0, 90.0], horizontal.to_vec(), candela.collect()).expect("it is sound")
        };
        let axial = of(&[0.0]);
        check(&axial, towards(77.0, 30.0), 60.0);
        check(&axial, towards(10.0, 90.0), 0.0);
        check(&axial, towards(10.0, 120.0), 0.0);
        let quadrant = of(&[0.0, 90.0]);
        for h in [45.0, 135.0, 225.0, 315.0] {
            check(&quadrant, towards(h, 45.0), 50.0);
        }
        let half = of(&[0.0, 90.0, 180.0]);
        check(&half, towards(135.0, 45.0), 60.0);
        check(&half, towards(225.0, 45.0), 60.0);
        let side = of(&[90.0, 180.0, 270.0]);
        check(&side, towards(0.0, 45.0), 55.0);
        check(&side, towards(270.0, 45.0), 65.0);
        check(&side, towards(315.0, 45.0), 60.0);
        let full = of(&[0.0, 90.0, 180.0, 270.0]);
        check(&full, towards(225.0, 45.0), 70.0);
        check(&full, towards(315.0, 45.0), 60.0);
    }

    #[test]
    fn type_b_has_its_poles_on_the_x_axis() {
        let profile =
            Profile::new(Photometry::B, vec![0.0, 90.0], vec![-90.0, 0.0, 90.0], vec![10.0, 0.0, 40.0, 0.0, 20.0, 0.0])
                .expect("it is sound");
        let half = std::f32::consts::FRAC_1_SQRT_2;
        check(&profile, Vec3::NEG_Z, 40.0);
        check(&profile, Vec3::new(half, 0.0, -half), 20.0);
        check(&profile, Vec3::new(-half, 0.0, -half), 20.0);
        check(&profile, Vec3::new(0.0, -half, -half), 30.0);
        check(&profile, Vec3::new(0.0, half, -half), 25.0);
        check(&profile, Vec3::Z, 0.0);
    }

    #[test]
    fn circles_that_stay_open_are_refused() {
        let of = |horizontal: Vec<f32>| {
            let candela = vec![1.0; horizontal.len()];
            Profile::new(Photometry::C, vec![0.0], horizontal, candela)
        };
        assert!(of(vec![0.0, 45.0]).is_err());
        assert!(of(vec![30.0, 390.0]).is_err());
        assert!(of(vec![]).is_err());
    }
}
