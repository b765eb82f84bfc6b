//! Import: a .glb or .gltf file → a resolved [`Scene`] in SI units, the [`Document`] it came from, and what was wrong.
//!
//! Core glTF is read through the `gltf` crate; lamps, environment and settings of LIGHTKILN_scene and the material,
//! light and instancing extensions through the raw JSON. Strengths leave in W/(m²·sr), W/sr and W/m².

mod accessors;
mod buffers;
mod checked;
mod checks;
mod container;

mod environment;
mod error;
mod extensions;
mod geometry;
mod instances;
mod json;
mod lights;
mod materials;
mod nodes;
mod textures;
mod topology;
mod triangles;
mod uri;

pub use error::ImportError;

use crate::document::{Document, ExternalImage};
use crate::progress::{Counter, Progress, Stage};
use crate::scene::{Mesh, Scene};
use crate::units::LightUnits;
use crate::warning::Warning;
use geometry::MeshRequest;
use nodes::PlacedNode;
use rayon::prelude::*;
use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use textures::TextureSlots;

/// The extension that carries what core glTF cannot say.
const EXTENSION: &str = "LIGHTKILN_scene";

/// How to read a file.
#[derive(Clone, Debug, Default)]
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
    let document = open(path)?;
    let gltf = checked::document(path, &document.json, &document.buffers)?;
    let units = settings.light_units.unwrap_or(match document.root_extension(EXTENSION) {
        Some(_) => LightUnits::Radiometric,
        None => LightUnits::Photometric,
    });

    let roots = scene_roots(&gltf, settings, &mut warnings)?;
    let nodes = nodes::walk(&gltf, &document, &roots, &mut warnings)?;
    let shown = shown_meshes(&gltf, &nodes, &mut warnings);
    let sources = used_materials(&gltf, &shown.requests);

    let mut slots = TextureSlots::default();
    let mut materials: Vec<_> = sources
        .iter()
        .map(|used| materials::load(&gltf, &document, used.source, used.painted, units, &mut slots, &mut warnings))
        .collect();
    let counter = Counter::new(progress, Stage::Import, slots.len() + shown.requests.len());
    let textures = slots.decode(&document, &mut materials, &counter, &mut warnings)?;
    let meshes = load_meshes(&shown.requests, &document, &sources, &counter, &mut warnings)?;

    let mut scene = Scene {
        name: path.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy().into_owned()),
        materials,
        textures,
        lights: lights::load(&document, &nodes, units, &mut warnings),
        environment: environment::load(&document, &mut warnings),
        ..Scene::default()
    };
    place_meshes(&gltf, &document, &nodes, &shown, meshes, &mut scene, &mut warnings)?;
    if scene.instances.is_empty() {
        return Err(ImportError::NoMeshes(path.into()));
    }
    checks::check(&scene, &mut warnings);
    progress.report(Stage::Import, 1.0);
    Ok(Imported { scene, document, warnings })
}

