//! Light through holes and through translucent surfaces.

use super::audit::check_paths;
use super::rooms::{Baked, Face, Room, baked};
use glam::{Vec2, Vec3};
use lightkiln::math::{hash2, unit_float};
use lightkiln::scene::{
    AlphaMode, Environment, Filter, Light, LightShape, Material, Rgb, Scene, Texture, TextureSlot, Wrap,
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
