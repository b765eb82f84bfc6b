//! Light off a small patch that a lamp makes bright: against the sum over the patch, with a screen in its way.

use super::grey;
use super::rooms::{Room, baked};
use glam::Vec3;
use lightkiln::scene::{Falloff, Light, LightShape, Rgb};
use std::f32::consts::PI;

/// The screen's plane, and the height up to which it hides the floor.
const SCREEN: f32 = 3.0;
const TOP: f32 = 0.8;

#[test]
fn what_a_bright_patch_sends_is_the_sum_over_it() {
    let mut room = Room::default();
    let (floor, black) = (grey(0.0, 0.8), grey(0.0, 0.0));
    room.inside_of_box(Vec3::ZERO, Vec3::new(4.0, 3.0, 4.0), [black, black, floor, black, black, black]);
    for (origin, u) in [(Vec3::new(SCREEN, 0.0, 0.0), Vec3::Z), (Vec3::new(SCREEN, 0.0, 4.0), Vec3::NEG_Z)] {
        room.quad(origin, Vec3::Y * TOP, u * 4.0, black);
    }
    let mut scene = room.scene();
    scene.lights.push(Light {
        name: "Spot".into(),
        path: "Spot".into(),
        group: None,
        casts_shadows: true,
        position: Vec3::new(1.0, 2.5, 2.0),
        // Shines straight down.
        axes: [Vec3::X, Vec3::NEG_Z, Vec3::Y],
        shape: LightShape::Spot {
            intensity: Rgb::splat(100.0),
            radius: 0.0,
            outer_cone_angle: 0.15,
            blend: 0.5,
            falloff: Falloff::Smoothstep,
        },
        profile: None,
        faces_receivers: false,
    });
    let b = baked(&scene, 8.0, 0.01);
    let t = &b.texels;
    let direct = |i: usize| b.light.direct[i].x;
    let patch: Vec<usize> = (0..t.len()).filter(|&i| t.position[i].y < 1e-3 && direct(i) > 0.0).collect();
    assert!(patch.len() > 10, "the spot's cone covers texels");
    let (mut open, mut hidden, mut squares) = (0, 0, 0.0f32);
    for i in (0..t.len()).filter(|&i| (t.position[i].x - 4.0).abs() < 1e-3) {
        let (p, got) = (t.position[i], b.light.combined[i].x - direct(i));
        // Height at which the line to the patch's middle passes the screen.
        let over = p.y * (SCREEN - 1.0) / (4.0 - 1.0);
        if over > TOP + 0.3 {
            let from = |&s: &usize| {
                let v = t.position[s] - p;
                let d2 = v.length_squared();
                0.8 / PI * direct(s) * t.area[s] * (-v.x) * (-v.y) / (d2 * d2)
            };
            let want: f32 = patch.iter().map(from).sum();
            // The wall is dim beside the scene's mean, by which errors of single texels are measured.
            assert!((got / want - 1.0).abs() < 0.04, "{p}: {got} instead of {want}");
            squares += (got / want - 1.0).powi(2);
            open += 1;
        } else if over < TOP - 0.3 {
            assert!(got < 1e-4 * direct(patch[patch.len() / 2]), "{p}: {got} behind the screen");
            hidden += 1;
        }
    }
    let rms = (squares / open as f32).sqrt();
    assert!(rms < 0.01, "relative error {rms}");
    assert!(open > 50 && hidden > 50, "{open} texels see the patch, {hidden} do not");
}
