//! Light through holes and through translucent surfaces.

use super::audit::check_paths;
use super::rooms::{Baked, Face, Room, add, baked, mean};
use glam::{Vec2, Vec3};
use lightkiln::math::{hash2, unit_float};
use lightkiln::scene::{
    AlphaMode, Environment, Filter, Light, LightShape, LightmapRequest, Material, Rgb, Scene, Texture, TextureSlot,
    Wrap,
};
use std::f32::consts::PI;

const BLACK: Face = Face { radiance: 0.0, reflectance: 0.0 };
const TEXELS: u32 = 64;

/// A black floor of 1 m under a card of `size` metres at a height of 1 m whose material is `card`.
fn under_card(size: f32, card: Material, alpha: impl Fn(u32) -> u8) -> Scene {
    let mut room = Room::default();
    room.quad(Vec3::new(-0.5, 0.0, -0.5), Vec3::Z, Vec3::X, BLACK);
    room.quad(Vec3::new(-0.5 * size, 1.0, -0.5 * size), Vec3::Z * size, Vec3::X * size, BLACK);
    let mut scene = room.scene();
    let uv = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::ZERO, Vec2::ONE, Vec2::Y];
    scene.meshes[0].texcoords[0][6..].copy_from_slice(&uv);
    let texels = (0..TEXELS * TEXELS).map(|i| [255, 255, 255, alpha(i)]).collect();
    scene.textures.push(Texture { name: "leaf".into(), width: TEXELS, height: TEXELS, texels });
    scene.materials[1] = card;
    scene
}

fn leaf(filter: Filter) -> Option<TextureSlot> {
    let transform = glam::Affine2::IDENTITY;
    Some(TextureSlot { texture: 0, set: 0, transform, wrap: [Wrap::Repeat; 2], filter })
}

fn with_sun(mut scene: Scene) -> Scene {
    scene.lights.push(Light {
        name: "Sun".into(),
        path: "Sun".into(),
        group: None,
        casts_shadows: true,
        position: Vec3::ZERO,
        axes: [Vec3::X, Vec3::NEG_Z, Vec3::Y],
        shape: LightShape::Sun { irradiance: Rgb::ONE, angle: 0.0 },
        profile: None,
        faces_receivers: false,
    });
    scene
}

/// Texels of the floor.
fn on_floor(b: &Baked) -> Vec<usize> {
    (0..b.texels.len()).filter(|&i| b.texels.position[i].y < 0.5).collect()
}

/// Mean irradiance of the floor.
fn floor(b: &Baked) -> Rgb {
    let texels = on_floor(b);
    let area: f32 = texels.iter().map(|&i| b.texels.area[i]).sum();
    texels.iter().map(|&i| b.light.combined[i] * b.texels.area[i]).sum::<Rgb>() / area
}

fn noise(i: u32) -> f32 {
    unit_float(hash2(i, 77))
}

fn assert_near(got: Rgb, want: Rgb, tolerance: f32) {
    assert!((got - want).abs().max_element() <= tolerance * want.max_element(), "{got} instead of {want}");
}

#[test]
fn a_cutout_lets_through_the_share_of_its_holes() {
    let card =
        Material { alpha_mode: AlphaMode::Mask(0.5), base_color_texture: leaf(Filter::Nearest), ..Material::default() };
    let b = baked(&with_sun(under_card(1.0, card, |i| if noise(i) < 0.35 { 255 } else { 0 })), 32.0, 0.01);
    let open = (0..TEXELS * TEXELS).filter(|&i| noise(i) >= 0.35).count() as f32 / (TEXELS * TEXELS) as f32;
    assert_near(floor(&b), Rgb::splat(open), 0.01);
}

#[test]
fn a_blended_card_lets_through_the_mean_of_its_texture() {
    let card =
        Material { alpha_mode: AlphaMode::Blend, base_color_texture: leaf(Filter::Linear), ..Material::default() };
    let code = |i: u32| (255.0 * noise(i)) as u8;
    let b = baked(&with_sun(under_card(1.0, card, code)), 32.0, 0.01);
    let mean = (0..TEXELS * TEXELS).map(|i| 1.0 - f32::from(code(i)) / 255.0).sum::<f32>() / (TEXELS * TEXELS) as f32;
    assert_near(floor(&b), Rgb::splat(mean), 0.01);
}

/// Two kinds of glass with what they let through.
fn glasses() -> [(Material, Rgb); 2] {
    let base_color = Rgb::new(1.0, 0.5, 0.2);
    let blend = Material { base_color, alpha: 0.4, alpha_mode: AlphaMode::Blend, ..Material::default() };
    let glass = Material { base_color, transmission: 0.7, double_sided: true, ..Material::default() };
    [(blend, 0.6 * (Rgb::splat(0.6) + 0.4 * base_color)), (glass, 0.7 * base_color)]
}

#[test]
fn coloured_glass_tints_lamps() {
    for (glass, passes) in glasses() {
        let scene = with_sun(under_card(2.0, glass, |_| 255));
        let b = baked(&scene, 8.0, 0.01);
        assert_near(floor(&b), passes, 1e-3);
        check_paths(&scene, &b, &on_floor(&b), 1e-3, |_| passes.y);
    }
}

#[test]
fn coloured_glass_tints_the_sky() {
    for (glass, passes) in glasses() {
        let mut scene = under_card(2000.0, glass, |_| 255);
        // Nothing from below, where the glass would reflect it to the floor.
        scene.environment = Environment::Gradient { zenith: Rgb::ONE, horizon: Rgb::ONE, ground: Rgb::ZERO };
        let b = baked(&scene, 0.25, 0.01);
        assert_near(floor(&b), passes * PI, 0.01);
        check_paths(&scene, &b, &on_floor(&b), 0.01, |_| passes.y * PI);
    }
}

