//! Import: a .glb or .gltf file → a resolved [`Scene`] in SI units, the [`Document`] it came from, and what was wrong.
//!
//! Core glTF is read through the `gltf` crate; lamps, environment and settings of LIGHTKILN_scene and the material,
//! light and instancing extensions through the raw JSON. Strengths leave in W/(m²·sr), W/sr and W/m².

mod accessors;
mod audit;
mod buffers;
mod checked;
mod checks;
mod container;
mod deform;
mod draco;

mod environment;
mod error;
mod extensions;
mod files;
mod geometry;
mod ies;
mod instances;
mod json;
mod ktx2;
mod lights;
mod materials;
mod meshes;
mod meshopt;
mod nodes;
mod profiles;
mod roots;
mod skins;
mod sky;
mod source;
mod textures;
mod topology;
mod triangles;
mod uri;

pub use error::ImportError;

use crate::document::Document;
use crate::progress::{Counter, Progress, Stage};
use crate::scene::Scene;
use crate::units::LightUnits;
use crate::warning::Warning;
use meshes::ShownMeshes;
use serde::{Deserialize, Serialize};
use std::path::Path;
use textures::TextureSlots;

/// The extension that carries what core glTF cannot say.
const EXTENSION: &str = "LIGHTKILN_scene";

/// How to read a file.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ImportSettings {
    /// Units of lamps and emission; by default radiometric if the file has LIGHTKILN_scene, else photometric.
    pub light_units: Option<LightUnits>,
    /// Name or index of the glTF scene; by default the file's default scene, or else its first.
    pub scene: Option<String>,
}

/// A scene and where it came from.
#[derive(Clone, Debug)]
pub struct Imported {
    /// What is baked.
    pub scene: Scene,
    /// The file, for the lit copy.
    pub document: Document,
    /// Faults that were worked around.
    pub warnings: Vec<Warning>,
}

/// Reads the scene in `path`.
pub fn load(path: &Path, settings: &ImportSettings, progress: &dyn Progress) -> Result<Imported, ImportError> {
    progress.report(Stage::Import, 0.0);
    let mut warnings = Vec::new();
    let source = source::open(path, &mut warnings)?;
    audit::check(&source.document, &mut warnings);
    let units = settings.light_units.unwrap_or(match source.document.root_extension(EXTENSION) {
        Some(_) => LightUnits::Radiometric,
        None => LightUnits::Photometric,
    });
    let roots = roots::choose(&source.gltf, settings.scene.as_deref(), &mut warnings)?;
    let nodes = nodes::walk(&source, &roots, &mut warnings);
    let shown = ShownMeshes::collect(&source, &nodes, &mut warnings)?;

    let mut slots = TextureSlots::default();
    let materials = shown.materials(&source);
    let mut loaded: Vec<_> =
        materials.iter().map(|used| materials::load(&source, used, units, &mut slots, &mut warnings)).collect();
    let counter = Counter::new(progress, Stage::Import, slots.len() + shown.len());
    let textures = slots.decode(&source.document, &mut loaded, &counter, &mut warnings)?;
    let meshes = shown.load(&source, &materials, &counter, &mut warnings)?;

    let mut scene = Scene {
        name: path.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy().into_owned()),
        materials: loaded,
        textures,
        lights: lights::load(&source.document, &nodes, units, &mut warnings),
        environment: environment::load(&source.document, &mut warnings),
        ..Scene::default()
    };
    shown.place(&source, &nodes, meshes, &mut scene, &mut warnings)?;
    if scene.instances.is_empty() {
        return Err(ImportError::no_meshes(path, &warnings));
    }
    checks::check(&scene, &mut warnings);
    progress.report(Stage::Import, 1.0);
    Ok(Imported { scene, document: source.document, warnings })
}
