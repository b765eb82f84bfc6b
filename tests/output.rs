//! The lit scene and the set of output files.

mod scene_file;

use glam::{Vec2, Vec3};
use lightkiln::atlas::{Atlas, AtlasSettings, PageImage, build};
use lightkiln::document::Document;
use lightkiln::import::{ImportSettings, Imported, load};
use lightkiln::output::glb::{PageLink, lit_glb};
use lightkiln::output::{OutputError, OutputSet};
use lightkiln::progress::Silent;
use lightkiln::scene::{Rgb, Scene};
use lightkiln::units::Quantity;
use scene_file::SceneFile;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::Path;
use tempfile::TempDir;

/// Positions of the strip and the fan: two upright unit squares.
const STRIP: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
const FAN: [[f32; 3]; 4] = [[2.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 1.0, 0.0], [2.0, 1.0, 0.5]];
const HEAT: [u8; 4] = [10, 20, 30, 40];
const SHIFT: [[f32; 3]; 4] = [[0.0, 0.0, 0.1], [0.0, 0.0, 0.2], [0.0, 0.0, 0.3], [0.0, 0.0, 0.4]];

/// A mesh with a strip, a fan and a line, placed twice; and another one placed three times by
/// EXT_mesh_gpu_instancing.
fn rich_scene(folder: &Path) -> SceneFile {
    let mut file = SceneFile::new();
    file.json["extensionsUsed"] =
        json!(["EXT_mesh_gpu_instancing", "KHR_materials_clearcoat", "KHR_materials_variants"]);
    file.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    file.json["extensions"] = json!({
        "KHR_materials_variants": { "variants": [{ "name": "wet" }] },
        "EXT_lights_ies": { "lights": [{ "uri": "lamp.ies" }] },
        "LIGHTKILN_scene": { "lights": [{ "type": "point", "ies": "lamp.ies" }] }
    });
    fs::write(folder.join("lamp.ies"), "IES:LM-63-2019").expect("a new folder");
    file.json["extras"] = json!({ "author": "test" });
    image::RgbImage::from_pixel(2, 2, image::Rgb([200, 100, 50])).save(folder.join("paint.png")).expect("a new folder");
    let image = file.push("images", json!({ "uri": "paint.png", "name": "paint" }));
    let texture = file.push("textures", json!({ "source": image }));
    let material = file.push(
        "materials",
        json!({
            "name": "painted",
            "pbrMetallicRoughness": { "baseColorTexture": { "index": texture, "texCoord": 1 }, "metallicFactor": 0.0 },
            "extensions": { "KHR_materials_clearcoat": { "clearcoatFactor": 0.5 } },
            "extras": { "slot": 7 }
        }),
    );

    let attributes = json!({
        "POSITION": file.floats("VEC3", &STRIP),
        "NORMAL": file.floats("VEC3", &[[0.0, 0.0, 1.0]; 4]),
        "TEXCOORD_0": file.floats("VEC2", &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]),
        "TEXCOORD_1": file.floats("VEC2", &[[0.5, 0.5], [0.75, 0.5], [0.5, 0.75], [0.75, 0.75]]),
        "_HEAT": file.padded_bytes(&HEAT),
    });
    let target = json!({ "POSITION": file.floats("VEC3", &SHIFT) });
    let strip = json!({
        "attributes": attributes, "targets": [target], "indices": file.indices(&[0, 1, 2, 3]), "mode": 5,
        "material": material,
        "extensions": { "KHR_materials_variants": { "mappings": [{ "material": material, "variants": [0] }] } }
    });
    let fan = json!({
        "attributes": { "POSITION": file.floats("VEC3", &FAN) }, "targets": [target], "mode": 6
    });
    let line = json!({ "attributes": { "POSITION": file.floats("VEC3", &STRIP) }, "targets": [target], "mode": 1 });
    let mesh = file.push("meshes", json!({ "name": "rich", "primitives": [strip, fan, line] }));
    file.push_root(json!({ "name": "first", "mesh": mesh, "extras": { "id": 1 } }));
    file.push_root(
        json!({ "name": "mirrored", "mesh": mesh, "scale": [-2.0, 1.0, 1.0], "translation": [0.0, 5.0, 0.0] }),
    );

    let square = json!({ "POSITION": file.floats("VEC3", &STRIP) });
    let square = json!({ "attributes": square, "indices": file.indices(&[0, 1, 2, 2, 1, 3]) });
    let mesh = file.push("meshes", json!({ "name": "tile", "primitives": [square] }));
    let places = json!({
        "TRANSLATION": file.floats("VEC3", &[[0.0, 0.0, -2.0], [0.0, 0.0, -4.0], [0.0, 0.0, -6.0]]),
        "SCALE": file.floats("VEC3", &[[1.0, 1.0, 1.0], [2.0, 2.0, 2.0], [1.0, 3.0, 1.0]]),
    });
    let extensions = json!({ "EXT_mesh_gpu_instancing": { "attributes": places } });
    file.push_root(json!({ "name": "tiles", "mesh": mesh, "extensions": extensions }));
    file
}