/// A closed room with a wall through it that is in part not there: whatever it is made of, if every surface sends out
/// radiance 1 in sum, all of it receives π.
fn furnace_with_wall(wall: Material, alpha: impl Fn(u32) -> u8) -> Scene {
    let mut room = Room::default();
    room.inside_of_box(Vec3::ZERO, Vec3::ONE, [Face { radiance: 0.4, reflectance: 0.6 }; 6]);
    room.quad(Vec3::new(0.0, 0.0, 0.52), Vec3::X, Vec3::Y, BLACK);
    let mut scene = room.scene();
    let uv = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::ZERO, Vec2::ONE, Vec2::Y];
    scene.meshes[0].texcoords[0][36..].copy_from_slice(&uv);
    let texels = (0..TEXELS * TEXELS).map(|i| [255, 255, 255, alpha(i)]).collect();
    scene.textures.push(Texture { name: "leaf".into(), width: TEXELS, height: TEXELS, texels });
    scene.materials[6] = Material { double_sided: true, ..wall };
    scene
}

#[test]
fn holes_and_glass_neither_lose_nor_make_light() {
    let half_holes = |i: u32| if noise(i) < 0.5 { 255 } else { 0 };
    let (base_color, alpha) = (Rgb::splat(0.6), 0.5);
    let cutout = Material {
        base_color,
        emission: Rgb::splat(0.4),
        alpha_mode: AlphaMode::Mask(0.5),
        base_color_texture: leaf(Filter::Nearest),
        ..Material::default()
    };
    // Passes (1 − α)(1 − α + αc), reflects αc, and emits the rest.
    let passes = (1.0 - alpha) * (1.0 - alpha + alpha * 0.6);
    let emission = Rgb::splat((1.0 - passes) / alpha - 0.6);
    let blend = Material { base_color, alpha, emission, alpha_mode: AlphaMode::Blend, ..Material::default() };
    let glass = Material { base_color, transmission: 0.7, emission: Rgb::splat(0.4), ..Material::default() };
    for (name, material) in [("cutout", cutout), ("blend", blend), ("glass", glass)] {
        let scene = furnace_with_wall(material, half_holes);
        let b = baked(&scene, 24.0, 0.01);
        let miss = |i: usize| (b.light.combined[i] / PI - Rgb::ONE).abs().max_element();
        let worst = (0..b.texels.len()).map(miss).fold(0.0, f32::max);
        assert!(worst < 0.01, "{name}: {worst}");
        check_paths(&scene, &b, &(0..b.texels.len()).collect::<Vec<_>>(), 0.002, |_| PI);
    }
}

/// A floor of reflectance 0.8 under the sun and, half a metre above it, a card that is as large.
fn floor_under_card(card: Material, lightmap: LightmapRequest) -> Scene {
    let size = 36.0;
    let mut room = Room::default();
    let o = Vec3::new(-0.5 * size, 0.0, -0.5 * size);
    room.quad(o, Vec3::Z * size, Vec3::X * size, Face { radiance: 0.0, reflectance: 0.8 });
    let mut scene = room.scene();
    let mut room = Room::default();
    room.quad(o + 0.5 * Vec3::Y, Vec3::Z * size, Vec3::X * size, BLACK);
    add(&mut scene, room.scene(), true);
    // Pictures of holes of 0.8 m.
    scene.meshes[1].texcoords[0] = scene.meshes[1].positions.iter().map(|p| 1.23 * Vec2::new(p.x, p.z)).collect();
    let texels = (0..TEXELS * TEXELS).map(|i| [255, 255, 255, if noise(i) < 0.5 { 255 } else { 0 }]).collect();
    scene.textures.push(Texture { name: "leaf".into(), width: TEXELS, height: TEXELS, texels });
    scene.materials[1] = Material { double_sided: true, ..card };
    scene.instances[1].lightmap = lightmap;
    with_sun(scene)
}

#[test]
fn leaves_reflect_what_they_do_not_let_through() {
    let half = (0..TEXELS * TEXELS).filter(|&i| noise(i) < 0.5).count() as f32 / (TEXELS * TEXELS) as f32;
    let base_color = Rgb::splat(0.8);
    let cutout = Material {
        base_color,
        alpha_mode: AlphaMode::Mask(0.5),
        base_color_texture: leaf(Filter::Nearest),
        ..Material::default()
    };
    let blend = Material { base_color, alpha: half, alpha_mode: AlphaMode::Blend, ..Material::default() };
    let through_blend = (1.0 - half) * (1.0 - half + half * 0.8);
    for (material, through) in [(cutout, 1.0 - half), (blend, through_blend)] {
        // What passes, and what goes back and forth between the floor and the leaves.
        let want = through / (1.0 - 0.8 * half * 0.8);
        for lightmap in [LightmapRequest::Default, LightmapRequest::None] {
            let scene = floor_under_card(material.clone(), lightmap);
            let b = baked(&scene, 2.2, 0.01);
            let is_here = |p: Vec3| p.y < 0.1 && p.x.abs().max(p.z.abs()) < 8.0;
            let got = mean(&b.where_at(|p, _| is_here(p)));
            assert!((got / want - 1.0).abs() < 0.01, "{lightmap:?}, {through} passes: {got} instead of {want}");
            let texels: Vec<usize> = (0..b.texels.len()).filter(|&i| is_here(b.texels.position[i])).collect();
            check_paths(&scene, &b, &texels, 0.03, |_| want);
        }
    }
}
