//! Irradiance below and beside every kind of lamp, from the lamp's shape to the texel, against closed forms and brute
//! force quadrature in f64.

use super::audit::check_paths;
use super::rooms::{Face, Room, baked};
use glam::{DVec3, Vec3};
use lightkiln::scene::{Falloff, Light, LightShape, Photometry, Profile, Rgb};
use std::collections::{BTreeMap, HashMap};
use std::f64::consts::PI;
use std::sync::Arc;

/// Height of the lamps above the floor, metres.
const HEIGHT: f64 = 2.0;
/// Texels of the floor per metre.
const DENSITY: f64 = 16.0;
/// Points along a texel's side at which an expected value is averaged, where it has sharp edges, and where those are rims.
const PARTS: usize = 4;
const FINE_PARTS: usize = 32;
const RIM_PARTS: usize = 128;
/// Share of the tolerance of single texels that the mean of a row of 16 may miss. It is more than noise leaves, because
/// a texel that sees a sliver of a lamp which its first rays miss is dark.
const OF_ROWS: f64 = 0.6;

/// A lamp above the origin that shines down, its Y axis along −Z.
fn lamp(shape: LightShape) -> Light {
    Light {
        name: "Lamp".into(),
        path: "Lamp".into(),
        group: None,
        casts_shadows: true,
        position: Vec3::Y * HEIGHT as f32,
        axes: [Vec3::X, Vec3::NEG_Z, Vec3::Y],
        shape,
        profile: None,
        faces_receivers: false,
    }
}

/// A black floor from below the lamp to its side.
fn floor() -> Room {
    let mut room = Room::default();
    let black = Face { radiance: 0.0, reflectance: 0.0 };
    room.quad(Vec3::new(-0.5, 0.0, -0.5), Vec3::Z, Vec3::X * 3.0, black);
    room
}

/// Every texel within `tolerance` of the mean of `expected` over its square, relatively or, where it gets less than a
/// third of the most, relatively to that. Holds both the bake and the paths of the audit against it.
fn check(room: Room, light: Light, tolerance: f64, expected: impl Fn(DVec3) -> f64) {
    check_in_parts(room, light, tolerance, PARTS, expected);
}

/// As [`check`], with so many points along a texel's side.
fn check_in_parts(room: Room, light: Light, tolerance: f64, parts: usize, expected: impl Fn(DVec3) -> f64) {
    let what = format!("{:?}", light.shape);
    let mut scene = room.scene();
    scene.lights.push(light);
    let b = baked(&scene, DENSITY as f32, 0.01);
    let offsets: Vec<f64> = (0..parts).map(|i| ((i as f64 + 0.5) / parts as f64 - 0.5) / DENSITY).collect();
    let mean = |p: Vec3| {
        let around = offsets.iter().flat_map(|&x| offsets.iter().map(move |&z| DVec3::new(x, 0.0, z)));
        around.map(|o| expected(p.as_dvec3() + o)).sum::<f64>() / (parts * parts) as f64
    };
    let floor: Vec<usize> =
        (0..b.texels.len()).filter(|&i| b.texels.position[i].y < 0.1 && b.texels.coverage[i] > 0.99).collect();
    let want: Vec<f64> = floor.iter().map(|&i| mean(b.texels.position[i])).collect();
    let most = want.iter().copied().fold(0.0, f64::max);
    assert!(most > 0.0 && floor.len() > 400, "{what} lights something");
    for (&i, &want) in floor.iter().zip(&want) {
        let got = b.light.combined[i].x as f64;
        let miss = (got - want).abs() / want.max(0.3 * most);
        assert!(miss < tolerance, "{what}: {got} instead of {want} at {}", b.texels.position[i]);
    }
    // Noise of single texels goes away over rows of them.
    let mut rows: BTreeMap<i64, (f64, f64)> = BTreeMap::new();
    for (&i, &want) in floor.iter().zip(&want) {
        let row = rows.entry((f64::from(b.texels.position[i].x) * DENSITY).floor() as i64).or_default();
        *row = (row.0 + b.light.combined[i].x as f64, row.1 + want);
    }
    let most = rows.values().map(|row| row.1).fold(0.0, f64::max);
    for (x, (got, want)) in &rows {
        let miss = (got - want).abs() / want.max(0.3 * most);
        assert!(miss < (OF_ROWS * tolerance).max(0.005), "{what}: {got} instead of {want} in row {x}");
    }
    let wanted: HashMap<usize, f64> = floor.iter().copied().zip(want).collect();
    check_paths(&scene, &b, &floor, tolerance as f32, |t| wanted[&t] as f32);
}