/// A scene, its atlas, and its lit copy.
struct Lit {
    _folder: TempDir,
    source: Document,
    scene: Scene,
    atlas: Atlas,
    json: Value,
    bin: Vec<u8>,
    glb: Vec<u8>,
}

impl Lit {
    fn new(settings: &AtlasSettings) -> Self {
        let folder = TempDir::new().expect("a temporary folder");
        let path = rich_scene(folder.path()).write(&folder.path().join("rich.glb"));
        let Imported { scene, document, .. } =
            load(&path, &ImportSettings::default(), &Silent).expect("the file is sound");
        let (atlas, _) = build(&scene, settings, &Silent).expect("the settings are sound");
        let page = |p: &lightkiln::atlas::Page| {
            let mut page = PageImage::black(p.width, p.height);
            page.rgb.fill(Rgb::splat(0.5));
            page.valid.fill(true);
            page
        };
        let pages: Vec<_> = atlas.pages.iter().map(page).collect();
        let link = |i| PageLink { uri: OutputSet::page_name(i), quantity: Quantity::Irradiance };
        let links: Vec<_> = (0..pages.len()).map(link).collect();
        let glb = lit_glb(&document, &scene, &atlas, &pages, &links).expect("a sound document");
        let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
        let json = serde_json::from_slice(&glb[20..20 + length]).expect("the first chunk is JSON");
        let bin = glb[28 + length..].to_vec();
        Self { _folder: folder, source: document, scene, atlas, json, bin, glb }
    }

    fn read(&self) -> gltf::Gltf {
        gltf::Gltf::from_slice_without_validation(&self.glb).expect("a GLB file")
    }

    /// Mesh that shows instance `i`: of its node, or of the node's child for that place.
    fn mesh<'a>(&self, gltf: &'a gltf::Gltf, i: usize) -> gltf::Mesh<'a> {
        let instance = &self.scene.instances[i];
        let node = gltf.nodes().nth(instance.node).expect("nodes keep their index");
        match instance.gpu_instance {
            Some(n) => node.children().nth(n as usize).and_then(|c| c.mesh()),
            None => node.mesh(),
        }
        .expect("every instance has a mesh")
    }

    fn accessor(&self, primitive: &gltf::Primitive, semantic: &gltf::Semantic) -> Value {
        self.json["accessors"][primitive.get(semantic).expect("the attribute is there").index()].clone()
    }

    /// Elements of an accessor of floats.
    fn floats(&self, accessor: &Value) -> Vec<Vec<f32>> {
        let view = &self.json["bufferViews"][accessor["bufferView"].as_u64().expect("a view") as usize];
        let start = view["byteOffset"].as_u64().expect("an offset") as usize;
        let stride = view["byteStride"].as_u64().expect("a stride") as usize;
        let count = accessor["count"].as_u64().expect("a count") as usize;
        let float = |b: &[u8]| f32::from_le_bytes(b.try_into().expect("four bytes"));
        (0..count).map(|i| self.bin[start + i * stride..][..stride].chunks(4).map(float).collect()).collect()
    }
}

/// Position and lightmap coordinate of the corners.
type LitTriangle = [(Vec3, Vec2); 3];

fn small() -> AtlasSettings {
    AtlasSettings { texels_per_metre: Some(8.0), ..AtlasSettings::default() }
}

/// Pages too small for all charts.
fn many_pages() -> AtlasSettings {
    AtlasSettings { texels_per_metre: Some(20.0), resolution: Some(64), ..AtlasSettings::default() }
}

