//! Rasterised charts: what every texel holds, and points inside it.

use crate::checks::{bake, close, distance, keep, total_area, world_area};
use crate::scenes::{mesh, quad, scene, textured};
use glam::{Affine3A, Mat3, Quat, Vec2, Vec3};
use lightkiln::scene::AlphaMode;

#[test]
fn a_quad_on_whole_texels_covers_exactly_those() {
    // 3/32 … 21/32 of 32 texels are whole numbers; a third of 96 is one up to rounding.
    for (low, high, side, texels_across) in
        [(3.0 / 32.0, 21.0 / 32.0, 32, 18), (1.0 / 3.0, 2.0 / 3.0, 96, 32), (0.1, 0.7, 1000, 600)]
    {
        let (atlas, warnings, texels) =
            bake(&scene(vec![(quad(Vec2::splat(low), Vec2::splat(high)), vec![Affine3A::IDENTITY])]), &keep(side));
        assert_eq!(warnings, []);
        assert_eq!((atlas.pages.len(), atlas.charts.len()), (1, 1));
        assert_eq!(texels.len(), texels_across * texels_across);
        assert!(texels.coverage.iter().all(|&c| (c - 1.0).abs() < 1e-5));
        close(total_area(&texels), 1.0, 1e-4);
    }
}

#[test]
fn texel_centres_lie_where_the_coordinates_say() {
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::IDENTITY])]);
    let (_, _, texels) = bake(&s, &keep(4));
    let t = texels.pages[0].at(Vec2::new(1.5, 0.5)).expect("the page is full") as usize;
    assert!(texels.position[t].distance(Vec3::new(0.375, 0.875, 0.0)) < 1e-6);
    assert_eq!(texels.geometric_normal[t], Vec3::Z);
    close(f64::from(texels.area[t]), 1.0 / 16.0, 1e-6);
}

#[test]
fn area_is_conserved_for_any_placement() {
    let place = [
        Affine3A::IDENTITY,
        Affine3A::from_scale(Vec3::new(3.0, 0.5, 2.0)),
        Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0)),
        Affine3A::from_scale_rotation_translation(
            Vec3::new(100.0, -80.0, 3.0),
            Quat::from_rotation_x(0.7),
            Vec3::new(50.0, -20.0, 7.0),
        ),
        Affine3A::from_mat3(Mat3::from_cols(Vec3::X, Vec3::new(0.7, 1.0, 0.0), Vec3::Z)),
    ];
    for transform in place {
        // Neither on whole texels nor along the axes.
        let corners = [Vec2::new(0.113, 0.271), Vec2::new(0.871, 0.159), Vec2::new(0.613, 0.933)];
        let triangle = [Vec3::ZERO, Vec3::new(2.0, 0.1, 0.3), Vec3::new(0.4, 1.7, -0.2)];
        let s = scene(vec![(mesh(&[triangle], |_, k| corners[k]), vec![transform])]);
        let (_, _, texels) = bake(&s, &keep(64));
        close(total_area(&texels), world_area(&s), 1e-3);
    }
}

#[test]
fn a_mirrored_instance_keeps_its_front() {
    let mirror = Affine3A::from_scale(Vec3::new(1.0, 1.0, -1.0));
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![mirror])]);
    let (_, _, texels) = bake(&s, &keep(8));
    assert!(texels.geometric_normal.iter().all(|n| n.distance(-Vec3::Z) < 1e-6));
    assert!(texels.shading_normal.iter().all(|n| n.distance(-Vec3::Z) < 1e-6));
}

#[test]
fn shading_normals_turn_to_the_front() {
    let mut upside_down = quad(Vec2::ZERO, Vec2::ONE);
    upside_down.normals.iter_mut().for_each(|n| *n = Vec3::new(0.6, 0.0, -0.8));
    let (_, _, texels) = bake(&scene(vec![(upside_down, vec![Affine3A::IDENTITY])]), &keep(8));
    assert!(texels.shading_normal.iter().all(|n| n.distance(Vec3::new(-0.6, 0.0, 0.8)) < 1e-5));
}