/// Vector from the point to the lamp's centre, its squared length, and the cosine at both ends.
fn towards(p: DVec3) -> (f64, f64) {
    let v = DVec3::Y * HEIGHT - p;
    (v.length_squared(), HEIGHT / v.length())
}

/// Irradiance from a rectangle or an ellipse, by the midpoint rule in its sides or in squared radius and angle; `radiance`
/// goes by the cosine.
fn flat(p: DVec3, size: [f64; 2], round: bool, radiance: impl Fn(f64) -> f64) -> f64 {
    let n = 48;
    let place = |i: usize| (i as f64 + 0.5) / n as f64;
    let mut sum = 0.0;
    for i in 0..n * n {
        let (u, v) = (place(i % n), place(i / n));
        let (x, y) = match round {
            true => (u.sqrt() * (2.0 * PI * v).cos(), u.sqrt() * (2.0 * PI * v).sin()),
            false => (2.0 * u - 1.0, 2.0 * v - 1.0),
        };
        let v = DVec3::new(0.5 * size[0] * x, HEIGHT, 0.5 * size[1] * y) - p;
        let (d2, cosine) = (v.length_squared(), HEIGHT / v.length());
        sum += radiance(cosine) * cosine * cosine / d2;
    }
    let share = if round { PI / 4.0 } else { 1.0 };
    sum * share * size[0] * size[1] / (n * n) as f64
}

#[test]
fn points_and_spheres() {
    for radius in [0.0, 0.3] {
        check(floor(), lamp(LightShape::Point { intensity: Rgb::splat(3.0), radius }), 0.005, |p| {
            let (d2, cosine) = towards(p);
            3.0 * cosine / d2
        });
    }
}

#[test]
fn disks_that_face_their_receivers() {
    let light = Light { faces_receivers: true, ..lamp(LightShape::Point { intensity: Rgb::splat(3.0), radius: 0.3 }) };
    check(floor(), light, 0.005, |p| {
        let (d2, cosine) = towards(p);
        3.0 * cosine / (d2 + 0.09)
    });
}

#[test]
fn spots_fade_along_blenders_curve() {
    for blend in [0.0, 0.15, 0.7] {
        let outer = 0.6f64;
        let shape = LightShape::Spot {
            intensity: Rgb::ONE,
            radius: 0.0,
            outer_cone_angle: outer as f32,
            blend: blend as f32,
            falloff: Falloff::Smoothstep,
        };
        // A hard rim cuts texels: their value is a share of points.
        let (tolerance, parts) = if blend == 0.0 { (0.02, RIM_PARTS) } else { (0.005, PARTS) };
        check_in_parts(floor(), lamp(shape), tolerance, parts, |p| {
            let (d2, cosine) = towards(p);
            let x = (cosine - outer.cos()) / ((1.0 - outer.cos()) * blend).max(1e-9);
            let x = x.clamp(0.0, 1.0);
            x * x * (3.0 - 2.0 * x) * cosine / d2
        });
    }
}

