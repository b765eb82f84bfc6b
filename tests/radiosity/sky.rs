//! Light from environment pictures: what arrives is the sum over the pixels, and a sun of one pixel casts its shadow
//! where geometry says.

use super::audit::check_paths;
use super::rooms::{Baked, Face, Room, baked, mean};
use glam::{DVec3, Quat, Vec2, Vec3};
use lightkiln::scene::{Cell, Environment, Panorama, Rgb, Scene, Sky};
use std::sync::Arc;

const BLACK: Face = Face { radiance: 0.0, reflectance: 0.0 };
const WIDTH: usize = 64;
const HEIGHT: usize = 32;

fn picture(f: impl Fn(usize, usize) -> f32) -> Panorama {
    let pixels = (0..WIDTH * HEIGHT).map(|i| Rgb::splat(f(i % WIDTH, i / WIDTH))).collect();
    Panorama { width: WIDTH, height: HEIGHT, pixels }
}

/// Irradiance on a surface with normal `n`: Σ L·cosθ·dΩ over the pixels, each cut into 8 × 8 parts.
fn sum_over_pixels(picture: &Panorama, rotation: Quat, n: Vec3) -> f32 {
    let mut sum = 0.0;
    for (i, pixel) in picture.pixels.iter().enumerate() {
        let cell = Cell::new(i % WIDTH, i / WIDTH, WIDTH, HEIGHT);
        let parts = (0..64).map(|k| Vec2::new((k % 8) as f32 + 0.5, (k / 8) as f32 + 0.5) / 8.0);
        let cosines: f32 = parts.map(|u| (rotation * cell.direction(u)).dot(n).max(0.0)).sum();
        sum += (pixel.x * cosines / 64.0) as f64 * cell.solid_angle();
    }
    sum as f32
}

fn lit(room: Room, picture: &Panorama, rotation: Quat) -> Scene {
    let mut scene = room.scene();
    scene.environment = Environment::Image(Arc::new(Sky::new(picture.clone(), rotation)));
    scene
}

fn square(normal: Vec3) -> Room {
    let (u, v) = normal.any_orthonormal_pair();
    let mut room = Room::default();
    room.quad(-0.5 * (u + v), u, v, BLACK);
    room
}

#[test]
fn irradiance_is_the_sum_over_the_pixels() {
    let hash = |x: usize, y: usize| ((x * 7919 + y * 104_729) % 97) as f32 / 97.0;
    let pictures = [
        ("even", picture(|_, _| 1.5)),
        ("rough", picture(hash)),
        ("half", picture(|x, _| if x < WIDTH / 2 { 1.0 } else { 0.1 })),
        ("sun", picture(|x, y| if (x, y) == (20, 7) { 5e4 } else { hash(x, y) })),
        ("lamps", picture(|x, y| if x % 16 < 2 && y % 9 < 3 { 40.0 } else { 0.2 })),
    ];
    let rotation = Quat::from_rotation_y(0.7) * Quat::from_rotation_x(0.3);
    for (name, picture) in pictures {
        for normal in [Vec3::Y, Vec3::new(0.6, 0.0, -0.8), Vec3::new(-0.5, 0.5, 0.7).normalize()] {
            // So many texels that the probes of a smooth surface average to its mean.
            let scene = lit(square(normal), &picture, rotation);
            let b = baked(&scene, 96.0, 0.005);
            let (got, want) = (mean(&b.where_at(|_, _| true)), sum_over_pixels(&picture, rotation, normal));
            assert!((got / want - 1.0).abs() < 0.005, "{name}, normal {normal}: {got} instead of {want}");
            check_paths(&scene, &b, &(0..b.texels.len()).collect::<Vec<_>>(), 0.005, |_| want);
        }
    }
}

#[test]
fn a_sun_of_one_pixel_casts_its_shadow() {
    // The sun's pixel is 5.6° wide; its middle and sides tell where the shadow of a roof's edge begins and ends.
    let (x, y) = (32, 6);
    let picture = picture(|i, j| if (i, j) == (x, y) { 1e5 } else { 0.5 });
    let cell = Cell::new(x, y, WIDTH, HEIGHT);
    let mut room = Room::default();
    room.quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 4.0, BLACK);
    // A roof at a height of 1 m over x < 1, wide enough to leave only its edge to matter.
    room.quad(Vec3::new(-9.0, 1.0, -9.0), Vec3::X * 10.0, Vec3::Z * 18.0, BLACK);
    let b = baked(&lit(room, &picture, Quat::IDENTITY), 32.0, 0.02);
    let floor = |low: f32, high: f32| {
        move |p: Vec3, n: Vec3| p.y < 0.5 && n.y > 0.5 && p.x > low && p.x < high && p.z.abs() < 0.3
    };
    // The sun stands in the plane z = 0 towards +X: light that grazes the edge lands at x = 1 − cot(elevation).
    let reach = |height: f64| 1.0 - ((1.0 - height * height).sqrt() / height) as f32;
    let [low, high] = cell.heights;
    let (dark_end, light_begin) = (reach(low), reach(high));
    let sun = |b: &Baked, low: f32, high: f32| mean(&b.where_at(floor(low, high)));
    let direct = (cell.moment() * 1e5).dot(DVec3::Y) as f32;
    let (shade, light) = (sun(&b, -0.9, dark_end - 0.05), sun(&b, light_begin + 0.05, 0.95));
    assert!(light > 0.98 * direct && light < 1.06 * direct, "{light} in the light, sun {direct}");
    assert!(shade < 0.01 * direct, "{shade} in the shade, sun {direct}");
    // Half way through the penumbra by solid angle.
    let middle = reach(0.5 * (low + high));
    let half = sun(&b, middle - 0.03, middle + 0.03);
    assert!((half / direct - 0.5).abs() < 0.1, "{half} in the middle of the penumbra, sun {direct}");
}