/// Every triangle of the atlas is found in the lit scene, in order, with its coordinates.
fn check_coordinates(lit: &Lit) {
    let gltf = lit.read();
    for (i, instance) in lit.scene.instances.iter().enumerate() {
        let mesh = &lit.scene.meshes[instance.mesh];
        let layout = lit.atlas.layouts[i].as_ref().expect("every instance is lit");
        let mut expected: HashMap<(usize, usize), Vec<LitTriangle>> = HashMap::new();
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            let page = lit.atlas.charts[layout.charts[t] as usize].page;
            let size = lit.atlas.pages[page];
            let size = Vec2::new(size.width as f32, size.height as f32);
            let corner = |k: usize| (mesh.positions[triangle[k] as usize], layout.corners[t][k] / size);
            expected.entry((mesh.primitive_of(t).source, page)).or_default().push([0, 1, 2].map(corner));
        }
        let mut found = 0;
        for primitive in lit.mesh(&gltf, i).primitives().filter(|p| p.mode() == gltf::mesh::Mode::Triangles) {
            let reader = primitive.reader(|_| Some(&lit.bin));
            let positions: Vec<Vec3> = reader.read_positions().expect("positions").map(Vec3::from).collect();
            let uvs: Vec<Vec2> = reader.read_tex_coords(1).expect("TEXCOORD_1").into_f32().map(Vec2::from).collect();
            let indices: Vec<u32> = reader.read_indices().expect("indices").into_u32().collect();
            let triangles: Vec<LitTriangle> = indices
                .as_chunks::<3>()
                .0
                .iter()
                .map(|t| t.map(|v| (positions[v as usize], uvs[v as usize])))
                .collect();
            let close = |a: &LitTriangle, b: &LitTriangle| {
                a.iter().zip(b).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs().max_element() < 1e-6)
            };
            let same =
                |e: &Vec<LitTriangle>| e.len() == triangles.len() && e.iter().zip(&triangles).all(|(a, b)| close(a, b));
            assert!(expected.values().any(same), "{}: a primitive that is not in the atlas", instance.path);
            found += triangles.len();
        }
        assert_eq!(found, mesh.triangles.len(), "{}", instance.path);
    }
}

#[test]
fn lit_coordinates_are_the_atlas() {
    check_coordinates(&Lit::new(&small()));
}

#[test]
fn an_instance_may_span_pages() {
    let lit = Lit::new(&many_pages());
    assert!(lit.atlas.pages.len() > 1);
    check_coordinates(&lit);
    let lightmaps = lit.json["images"].as_array().expect("images").iter().filter(|i| i["name"] != "paint").count();
    assert_eq!(lightmaps, lit.atlas.pages.len());
}

#[test]
fn attributes_and_morph_targets_follow_their_vertices() {
    let lit = Lit::new(&small());
    let gltf = lit.read();
    for i in 0..2 {
        let primitive = lit.mesh(&gltf, i).primitives().next().expect("the strip");
        let positions = lit.floats(&lit.accessor(&primitive, &gltf::Semantic::Positions));
        let source = |p: &Vec<f32>| STRIP.iter().position(|s| s[..] == p[..]).expect("positions of the source");
        let sources: Vec<usize> = positions.iter().map(source).collect();

        let heat = lit.accessor(&primitive, &gltf::Semantic::Extras("HEAT".into()));
        let view = &lit.json["bufferViews"][heat["bufferView"].as_u64().expect("a view") as usize];
        let start = view["byteOffset"].as_u64().expect("an offset") as usize;
        for (v, &s) in sources.iter().enumerate() {
            assert_eq!(lit.bin[start + 4 * v], HEAT[s]);
        }
        let target = primitive.morph_targets().next().expect("one target").positions().expect("with positions").index();
        let shifts = lit.floats(&lit.json["accessors"][target]);
        assert!(shifts.iter().zip(&sources).all(|(shift, &s)| shift[..] == SHIFT[s][..]));
    }
}

