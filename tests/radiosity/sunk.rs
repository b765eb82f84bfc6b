//! Things that stand in a floor: a texel's value is the mean over its square, of which what lies inside them is dark.

use super::grey;
use super::rooms::{Room, add, baked};
use glam::Vec3;
use lightkiln::scene::{Light, LightShape, LightmapRequest, Rgb};
use std::ops::Range;

/// Texels of the floor per metre.
const DENSITY: f32 = 16.0;
/// The sun's irradiance on the floor, W/m².
const SUN: f32 = 2.0;

/// Length that two ranges share.
fn overlap(a: &Range<f32>, b: &Range<f32>) -> f32 {
    (a.end.min(b.end) - a.start.max(b.start)).max(0.0)
}

/// The sun in that frame.
fn sun(axes: [Vec3; 3]) -> Light {
    Light {
        name: "Sun".into(),
        path: "Sun".into(),
        group: None,
        casts_shadows: true,
        position: Vec3::Y,
        axes,
        shape: LightShape::Sun { irradiance: Rgb::splat(SUN), angle: 0.001 },
        profile: None,
        faces_receivers: false,
    }
}

/// A black box under the noon sun hides what it stands on, and nothing beside.
#[test]
fn what_lies_inside_is_dark() {
    let black = grey(0.0, 0.0);
    let mut room = Room::default();
    room.quad(Vec3::new(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, black);
    let mut scene = room.scene();
    let (x, z) = (-0.531f32..0.487, -0.377f32..0.693);
    let (low, size) = (Vec3::new(x.start, -0.2, z.start), Vec3::new(x.end - x.start, 0.7, z.end - z.start));
    let (u, v, w) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    let mut solid = Room::default();
    for (origin, a, b) in [(low, w, v), (low + u, v, w), (low, u, w), (low + v, w, u), (low, v, u), (low + w, u, v)] {
        solid.quad(origin, a, b, black);
    }
    let mut solid = solid.scene();
    solid.meshes[0].closed = true;
    add(&mut scene, solid, true);
    scene.instances[1].lightmap = LightmapRequest::None;
    // It shines along its −Z, straight down.
    scene.lights.push(sun([Vec3::X, Vec3::NEG_Z, Vec3::Y]));
    let b = baked(&scene, DENSITY, 0.02);
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0);
    for t in (0..b.texels.len()).filter(|&t| b.light.usable[t] && b.texels.coverage[t] > 0.99) {
        let p = b.texels.position[t];
        let half = 0.5 / DENSITY;
        let inside =
            overlap(&x, &(p.x - half..p.x + half)) * overlap(&z, &(p.z - half..p.z + half)) * DENSITY * DENSITY;
        let miss = b.light.combined[t].x / SUN - (1.0 - inside);
        assert!(miss.abs() < 0.15, "{p}: {miss} with {inside} of it inside");
        if inside > 0.01 {
            (squares, sum, count) = (squares + miss * miss, sum + miss, count + 1);
        }
    }
    let (rms, mean) = ((squares / count as f32).sqrt(), sum / count as f32);
    assert!(count > 40 && rms < 0.05 && mean.abs() < 0.02, "{count} texels: rms {rms}, mean {mean}");
}

/// A tent of one-sided sheets, open to one side: what lies in it sees backs nearly all around, and yet the sun.
#[test]
fn backs_do_not_make_an_inside_where_light_comes_in() {
    let black = grey(0.0, 0.0);
    let mut room = Room::default();
    room.quad(Vec3::new(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, black);
    let mut scene = room.scene();
    let (low, size) = (Vec3::new(-1.0, -0.1, -1.0), Vec3::new(2.0, 1.1, 2.0));
    let (u, v, w) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    let mut tent = Room::default();
    // All sides but that towards +X, and the roof.
    for (origin, a, b) in [(low, w, v), (low, v, u), (low + w, u, v), (low + v, w, u)] {
        tent.quad(origin, a, b, black);
    }
    add(&mut scene, tent.scene(), true);
    scene.instances[1].lightmap = LightmapRequest::None;
    // 45° high over +X.
    let z = Vec3::new(1.0, 1.0, 0.0).normalize();
    scene.lights.push(sun([Vec3::Z, z.cross(Vec3::Z), z]));
    let b = baked(&scene, DENSITY, 0.02);
    let margin = 1.0 / DENSITY;
    let mut counts = [0, 0];
    for t in (0..b.texels.len()).filter(|&t| b.texels.coverage[t] > 0.99) {
        let p = b.texels.position[t];
        // Under the roof, one metre high, the sun reaches one metre in.
        if p.z.abs() > 1.0 - margin || p.x.abs() > 1.0 - margin || p.x.abs() < margin {
            continue;
        }
        let want = if p.x > 0.0 { SUN * 0.5f32.sqrt() } else { 0.0 };
        assert!(p.x < 0.0 || b.light.usable[t], "{p} counts as an inside");
        assert!((b.light.combined[t].x - want).abs() < 0.02, "{p}: {} instead of {want}", b.light.combined[t].x);
        counts[usize::from(p.x > 0.0)] += 1;
    }
    assert!(counts.iter().all(|&n| n > 300), "{counts:?}");
}
