//! Meshes that cast no shadow: what shines passes them, they emit and reflect, and what they reflect hides what others
//! do. Engine and audit against closed forms.

use super::audit::check_paths;
use super::grey;
use super::rooms::{Baked, Room, add, baked, mean};
use glam::Vec3;
use lightkiln::scene::{Environment, LightmapRequest, Rgb, Scene};
use std::f32::consts::PI;

/// The inside of a box around the origin.
fn room(size: f32, radiance: f32, reflectance: f32) -> Room {
    let mut room = Room::default();
    room.inside_of_box(Vec3::splat(-0.5 * size), Vec3::splat(size), [grey(radiance, reflectance); 6]);
    room
}

/// A square with its front down, at a height.
fn ceiling(height: f32, size: f32, radiance: f32, reflectance: f32) -> Scene {
    let mut room = Room::default();
    room.quad(Vec3::new(-0.5 * size, height, -0.5 * size), Vec3::X * size, Vec3::Z * size, grey(radiance, reflectance));
    room.scene()
}

/// Holds bake and audit against one value at all texels that `choose` takes.
fn check(scene: &Scene, texels_per_metre: f32, want: f32, choose: impl Fn(Vec3) -> bool) {
    let b = baked(scene, texels_per_metre, 0.01);
    let got = mean(&b.where_at(|p, _| choose(p)));
    assert!((got / want - 1.0).abs() < 0.005, "{got} instead of {want}");
    let texels: Vec<usize> = (0..b.texels.len()).filter(|&t| choose(b.texels.position[t])).collect();
    check_paths(scene, &b, &texels, 0.005, |_| want);
}

#[test]
fn a_furnace_without_shadow_adds_to_what_shines_behind_it() {
    // All that the inner box sees is L + L' + ρH/π, where L' shines behind its walls.
    let (inside, outside, reflectance) = (0.3, 0.7, 0.5);
    let want = PI * (inside + outside) / (1.0 - reflectance);
    let is_inner = |p: Vec3| p.abs().max_element() < 0.51;
    for lightmap in [LightmapRequest::Default, LightmapRequest::None] {
        let mut scene = room(1.0, inside, reflectance).scene();
        scene.instances[0].casts_shadows = false;
        // What the outer box reflects is hidden.
        add(&mut scene, room(2.0, outside, 0.8).scene(), true);
        scene.instances[1].lightmap = lightmap;
        check(&scene, 12.0, want, is_inner);
    }
    let mut scene = room(1.0, inside, reflectance).scene();
    scene.instances[0].casts_shadows = false;
    scene.environment = Environment::Constant(Rgb::splat(outside));
    check(&scene, 12.0, want, is_inner);
}

#[test]
fn lamps_and_emitters_shine_through_it() {
    // A square of 1 m at 1 m above a black floor that is small enough for the form factor at its middle.
    let floor = || {
        let mut room = Room::default();
        room.quad(Vec3::new(-0.05, 0.0, -0.05), Vec3::Z * 0.1, Vec3::X * 0.1, grey(0.0, 0.0));
        room.scene()
    };
    for casts in [true, false] {
        let mut scene = floor();
        add(&mut scene, ceiling(1.0, 1.0, 1.0, 0.0), casts);
        // In between, black and larger.
        add(&mut scene, ceiling(0.5, 3.0, 0.0, 0.0), false);
        scene.instances.iter_mut().skip(1).for_each(|i| i.lightmap = LightmapRequest::None);
        check(&scene, 40.0, PI * 0.2394565, |p| p.y < 0.1);
    }
}

#[test]
fn it_bounces() {
    // The floor is lit by what lies above the plate that it faces, E, and the two reflect: H = E/(1 − ρρ').
    let size = 60.0;
    let mut scene = Room::default();
    scene.quad(Vec3::new(-0.5 * size, 0.0, -0.5 * size), Vec3::Z * size, Vec3::X * size, grey(0.0, 0.5));
    let mut scene = scene.scene();
    add(&mut scene, ceiling(0.5, size, 0.0, 0.8), false);
    add(&mut scene, ceiling(1.0, size, 1.0, 0.9), true);
    check(&scene, 1.0, PI / 0.6, |p| p.y < 0.1 && p.x.hypot(p.z) < 3.0);
}

#[test]
fn its_texels_receive_light() {
    let mut scene = ceiling(1.0, 1.0, 0.0, 0.5);
    scene.instances[0].casts_shadows = false;
    scene.environment = Environment::Gradient { zenith: Rgb::ZERO, horizon: Rgb::ZERO, ground: Rgb::ONE };
    let Baked { light, .. } = baked(&scene, 16.0, 0.01);
    assert!(light.combined.iter().all(|e| (e.x / PI - 1.0).abs() < 0.005), "{:?}", light.combined[0]);
}