#[test]
fn materials_keep_what_they_had() {
    let lit = Lit::new(&small());
    let gltf = lit.read();
    let primitive = lit.mesh(&gltf, 0).primitives().next().expect("the strip");
    let index = primitive.material().index().expect("a material");
    let material = &lit.json["materials"][index];
    let original = &lit.source.json["materials"][0];
    assert_eq!(&lit.json["materials"][0], original);
    assert_eq!(material["extras"], original["extras"]);
    assert_eq!(material["extensions"]["KHR_materials_clearcoat"], original["extensions"]["KHR_materials_clearcoat"]);
    // The texture followed its coordinates, which made room for the lightmap's.
    assert_eq!(material["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"], 2);
    assert!(primitive.get(&gltf::Semantic::TexCoords(2)).is_some());

    let lightmap = &material["extensions"]["MOZ_lightmap"];
    assert_eq!(lightmap["texCoord"], 1);
    assert_eq!(lightmap["intensity"], 0.5);
    let texture = &lit.json["textures"][lightmap["index"].as_u64().expect("a texture") as usize];
    let image = &lit.json["images"][texture["source"].as_u64().expect("an image") as usize];
    assert_eq!(image["extras"]["lightmap"]["uri"], "lightmap_0.exr");
    assert_eq!(image["extras"]["lightmap"]["quantity"], "irradiance");
    assert!(lit.json["extensionsUsed"].as_array().expect("a list").contains(&json!("MOZ_lightmap")));

    let variant = &lit.json["meshes"][primitive_mesh(&lit, 0)]["primitives"][0]["extensions"]["KHR_materials_variants"];
    assert_eq!(variant["mappings"][0]["material"], index);
}

fn primitive_mesh(lit: &Lit, instance: usize) -> usize {
    lit.mesh(&lit.read(), instance).index()
}

#[test]
fn meshes_without_coordinates_get_both_sets() {
    let lit = Lit::new(&small());
    let gltf = lit.read();
    let fan = lit.mesh(&gltf, 0).primitives().nth(1).expect("the fan");
    assert!(fan.get(&gltf::Semantic::TexCoords(0)).is_some());
    assert!(fan.get(&gltf::Semantic::Normals).is_none());
    let line = lit.mesh(&gltf, 0).primitives().last().expect("the line");
    assert_eq!(line.mode(), gltf::mesh::Mode::Lines);
}

#[test]
fn instances_have_meshes_of_their_own_and_share_the_rest() {
    let lit = Lit::new(&small());
    let (first, second) = (primitive_mesh(&lit, 0), primitive_mesh(&lit, 1));
    assert_ne!(first, second);
    let attribute = |mesh: usize, name: &str| lit.json["meshes"][mesh]["primitives"][0]["attributes"][name].clone();
    assert_eq!(attribute(first, "POSITION"), attribute(second, "POSITION"));
    assert_ne!(attribute(first, "TEXCOORD_1"), attribute(second, "TEXCOORD_1"));
}

#[test]
fn gpu_instances_become_nodes() {
    let lit = Lit::new(&small());
    let gltf = lit.read();
    let tiles = gltf.nodes().nth(2).expect("the node of the tiles");
    assert!(tiles.mesh().is_none());
    let transforms: Vec<_> = tiles.children().map(|c| c.transform().decomposed()).collect();
    assert_eq!(transforms[1].0, [0.0, 0.0, -4.0]);
    assert_eq!(transforms[2].2, [1.0, 3.0, 1.0]);
    assert_eq!(transforms.len(), 3);
    assert!(!lit.json.to_string().contains("EXT_mesh_gpu_instancing"));
}

#[test]
fn external_images_come_along() {
    let lit = Lit::new(&small());
    let image = &lit.json["images"][0];
    assert_eq!(image["mimeType"], "image/png");
    assert!(image.get("uri").is_none());
    let view = &lit.json["bufferViews"][image["bufferView"].as_u64().expect("a view") as usize];
    let [start, length] = ["byteOffset", "byteLength"].map(|f| view[f].as_u64().expect("a number") as usize);
    let picture = image::load_from_memory(&lit.bin[start..start + length]).expect("a PNG").into_rgb8();
    assert_eq!(picture.get_pixel(1, 1).0, [200, 100, 50]);
    assert_eq!(lit.json["extras"], json!({ "author": "test" }));
    assert_eq!(lit.json["nodes"][0]["extras"], json!({ "id": 1 }));
}

