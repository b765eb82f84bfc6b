//! Charts that are made or repacked, each instance in a place of its own.

use crate::checks::{auto, bake, check_apart, close, codes, total_area, world_area};
use crate::scenes::{cube, mesh, quad, scene, sphere, zoo};
use glam::{Affine3A, Vec2, Vec3};
use lightkiln::atlas::{AtlasError, AtlasSettings, Unwrapper, UvMode, build};
use lightkiln::progress::Silent;
use lightkiln::scene::LightmapRequest;

#[test]
fn unwrapped_charts_are_apart_and_keep_their_area() {
    for unwrapper in [Unwrapper::Xatlas, Unwrapper::Fast] {
        for padding in [1, 2, 5] {
            let s = zoo();
            let (atlas, warnings, texels) = bake(&s, &AtlasSettings { padding, ..auto(unwrapper) });
            assert_eq!(warnings, []);
            check_apart(&atlas, &texels);
            close(total_area(&texels), world_area(&s), 1e-3);
            assert!(
                s.instances
                    .iter()
                    .zip(&atlas.layouts)
                    .all(|(i, l)| l.is_some() != s.meshes[i.mesh].triangles.is_empty())
            );
        }
    }
}

#[test]
fn density_is_per_metre_of_the_world() {
    for unwrapper in [Unwrapper::Xatlas, Unwrapper::Fast] {
        for scale in [Vec3::ONE, Vec3::new(5.0, 1.0, 1.0), Vec3::splat(3.0)] {
            let s = scene(vec![(cube(), vec![Affine3A::from_scale(scale)])]);
            let (_, _, texels) = bake(&s, &AtlasSettings { texels_per_metre: Some(20.0), ..auto(unwrapper) });
            assert_eq!(texels.len() as f64, 400.0 * world_area(&s).round(), "sides are whole texels");
            assert!(texels.area.iter().all(|&a| (a * 400.0 - 1.0).abs() < 1e-3));
        }
    }
}

#[test]
fn a_resolution_alone_is_filled_by_one_page() {
    for resolution in [64, 300] {
        let (atlas, warnings, texels) =
            bake(&zoo(), &AtlasSettings { resolution: Some(resolution), ..auto(Unwrapper::Fast) });
        assert_eq!((codes(&warnings), atlas.pages.len()), (vec![], 1));
        assert_eq!((atlas.pages[0].width, atlas.pages[0].height), (resolution, resolution));
        assert!(resolution < 100 || texels.len() as f64 > 0.4 * f64::from(resolution * resolution));
    }
}

#[test]
fn resolution_and_density_make_as_many_pages_as_needed() {
    let settings = AtlasSettings { resolution: Some(64), texels_per_metre: Some(32.0), ..auto(Unwrapper::Fast) };
    let s = scene(vec![(cube(), vec![Affine3A::IDENTITY; 4])]);
    let (atlas, warnings, texels) = bake(&s, &settings);
    assert_eq!(codes(&warnings), [""; 0]);
    assert!(atlas.pages.len() > 6 && atlas.pages.iter().all(|p| (p.width, p.height) == (64, 64)));
    check_apart(&atlas, &texels);
    assert_eq!(texels.len(), 4 * 6 * 32 * 32);
}

#[test]
fn requests_override_the_density() {
    let mut s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::from_scale(Vec3::splat(2.0)); 4])]);
    s.instances[1].lightmap = LightmapRequest::TexelsPerMetre(5.0);
    s.instances[2].lightmap = LightmapRequest::Resolution(7);
    s.instances[3].lightmap = LightmapRequest::None;
    let (atlas, _, texels) = bake(&s, &AtlasSettings { texels_per_metre: Some(10.0), ..auto(Unwrapper::Fast) });
    let sizes: Vec<usize> = texels.charts.iter().map(|c| c.len()).collect();
    assert_eq!(sizes, [400, 100, 49]);
    assert!(atlas.layouts[3].is_none());
}

#[test]
fn what_is_larger_than_a_page_shrinks_with_a_warning() {
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::from_scale(Vec3::splat(100.0))])]);
    let settings = AtlasSettings { max_page: 128, ..auto(Unwrapper::Fast) };
    let (atlas, warnings, _) = bake(&s, &settings);
    assert_eq!(codes(&warnings), ["chart_shrunk"]);
    assert!(warnings[0].place == "node0" && atlas.pages[0].width <= 128);
}

