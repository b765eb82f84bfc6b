//! The lit scene: the source document with lightmap coordinates and `MOZ_lightmap` materials → a GLB file.
//!
//! Whatever the source holds beside that survives, understood or not: extensions, extras, cameras, animations. Every
//! instance has a place of its own in the atlas and therefore a mesh of its own; data that they share is written once.

mod accessors;
mod asset;
mod instancing;
mod materials;
mod meshes;
mod relit;

use crate::atlas::{Atlas, PageImage};
use crate::document::Document;
use crate::scene::Scene;
use crate::units::Quantity;
pub use relit::relit_glb;

use asset::Asset;
use materials::Materials;
use meshes::Meshes;
use serde_json::{Value, json};
use std::collections::{BTreeMap, HashSet};
use std::fs;
use thiserror::Error;

/// The EXR that goes with a page.
#[derive(Clone, Debug)]
pub struct PageLink {
    /// File name, relative to the GLB.
    pub uri: String,
    /// What its texels mean. The texture inside the GLB holds irradiance in any case.
    pub quantity: Quantity,
}

/// Why there is no lit copy. Import accepts no document for which the first ones arise.
#[derive(Debug, Error)]
pub enum GlbError {
    /// The document is not a JSON object.
    #[error("the glTF document is not a JSON object")]
    NotAnObject,
    /// A mesh is not there or has no primitives.
    #[error("meshes[{0}] cannot be read again")]
    Mesh(usize),
    /// A primitive's attributes are malformed.
    #[error("a primitive's attributes cannot be read again")]
    Attributes,
    /// An accessor is malformed or exceeds its buffer.
    #[error("accessors[{0}] cannot be read again")]
    Accessor(usize),
    /// GLB sizes are 32-bit numbers.
    #[error("the lit scene exceeds the 4 GB that a GLB file can hold; split the scene, or bake at a lower density")]
    TooLarge,
    /// A page could not be encoded.
    #[error("a lightmap page cannot be encoded")]
    Image(#[from] image::ImageError),
}

/// The lit copy of `document`, as the content of a GLB file. `scene` and `atlas` come from that document; `pages` hold
/// irradiance, and `links` name the EXR files of the same pages.
pub fn lit_glb(
    document: &Document,
    scene: &Scene,
    atlas: &Atlas,
    pages: &[PageImage],
    links: &[PageLink],
) -> Result<Vec<u8>, GlbError> {
    let mut asset = Asset::copy(document)?;
    embed_files(&mut asset, document);
    let mut materials = Materials::new(&mut asset, pages, links)?;
    let mut meshes = Meshes::new(document, atlas);
    let mut free_slots = FreeSlots::new(document, scene, atlas);

    let mut by_node: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, instance) in scene.instances.iter().enumerate() {
        by_node.entry(instance.node).or_default().push(i);
    }
    for (node, instances) in by_node {
        let places = instancing::places(document, node)?;
        for &i in &instances {
            let instance = &scene.instances[i];
            let mesh = &scene.meshes[instance.mesh];
            let lit = match &atlas.layouts[i] {
                Some(layout) => {
                    let lit = meshes.lit(&mut asset, &mut materials, mesh, layout)?;
                    free_slots.put(&mut asset, mesh.source, lit)
                }
                None => mesh.source,
            };
            match &places {
                Some(places) => {
                    let place = instance.gpu_instance.and_then(|n| places.get(n as usize));
                    let mut child = place.cloned().unwrap_or_default();
                    child.insert("mesh".into(), lit.into());
                    let child = asset.push("nodes", child.into());
                    add_child(&mut asset, node, child);
                }
                None => asset.array("nodes")[node]["mesh"] = lit.into(),
            }
        }
        if places.is_some() {
            stop_instancing(&mut asset, node);
        }
    }
    let still_instanced = asset.array("nodes").iter().any(|n| n["extensions"].get(instancing::EXTENSION).is_some());
    if !still_instanced {
        asset.drop_extension(instancing::EXTENSION);
    }
    asset.into_glb()
}

/// Entry `key` of an object as an index or size.
fn index(value: &Value, key: &str) -> Option<usize> {
    value.get(key)?.as_u64()?.try_into().ok()
}

/// Meshes that only lit nodes show: the first lit copy takes their place, so that nothing unused stays behind.
struct FreeSlots(HashSet<usize>);

impl FreeSlots {
    fn new(document: &Document, scene: &Scene, atlas: &Atlas) -> Self {
        let lit: HashSet<usize> =
            scene.instances.iter().zip(&atlas.layouts).filter(|(_, l)| l.is_some()).map(|(i, _)| i.node).collect();
        let unlit: HashSet<usize> =
            scene.instances.iter().zip(&atlas.layouts).filter(|(_, l)| l.is_none()).map(|(i, _)| i.node).collect();
        let mut free: HashSet<usize> = (0..document.array("meshes").len()).collect();
        for (n, node) in document.array("nodes").iter().enumerate() {
            if let Some(mesh) = index(node, "mesh")
                && (!lit.contains(&n) || unlit.contains(&n))
            {
                free.remove(&mesh);
            }
        }
        Self(free)
    }

    /// Stores a lit copy of mesh `source` and returns its index.
    fn put(&mut self, asset: &mut Asset, source: usize, lit: Value) -> usize {
        if self.0.remove(&source) {
            asset.array("meshes")[source] = lit;
            return source;
        }
        asset.push("meshes", lit)
    }
}

fn add_child(asset: &mut Asset, node: usize, child: usize) {
    let node = &mut asset.array("nodes")[node];
    match node.get_mut("children").and_then(Value::as_array_mut) {
        Some(children) => children.push(child.into()),
        None => node["children"] = json!([child]),
    }
}

/// The node becomes a plain one: its children show the mesh.
fn stop_instancing(asset: &mut Asset, node: usize) {
    let Some(node) = asset.array("nodes")[node].as_object_mut() else { return };
    node.shift_remove("mesh");
    if let Some(extensions) = node.get_mut("extensions").and_then(Value::as_object_mut) {
        extensions.shift_remove(instancing::EXTENSION);
        if extensions.is_empty() {
            node.shift_remove("extensions");
        }
    }
}

/// Copies the files that the document refers to into the buffer, so that the lit copy looks the same wherever it lies.
/// Those that are missing stay references; import has warned.
fn embed_files(asset: &mut Asset, document: &Document) {
    for external in &document.external_files {
        let Ok(bytes) = fs::read(&external.path) else { continue };
        let view = asset.push_view(&bytes, None, None);
        let mime_type = match external.pointer.as_str() {
            image if image.starts_with("/images/") => Some(mime_type(&bytes)),
            profile if profile.contains("EXT_lights_ies") => Some("application/x-ies-lm-63"),
            _ => None,
        };
        asset.refer_to_view(&external.pointer, view, mime_type);
    }
}

/// By the first bytes: names of files lie.
fn mime_type(bytes: &[u8]) -> &'static str {
    match bytes {
        [0xff, 0xd8, ..] => "image/jpeg",
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => "image/webp",
        [0xab, b'K', b'T', b'X', b' ', b'2', b'0', ..] => "image/ktx2",
        _ => "image/png",
    }
}