#[test]
fn a_sky_beside_a_wall() {
    // Floor under a uniform sky beside an infinite wall of height h at distance h: 0.8535534·πL.
    let mut room = Room::default();
    room.quad(Vec3::new(-0.05, 0.0, -0.05), Vec3::Z * 0.1, Vec3::X * 0.1, BLACK);
    room.quad(Vec3::new(1.0, 0.0, -400.0), Vec3::Z * 800.0, Vec3::Y, BLACK);
    let scene = lit(room, &picture(|_, _| 1.0), Quat::IDENTITY);
    let b = baked(&scene, 0.5, 0.005);
    let got = mean(&b.where_at(|_, n| n.y > 0.5)) / std::f32::consts::PI;
    assert!((got / 0.853_553_4 - 1.0).abs() < 0.005, "{got}");
    let floor: Vec<usize> = (0..b.texels.len()).filter(|&t| b.texels.geometric_normal[t].y > 0.5).collect();
    check_paths(&scene, &b, &floor, 0.005, |_| 0.853_553_4 * std::f32::consts::PI);
}

/// A dark room of 9 × 4 × 7 m whose only light falls through a hole in the ceiling: every texel gets what it sees of the
/// sky through the hole, also where that is a sliver.
#[test]
fn a_skylight_reaches_every_wall() {
    let (size, low, high) = (Vec3::new(9.0, 4.0, 7.0), Vec2::new(3.3, 2.1), Vec2::new(5.7, 3.4));
    let mut room = Room::default();
    room.quad(Vec3::ZERO, Vec3::Z * size.z, Vec3::X * size.x, BLACK);
    for (origin, u) in [
        (Vec3::ZERO, Vec3::X * size.x),
        (Vec3::X * size.x, Vec3::Z * size.z),
        (Vec3::new(size.x, 0.0, size.z), Vec3::NEG_X * size.x),
        (Vec3::Z * size.z, Vec3::NEG_Z * size.z),
    ] {
        room.quad(origin, u, Vec3::Y * size.y, BLACK);
    }
    let bounds = [(Vec2::ZERO, Vec2::new(low.x, size.z)), (Vec2::new(high.x, 0.0), Vec2::new(size.x, size.z))];
    let beside =
        [(Vec2::new(low.x, 0.0), Vec2::new(high.x, low.y)), (Vec2::new(low.x, high.y), Vec2::new(high.x, size.z))];
    for (a, b) in bounds.into_iter().chain(beside) {
        room.quad(Vec3::new(a.x, size.y, a.y), Vec3::X * (b.x - a.x), Vec3::Z * (b.y - a.y), BLACK);
    }
    let mut scene = room.scene();
    scene.environment = Environment::Constant(Rgb::ONE);
    let b = baked(&scene, 8.0, 0.01);
    let seen = |p: Vec3, n: Vec3| {
        const PARTS: usize = 48;
        let part = (high - low) / PARTS as f32;
        let from = |i: usize| {
            let at = low + part * (Vec2::new((i % PARTS) as f32, (i / PARTS) as f32) + 0.5);
            let v = Vec3::new(at.x, size.y, at.y) - p;
            part.element_product() * v.y * n.dot(v).max(0.0) / v.length_squared().powi(2)
        };
        (0..PARTS * PARTS).map(from).sum::<f32>()
    };
    let (mut count, mut squares) = (0, 0.0f32);
    let t = &b.texels;
    let inside = |p: Vec3| p.y < size.y - 0.1;
    let most = (0..t.len()).map(|i| b.light.combined[i].x).fold(0.0, f32::max);
    for i in (0..t.len()).filter(|&i| inside(t.position[i])) {
        let (got, want) = (b.light.combined[i].x, seen(t.position[i], t.shading_normal[i]));
        let miss = (got - want).abs() / want.max(0.05 * most);
        // Dim texels are sampled for errors that the scene's mean makes small.
        assert!(miss < 0.06, "{} has {got} instead of {want}", t.position[i]);
        squares += miss * miss;
        count += 1;
    }
    let rms = (squares / count as f32).sqrt();
    assert!(count > 10_000 && rms < 0.01, "relative error {rms} of {count} texels");
}
