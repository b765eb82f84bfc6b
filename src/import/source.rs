//! An opened file: raw JSON and buffers beside the typed core of glTF.

use super::{ImportError, buffers, checked, container, draco, extensions, meshopt, uri};
use crate::document::{Document, ExternalFile};
use crate::warning::Warning;
use std::path::Path;

/// The raw and the typed side of one asset; indices agree.
pub(super) struct Source {
    /// Everything as it stands in the file, for extensions and images.
    pub(super) document: Document,
    /// Core glTF, every index checked.
    pub(super) gltf: gltf::Document,
}

/// Reads the file and its buffers, undoes compression, and checks what later steps rely on.
pub(super) fn open(path: &Path, warnings: &mut Vec<Warning>) -> Result<Source, ImportError> {
    let container = container::read(path)?;
    extensions::check_required(&container.json)?;
    let directory = path.parent().unwrap_or(Path::new("")).to_path_buf();
    let mut json = container.json;
    let mut buffers = buffers::load(&json, container.chunk, &directory)?;
    meshopt::decode(&mut json, &mut buffers)?;
    draco::decode(&mut json, &mut buffers)?;
    let mut document = Document { json, buffers, directory, ..Document::default() };
    document.external_files = external_files(&document);
    let gltf = checked::document(path, &document.json, &document.buffers, warnings)?;
    Ok(Source { document, gltf })
}

/// Images, and what LIGHTKILN_scene and EXT_lights_ies refer to.
fn external_files(document: &Document) -> Vec<ExternalFile> {
    let count = |extension: &str| {
        let lights = document.root_extension(extension).and_then(|e| e.get("lights"));
        lights.and_then(|l| l.as_array()).map_or(0, Vec::len)
    };
    let own = super::EXTENSION;
    let images = (0..document.array("images").len()).map(|i| format!("/images/{i}"));
    let sky = format!("/extensions/{own}/environment/image");
    let profiles = (0..count(own)).map(|i| format!("/extensions/{own}/lights/{i}/ies"));
    let measured = (0..count("EXT_lights_ies")).map(|i| format!("/extensions/EXT_lights_ies/lights/{i}"));
    images
        .chain([sky])
        .chain(profiles)
        .chain(measured)
        .flat_map(|place| [format!("{place}/uri"), place])
        .filter_map(|pointer| {
            let uri = document.json.pointer(&pointer)?.as_str().filter(|uri| !uri.starts_with("data:"))?;
            match uri::resolve(uri, &document.directory) {
                Ok(uri::Resource::File(path)) => Some(ExternalFile { pointer, path }),
                _ => None,
            }
        })
        .collect()
}