#[test]
fn suns_at_an_angle() {
    for angle in [0.0, 0.2] {
        let mut sun = lamp(LightShape::Sun { irradiance: Rgb::splat(4.0), angle });
        let (y, z) = (Vec3::new(-0.5, 0.75f32.sqrt(), 0.0), Vec3::new(0.75f32.sqrt(), 0.5, 0.0));
        sun.axes = [y.cross(z), y, z];
        check(floor(), sun, 0.005, |_| 2.0);
    }
}

#[test]
fn a_suns_penumbra_is_as_wide_as_its_disc() {
    // A wall's edge one metre above the floor at x = 0.8 blocks the sky beyond it.
    let mut room = floor();
    room.quad(Vec3::new(0.8, 1.0, -2.0), Vec3::X * 3.0, Vec3::Z * 4.0, Face { radiance: 0.0, reflectance: 0.0 });
    let angle = 0.4f64;
    let sun = lamp(LightShape::Sun { irradiance: Rgb::ONE, angle: angle as f32 });
    let radius = (0.5 * angle).tan();
    check_in_parts(room, sun, 0.15, FINE_PARTS, |p| {
        // Share of the disc on the open side of a chord.
        let c = ((p.x - 0.8) / radius).clamp(-1.0, 1.0);
        (c.acos() - c * (1.0 - c * c).sqrt()) / PI
    });
}

#[test]
fn rectangles_and_ellipses() {
    let size = [0.8f64, 0.4];
    let dimensions = size.map(|s| s as f32);
    let pi = PI as f32;
    check(floor(), lamp(LightShape::Rect { radiance: Rgb::ONE, size: dimensions, spread: pi }), 0.005, |p| {
        flat(p, size, false, |_| 1.0)
    });
    check(floor(), lamp(LightShape::Disk { radiance: Rgb::ONE, size: dimensions, spread: pi }), 0.005, |p| {
        flat(p, size, true, |_| 1.0)
    });
}

#[test]
fn the_spread_of_area_lamps() {
    for spread in [0.6f64, 1.3, 2.6] {
        let half = 0.5 * spread;
        let grid = |cosine: f64| ((half.tan() - cosine.acos().tan()) / (half.tan() - half)).max(0.0);
        let size = [0.8f64, 0.4];
        let (radiance, spread) = (Rgb::ONE, spread as f32);
        check(floor(), lamp(LightShape::Rect { radiance, size: [0.8, 0.4], spread }), 0.005, |p| {
            flat(p, size, false, grid)
        });
        check(floor(), lamp(LightShape::Disk { radiance, size: [0.8, 0.4], spread }), 0.005, |p| {
            flat(p, size, true, grid)
        });
    }
}

#[test]
fn the_narrowest_beam_keeps_its_power_within_the_lamps_outline() {
    let light = lamp(LightShape::Rect { radiance: Rgb::ONE, size: [0.75, 0.75], spread: 0.0 });
    check_in_parts(floor(), light, 0.03, FINE_PARTS, |p| if p.x.abs() < 0.375 && p.z.abs() < 0.375 { PI } else { 0.0 });
}

#[test]
fn measured_profiles() {
    // 100 cd less a candela per degree, twice that in the plane across.
    let vertical: Vec<f32> = (0..=9).map(|i| 10.0 * i as f32).collect();
    let candela = [1.0, 2.0].iter().flat_map(|k| vertical.iter().map(move |v| k * (100.0 - v))).collect();
    let profile = Profile::new(Photometry::C, vertical, vec![0.0, 90.0], candela).expect("the profile is sound");
    let light =
        Light { profile: Some(Arc::new(profile)), ..lamp(LightShape::Point { intensity: Rgb::ONE, radius: 0.0 }) };
    check(floor(), light, 0.005, |p| {
        let (d2, cosine) = towards(p);
        let plane = p.z.abs().atan2(p.x.abs()).to_degrees() / 90.0;
        (1.0 + plane) * (100.0 - cosine.acos().to_degrees()) / 200.0 * cosine / d2
    });
}