/// The file's JSON and buffers.
fn open(path: &Path) -> Result<Document, ImportError> {
    let container = container::read(path)?;
    extensions::check_required(&container.json)?;
    let directory = path.parent().unwrap_or(Path::new("")).to_path_buf();
    let buffers = buffers::load(&container.json, container.chunk, &directory)?;
    let mut document = Document { json: container.json, buffers, directory, external_images: Vec::new() };
    document.external_images = external_images(&document);
    Ok(document)
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

/// Root nodes of the scene that is baked.
fn scene_roots(
    gltf: &gltf::Document,
    settings: &ImportSettings,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<usize>, ImportError> {
    let scenes: Vec<_> = gltf.scenes().collect();
    let label = |scene: &gltf::Scene| scene.name().map_or_else(|| scene.index().to_string(), str::to_owned);
    let all = || scenes.iter().map(|s| format!("`{}`", label(s))).collect::<Vec<_>>().join(", ");
    let chosen = match &settings.scene {
        Some(asked) => {
            let named = scenes.iter().find(|s| s.name() == Some(asked.as_str()));
            let numbered = || asked.parse::<usize>().ok().and_then(|i| scenes.get(i));
            Some(named.or_else(numbered).ok_or_else(|| ImportError::NoSuchScene {
                asked: asked.clone(),
                available: if scenes.is_empty() { "no scenes".into() } else { all() },
            })?)
        }
        None => gltf.default_scene().and_then(|s| scenes.get(s.index())).or(scenes.first()),
    };
    let Some(chosen) = chosen else {
        // A file without scenes is a library of nodes: everything that has no parent is shown.
        let children: BTreeSet<_> =
            gltf.nodes().flat_map(|n| n.children().map(|c| c.index()).collect::<Vec<_>>()).collect();
        return Ok(gltf.nodes().map(|n| n.index()).filter(|n| !children.contains(n)).collect());
    };
    if scenes.len() > 1 && settings.scene.is_none() {
        let message = format!("the file has the scenes {}; only this one is baked, choose with --scene", all());
        warnings.push(Warning::new("several_scenes", label(chosen), message));
    }
    Ok(chosen.nodes().map(|node| node.index()).collect())
}

/// Meshes of the placed nodes, each once.
struct ShownMeshes<'a> {
    requests: Vec<MeshRequest<'a>>,
    /// Position in `requests` per placed node.
    of_node: Vec<Option<usize>>,
}

fn shown_meshes<'a>(
    gltf: &'a gltf::Document,
    placed: &'a [PlacedNode],
    warnings: &mut Vec<Warning>,
) -> ShownMeshes<'a> {
    let nodes: Vec<_> = gltf.nodes().collect();
    let meshes: Vec<_> = gltf.meshes().collect();
    let mut requests: Vec<MeshRequest> = Vec::new();
    // Nodes with weights of their own need a copy of the mesh for each set of weights.
    let mut known: HashMap<(usize, Vec<u32>), usize> = HashMap::new();
    let of_node = placed.iter().map(|placed| {
        let node = &nodes[placed.node];
        let mesh = meshes[node.mesh()?.index()].clone();
        let weights = node.weights().or(mesh.weights()).unwrap_or(&[]);
        let morphed = mesh.primitives().any(|p| p.morph_targets().len() > 0);
        if morphed {
            let message = "its morph targets are baked at their default weights: apply the shape that is wanted";
            warnings.push(Warning::new("morph_rest_pose", placed.path.as_str(), message));
        }
        let weights = if morphed { weights } else { &[] };
        let key = (mesh.index(), weights.iter().map(|w| w.to_bits()).collect());
        let next = requests.len();
        let number = *known.entry(key).or_insert(next);
        if number == next {
            requests.push(MeshRequest { mesh, weights, path: &placed.path });
        }
        Some(number)
    });
    let of_node = of_node.collect();
    ShownMeshes { requests, of_node }
}

/// A glTF material in use, none for the default one.
struct UsedMaterial {
    source: Option<usize>,
    /// A primitive with vertex colours uses it.
    painted: bool,
}

/// Materials of the shown meshes by index, the default one first.
fn used_materials(gltf: &gltf::Document, requests: &[MeshRequest]) -> Vec<UsedMaterial> {
    let mut used: Vec<Option<bool>> = vec![None; gltf.materials().len() + 1];
    for primitive in requests.iter().flat_map(|request| request.mesh.primitives()) {
        let slot = primitive.material().index().map_or(0, |i| i + 1);
        let painted = primitive.get(&gltf::Semantic::Colors(0)).is_some();
        used[slot] = Some(painted || used[slot] == Some(true));
    }
    let used = used.into_iter().enumerate();
    used.filter_map(|(slot, painted)| Some(UsedMaterial { source: slot.checked_sub(1), painted: painted? })).collect()
}

fn load_meshes(
    requests: &[MeshRequest],
    document: &Document,
    used: &[UsedMaterial],
    counter: &Counter,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Mesh>, ImportError> {
    let number: HashMap<_, _> = used.iter().enumerate().map(|(i, used)| (used.source, i)).collect();
    let material_of = |source: Option<usize>| number[&source];
    let loaded: Vec<_> = requests
        .par_iter()
        .map(|request| {
            counter.advance(1)?;
            geometry::load(request, &document.buffers, &material_of)
        })
        .collect::<Result<_, ImportError>>()?;
    let (meshes, faults): (Vec<_>, Vec<_>) = loaded.into_iter().unzip();
    warnings.extend(faults.into_iter().flatten());
    Ok(meshes)
}

/// Adds the meshes that have triangles, and their instances, to the scene.
fn place_meshes(
    gltf: &gltf::Document,
    document: &Document,
    nodes: &[PlacedNode],
    shown: &ShownMeshes,
    meshes: Vec<Mesh>,
    scene: &mut Scene,
    warnings: &mut Vec<Warning>,
) -> Result<(), ImportError> {
    let mut kept = Vec::with_capacity(meshes.len());
    for (mesh, request) in meshes.into_iter().zip(&shown.requests) {
        if mesh.triangles.is_empty() {
            let message =
                format!("mesh `{}` has no triangle left and is skipped: remove it or give it faces", mesh.name);
            warnings.push(Warning::new("empty_mesh", request.path, message));
            kept.push(None);
        } else {
            kept.push(Some(scene.meshes.len()));
            scene.meshes.push(mesh);
        }
    }
    for (node, request) in nodes.iter().zip(&shown.of_node) {
        if let Some(mesh) = request.and_then(|request| kept[request]) {
            scene.instances.extend(instances::place(gltf, document, node, mesh, warnings)?);
        }
    }
    Ok(())
}