#[test]
fn files_of_extensions_come_along() {
    let lit = Lit::new(&small());
    let measured = &lit.json["extensions"]["EXT_lights_ies"]["lights"][0];
    let own = &lit.json["extensions"]["LIGHTKILN_scene"]["lights"][0]["ies"];
    assert!(measured.get("uri").is_none() && measured["mimeType"] == "application/x-ies-lm-63");
    assert_eq!(own["name"], "lamp.ies");
    for reference in [measured, own] {
        let view = &lit.json["bufferViews"][reference["bufferView"].as_u64().expect("a view") as usize];
        let [start, length] = ["byteOffset", "byteLength"].map(|f| view[f].as_u64().expect("a number") as usize);
        assert_eq!(&lit.bin[start..start + length], b"IES:LM-63-2019");
    }
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .map(|entries| entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect())
        .unwrap_or_default();
    names.sort();
    names
}

#[test]
fn files_appear_together_or_not_at_all() {
    let temporary = TempDir::new().expect("a temporary folder");
    let folder = temporary.path().join("a/b");
    let mut set = OutputSet::open(&folder, &["one", "two"], false).expect("an empty folder");
    set.write("one", |sink| sink.write_all(b"1")).expect("there is space");
    assert!(!folder.join("one").exists());
    drop(set);
    assert!(names(temporary.path()).is_empty(), "the folders are gone, too");

    let mut set = OutputSet::open(&folder, &["one", "two"], false).expect("an empty folder");
    set.write("one", |sink| sink.write_all(b"1")).expect("there is space");
    set.write("two", |sink| sink.write_all(b"2")).expect("there is space");
    set.commit().expect("nothing is in the way");
    assert_eq!(names(&folder), ["one", "two"]);
}

#[test]
fn earlier_results_stay_without_force() {
    let folder = TempDir::new().expect("a temporary folder");
    fs::write(folder.path().join("one"), "old").expect("a new file");
    let refused = OutputSet::open(folder.path(), &["one"], false).expect_err("it exists");
    assert!(refused.to_string().contains("one") && refused.to_string().contains("--force"), "{refused}");
    assert!(!refused.is_environment());

    let mut set = OutputSet::open(folder.path(), &["one"], true).expect("replacing is permitted");
    set.write("one", |sink| sink.write_all(b"new")).expect("there is space");
    assert_eq!(fs::read(folder.path().join("one")).expect("it exists"), b"old");
    set.commit().expect("replacing is permitted");
    assert_eq!(fs::read(folder.path().join("one")).expect("it exists"), b"new");
}

#[test]
fn pages_of_an_earlier_bake_count_as_results() {
    let folder = TempDir::new().expect("a temporary folder");
    for name in ["lightmap_0.exr", "lightmap_7.exr", "lightmap_x.exr"] {
        fs::write(folder.path().join(name), "old").expect("a new file");
    }
    let refused = OutputSet::open(folder.path(), &["report.json"], false).expect_err("pages exist");
    assert!(refused.to_string().contains("lightmap_0.exr"), "{refused}");

    let mut set = OutputSet::open(folder.path(), &["report.json"], true).expect("replacing is permitted");
    set.write("lightmap_0.exr", |sink| sink.write_all(b"new")).expect("there is space");
    set.commit().expect("replacing is permitted");
    assert_eq!(names(folder.path()), ["lightmap_0.exr", "lightmap_x.exr"]);
}

#[test]
fn a_full_disk_leaves_nothing() {
    let temporary = TempDir::new().expect("a temporary folder");
    let folder = temporary.path().join("out");
    let mut set = OutputSet::open(&folder, &["one"], false).expect("an empty folder");
    set.write("one", |sink| sink.write_all(b"1")).expect("there is space");
    let full = set.write("two", |sink| {
        sink.write_all(&[0; 1000])?;
        Err(io::Error::from(ErrorKind::StorageFull))
    });
    let error = full.expect_err("the disk is full");
    assert!(matches!(&error, OutputError::Full { path, .. } if path.ends_with("two")));
    assert!(error.is_environment());
    drop(set);
    assert!(names(temporary.path()).is_empty());
}

#[test]
fn a_file_is_no_folder() {
    let temporary = TempDir::new().expect("a temporary folder");
    let file = temporary.path().join("file");
    fs::write(&file, "").expect("a new file");
    for folder in [file.clone(), file.join("below")] {
        let error = OutputSet::open(&folder, &["one"], true).expect_err("a file is in the way");
        assert!(matches!(error, OutputError::NotAFolder(_)), "{error:?}");
        assert!(error.is_environment());
    }
    assert_eq!(names(temporary.path()), ["file"]);
}
