//! An opened file: raw JSON and buffers beside the typed core of glTF.

use super::{ImportError, buffers, checked, container, draco, extensions, json, meshopt, uri};
use crate::document::{Document, ExternalImage};
use std::path::Path;

/// The raw and the typed side of one asset; indices agree.
pub(super) struct Source {
    /// Everything as it stands in the file, for extensions and images.
    pub(super) document: Document,
    /// Core glTF, every index checked.
    pub(super) gltf: gltf::Document,
}

/// Reads the file and its buffers, undoes compression, and checks what later steps rely on.
pub(super) fn open(path: &Path) -> Result<Source, ImportError> {
    let container = container::read(path)?;
    extensions::check_required(&container.json)?;
    let directory = path.parent().unwrap_or(Path::new("")).to_path_buf();
    let mut json = container.json;
    let mut buffers = buffers::load(&json, container.chunk, &directory)?;
    meshopt::decode(&mut json, &mut buffers)?;
    draco::decode(&mut json, &mut buffers)?;
    let mut document = Document { json, buffers, directory, external_images: Vec::new() };
    document.external_images = external_images(&document);
    let gltf = checked::document(path, &document.json, &document.buffers)?;
    Ok(Source { document, gltf })
}

fn external_images(document: &Document) -> Vec<ExternalImage> {
    let external = document.array("images").iter().enumerate().filter_map(|(image, raw)| {
        let uri = json::string(raw, "uri").filter(|uri| !uri.starts_with("data:"))?;
        match uri::resolve(uri, &document.directory) {
            Ok(uri::Resource::File(path)) => Some(ExternalImage { image, uri: uri.to_owned(), path }),
            _ => None,
        }
    });
    external.collect()
}
