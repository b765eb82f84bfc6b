//! Lightmap coordinates that the scene brings along.

use crate::checks::{bake, codes, keep};
use crate::scenes::{mesh, quad, scene};
use glam::{Affine3A, Vec2, Vec3};
use lightkiln::atlas::{AtlasError, AtlasSettings, UvMode, build};
use lightkiln::progress::Silent;

#[test]
fn keep_names_the_nodes_without_coordinates() {
    let mut bare = quad(Vec2::ZERO, Vec2::ONE);
    bare.texcoords.clear();
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::IDENTITY]), (bare, vec![Affine3A::IDENTITY; 2])]);
    let error = build(&s, &keep(64), &Silent).expect_err("two nodes have no coordinates");
    assert!(matches!(&error, AtlasError::MissingTexcoords { nodes, .. } if nodes == &["node1", "node2"]));
    let text = error.to_string();
    assert!(text.contains("`node1`, `node2`") && text.contains("--uv auto"), "{text}");
}

#[test]
fn keep_warns_of_overlap_between_and_within_instances() {
    let one = Affine3A::IDENTITY;
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::splat(0.5)), vec![one, one])]);
    let (_, warnings, texels) = bake(&s, &keep(16));
    assert_eq!(codes(&warnings), ["texcoord_overlap"]);
    assert!(warnings[0].message.contains("64 texels") && warnings[0].message.contains("`node0`, `node1`"));
    assert_eq!(texels.charts, [0..64, 64..64], "the first chart keeps them");

    let folded = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let other = folded.map(|p| p + Vec3::Z);
    let s = scene(vec![(mesh(&[folded, other], |_, k| folded[k].truncate()), vec![one])]);
    let (_, warnings, _) = bake(&s, &keep(16));
    assert!(codes(&warnings).contains(&"texcoord_overlap"));
}

#[test]
fn keep_warns_of_charts_that_share_texels_at_their_border() {
    let one = vec![Affine3A::IDENTITY];
    let left = quad(Vec2::ZERO, Vec2::new(0.5, 1.0));
    let right = quad(Vec2::new(0.5, 0.0), Vec2::ONE);
    let s = scene(vec![(left, one.clone()), (right, one)]);
    assert_eq!(codes(&bake(&s, &keep(16)).1), [""; 0], "on whole texels nothing is shared");
    let (_, warnings, texels) = bake(&s, &keep(15));
    assert_eq!(codes(&warnings), ["texcoord_meeting"]);
    assert_eq!(texels.charts, [0..120, 120..225]);
}

#[test]
fn keep_warns_of_coordinates_outside_the_page_and_without_area() {
    let one = vec![Affine3A::IDENTITY];
    let s = scene(vec![(quad(Vec2::splat(0.5), Vec2::splat(1.5)), one.clone())]);
    let (_, warnings, texels) = bake(&s, &keep(16));
    assert_eq!(codes(&warnings), ["texcoord_outside"]);
    assert_eq!((warnings[0].place.as_str(), texels.len()), ("node0", 64));

    let s = scene(vec![(quad(Vec2::splat(f32::NAN), Vec2::splat(1e30)), one.clone())]);
    let (_, warnings, texels) = bake(&s, &keep(16));
    assert!(codes(&warnings).contains(&"texcoord_outside"));
    assert!(texels.is_empty());

    let s = scene(vec![(quad(Vec2::splat(0.5), Vec2::new(0.5, 0.9)), one)]);
    let (_, warnings, texels) = bake(&s, &keep(16));
    assert_eq!(codes(&warnings), ["texcoord_degenerate"]);
    assert!(texels.is_empty());
}

#[test]
fn without_a_resolution_keep_finds_one_for_the_density() {
    let settings = AtlasSettings { uv: UvMode::Keep, texels_per_metre: Some(40.0), ..AtlasSettings::default() };
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::splat(0.5)), vec![Affine3A::IDENTITY])]);
    assert_eq!(bake(&s, &settings).0.pages[0].width, 128);
}