#[test]
fn an_absurd_scale_is_refused() {
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::from_scale(Vec3::splat(1e7))])]);
    for unwrapper in [Unwrapper::Xatlas, Unwrapper::Fast] {
        let error = build(&s, &auto(unwrapper), &Silent).expect_err("10¹⁶ texels are too many");
        assert!(error.to_string().contains("--texels-per-metre"), "{error}");
    }
    let tiny = scene(vec![(cube(), vec![Affine3A::from_scale(Vec3::splat(1e-7))])]);
    assert!(!bake(&tiny, &AtlasSettings::default()).2.is_empty());
}

#[test]
fn a_wide_range_of_scales_fits_one_page() {
    let place = vec![Affine3A::from_scale(Vec3::splat(1000.0)), Affine3A::from_scale(Vec3::splat(1e-3))];
    let (atlas, _, texels) =
        bake(&scene(vec![(cube(), place)]), &AtlasSettings { resolution: Some(128), ..auto(Unwrapper::Xatlas) });
    check_apart(&atlas, &texels);
}

#[test]
fn pack_keeps_islands_and_gives_every_instance_its_own() {
    // Two quads that lie upon each other in TEXCOORD_1, far from the density and the proportions of the world.
    let s = scene(vec![
        (quad(Vec2::splat(0.1), Vec2::new(0.2, 0.9)), vec![Affine3A::IDENTITY, Affine3A::from_scale(Vec3::splat(2.0))]),
        (quad(Vec2::splat(-7.0), Vec2::splat(3.0)), vec![Affine3A::IDENTITY]),
    ]);
    let settings = AtlasSettings { uv: UvMode::Pack, texels_per_metre: Some(10.0), ..AtlasSettings::default() };
    let (atlas, warnings, texels) = bake(&s, &settings);
    assert_eq!((codes(&warnings), atlas.unwrapper), (vec![], "pack"));
    check_apart(&atlas, &texels);
    assert_eq!(texels.charts.iter().map(|c| c.len()).collect::<Vec<_>>(), [100, 400, 100]);
}

#[test]
fn pack_takes_stacked_islands_apart() {
    let s = scene(vec![(cube(), vec![Affine3A::IDENTITY])]);
    let (atlas, _, texels) = bake(&s, &AtlasSettings { uv: UvMode::Pack, ..AtlasSettings::default() });
    assert_eq!(atlas.charts.len(), 6);
    check_apart(&atlas, &texels);
    close(total_area(&texels), 6.0, 1e-3);
}

#[test]
fn pack_falls_back_to_the_first_set_and_lays_flat_what_has_none() {
    let mut first = quad(Vec2::ZERO, Vec2::ONE);
    first.texcoords.swap(0, 1);
    // Every triangle of the sphere has one point of TEXCOORD_1 only.
    let s = scene(vec![(first, vec![Affine3A::IDENTITY]), (sphere(6), vec![Affine3A::IDENTITY])]);
    let settings = AtlasSettings { uv: UvMode::Pack, ..AtlasSettings::default() };
    let (atlas, warnings, texels) = bake(&s, &settings);
    assert_eq!(codes(&warnings), ["texcoord_scattered"]);
    check_apart(&atlas, &texels);
    close(total_area(&texels), world_area(&s), 1e-3);

    let mut bare = quad(Vec2::ZERO, Vec2::ONE);
    bare.texcoords.clear();
    let error = build(&scene(vec![(bare, vec![Affine3A::IDENTITY])]), &settings, &Silent);
    assert!(matches!(error, Err(AtlasError::MissingTexcoords { nodes, .. }) if nodes == ["node0"]));
}

#[test]
fn degenerate_geometry_is_survived() {
    let one = vec![Affine3A::IDENTITY];
    let mut needles: Vec<[Vec3; 3]> =
        (0..40).map(|i| [Vec3::ZERO, Vec3::X, Vec3::new(0.5, 10f32.powi(-i), 0.0)]).collect();
    // One edge with three sheets, and the same triangle from both sides.
    needles.extend([[Vec3::ZERO, Vec3::X, Vec3::Z], [Vec3::ZERO, Vec3::X, -Vec3::Z], [Vec3::X, Vec3::ZERO, Vec3::Z]]);
    let mut soup = mesh(&needles, |_, k| [Vec2::ZERO, Vec2::X, Vec2::Y][k]);
    soup.normals.iter_mut().for_each(|n| *n = n.normalize_or(Vec3::Y));
    let s = scene(vec![(soup, one)]);
    for settings in
        [auto(Unwrapper::Xatlas), auto(Unwrapper::Fast), AtlasSettings { uv: UvMode::Pack, ..AtlasSettings::default() }]
    {
        let (atlas, _, texels) = bake(&s, &settings);
        assert!(!texels.is_empty());
        check_apart(&atlas, &texels);
    }
}
