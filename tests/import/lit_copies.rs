//! Files with compressed or quantised content survive into their lit copies: those load to the same scene.

use crate::compressed::{draco, meshopt};
use crate::containers::{ETC1S, UASTC, basis};
use crate::fixture::{Asset, assert_clean};
use crate::geometry::quantised;
use glam::{Vec2, Vec3};
use lightkiln::atlas::{AtlasSettings, PageImage, build};
use lightkiln::import::{ImportSettings, Imported, load};
use lightkiln::output::glb::{PageLink, lit_glb};
use lightkiln::progress::Silent;
use lightkiln::scene::Scene;
use lightkiln::units::Quantity;

/// The lit copy of an asset, loaded again.
fn lit_again(imported: &Imported) -> Imported {
    let (atlas, _) = build(&imported.scene, &AtlasSettings::default(), &Silent).expect("it can be unwrapped");
    let pages: Vec<_> = atlas.pages.iter().map(|p| PageImage::black(p.width, p.height)).collect();
    let link = || PageLink { uri: "lightmap_0.exr".into(), quantity: Quantity::Irradiance };
    let links: Vec<_> = pages.iter().map(|_| link()).collect();
    let glb = lit_glb(&imported.document, &imported.scene, &atlas, &pages, &links).expect("a sound document");
    let folder = tempfile::TempDir::new().expect("a temporary folder");
    let path = folder.path().join("lit.glb");
    std::fs::write(&path, glb).expect("the folder is writable");
    load(&path, &ImportSettings::default(), &Silent).expect("the lit copy loads")
}

/// Corners and reflectance of every triangle.
fn looks(scene: &Scene) -> Vec<([Vec3; 3], Vec3)> {
    let middle = Vec2::splat(1.0 / 3.0);
    let of = |t: usize| (scene.corners(0, t), scene.reflectance_at(0, t, middle));
    (0..scene.triangle_count()).map(of).collect()
}

#[test]
fn compressed_files_survive_into_their_lit_copies() {
    let check = |asset: Asset| {
        let imported = asset.imported();
        let again = lit_again(&imported);
        assert_clean(&again);
        let (before, after) = (looks(&imported.scene), looks(&again.scene));
        assert_eq!(before.len(), after.len());
        for ((corners, reflectance), (lit_corners, lit_reflectance)) in before.iter().zip(&after) {
            assert_eq!(corners, lit_corners);
            assert!(reflectance.distance(*lit_reflectance) < 1e-5, "{reflectance} and {lit_reflectance}");
        }
    };
    check(draco());
    check(meshopt("EXT_meshopt_compression"));
    check(quantised());
    check(basis(UASTC));
    check(basis(ETC1S));
}