#[test]
fn samples_lie_in_their_texel_and_cover_what_the_chart_covers() {
    let corners = [Vec2::new(0.05, 0.1), Vec2::new(0.95, 0.2), Vec2::new(0.3, 0.9)];
    let triangle = [Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 0.0, -3.0)];
    let s = scene(vec![(mesh(&[triangle], |_, k| corners[k]), vec![Affine3A::from_rotation_z(0.3)])]);
    let (atlas, _, texels) = bake(&s, &keep(16));
    const GRID: usize = 40;
    for t in 0..texels.len() as u32 {
        let mut hits = 0;
        for i in 0..GRID * GRID {
            let offset = (Vec2::new((i % GRID) as f32, (i / GRID) as f32) + 0.5) / GRID as f32;
            let Some(point) = texels.surface(&s, &atlas, t).sample(offset) else { continue };
            hits += 1;
            assert!(distance(point.position, s.corners(0, 0)) < 1e-5);
            // Back through the triangle's barycentrics to the page.
            let [a, b, c] = s.corners(0, 0);
            let n = (b - a).cross(c - a);
            let w = point.position - a;
            let b = Vec2::new(w.cross(c - a).dot(n), (b - a).cross(w).dot(n)) / n.length_squared();
            let (page, at) = atlas.locate(0, 0, b).expect("the instance is laid out");
            let [x, y] = texels.pixel[t as usize];
            assert_eq!(page, 0);
            assert!(at.distance(Vec2::new(f32::from(x), f32::from(y)) + offset) < 2e-3);
        }
        let share = hits as f32 / (GRID * GRID) as f32;
        assert!((share - texels.coverage[t as usize]).abs() < 0.04, "{share} of texel {t} was hit");
    }
}

#[test]
fn a_chart_below_a_texel_keeps_one() {
    for size in [0.3, 1e-3, 1e-5] {
        let triangle = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let uv = [Vec2::ZERO, Vec2::X, Vec2::Y].map(|c| Vec2::splat(0.535) + c * size / 64.0);
        let s = scene(vec![(mesh(&[triangle], |_, k| uv[k]), vec![Affine3A::IDENTITY])]);
        assert_eq!(bake(&s, &keep(64)).2.len(), 1, "a chart of {size} texels");
    }
}

#[test]
fn emission_is_there_only_if_something_emits() {
    let mut s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::IDENTITY])]);
    let (_, _, texels) = bake(&s, &keep(8));
    assert!(texels.emission.is_empty());
    assert!(texels.reflectance.iter().all(|r| r.distance(Vec3::splat(0.98)) < 1e-5), "white is capped");
    s.materials[0].emission = Vec3::new(1.0, 2.0, 3.0);
    let (_, _, texels) = bake(&s, &keep(8));
    assert_eq!(texels.emission.len(), texels.len());
    assert!(texels.emission.iter().all(|e| e.distance(Vec3::new(1.0, 2.0, 3.0)) < 1e-5));
}

#[test]
fn reflectance_is_the_mean_of_the_texture_under_the_texel() {
    for (n, tolerance) in [(8, 1e-5), (12, 0.04), (32, 1e-5), (100, 0.02), (1000, 0.02)] {
        let (_, _, texels) = bake(&textured(n), &keep(4));
        assert!(texels.reflectance.iter().all(|r| (r.x - 0.25).abs() < tolerance), "{n}: {:?}", texels.reflectance);
    }
    // As fine as the lightmap: each texel sees its own.
    let (_, _, texels) = bake(&textured(4), &keep(4));
    for (pixel, r) in texels.pixel.iter().zip(&texels.reflectance) {
        let white = (pixel[0] + pixel[1]) % 2 == 0;
        assert!((r.x - if white { 0.5 } else { 0.0 }).abs() < 1e-5);
    }
}

#[test]
fn texels_hold_what_is_there_and_how_much_of_it() {
    let mut s = textured(8);
    s.materials[0].emission = Vec3::ONE;
    s.materials[0].alpha_mode = AlphaMode::Mask(0.5);
    let texels = bake(&s, &keep(4)).2;
    assert!(texels.opacity.iter().all(|o| (o - 0.5).abs() < 1e-5));
    assert!(texels.emission.iter().all(|e| (e.x - 1.0).abs() < 1e-5));
    assert!(texels.reflectance.iter().all(|r| (r.x - 0.5).abs() < 1e-5));
    s.materials[0].alpha_mode = AlphaMode::Opaque;
    assert!(bake(&s, &keep(4)).2.opacity.is_empty());
}
