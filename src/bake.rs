//! The order of the stages: scene file and settings → results on the disk.

mod light;

use crate::atlas::{self, Atlas, AtlasError, PageImage, Texels};
use crate::config::Settings;
use crate::import::{self, ImportError, Imported};
use crate::output::exr::{PageAttributes, clamped_texels, write_page};
use crate::output::glb::{GlbError, PageLink, lit_glb};
use crate::output::html::write_html;
use crate::output::identity::scene_hash;
pub use crate::output::report::Report;
use crate::output::report::{AtlasFacts, PageFacts, SCHEMA, SceneFacts, StageClock};
use crate::output::{OutputError, OutputSet, OutputSettings, process};
use crate::post;
use crate::progress::{Cancelled, Progress, Stage};
use crate::scene::Scene;
use crate::warning::Warning;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use thiserror::Error;

/// Why a bake did not come to its end.
#[derive(Debug, Error)]
pub enum BakeError {
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The scene cannot be read.
    #[error(transparent)]
    Import(ImportError),
    /// There is no layout for it.
    #[error(transparent)]
    Atlas(AtlasError),
    /// Results cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The lit copy of the scene cannot be made.
    #[error("cannot write the lit scene")]
    Glb(#[from] GlbError),
}

impl From<ImportError> for BakeError {
    fn from(error: ImportError) -> Self {
        match error {
            ImportError::Cancelled(c) => Self::Cancelled(c),
            other => Self::Import(other),
        }
    }
}

impl From<AtlasError> for BakeError {
    fn from(error: AtlasError) -> Self {
        match error {
            AtlasError::Cancelled(c) => Self::Cancelled(c),
            other => Self::Atlas(other),
        }
    }
}

impl BakeError {
    /// Stable, machine-readable kind.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Cancelled(_) => "interrupted",
            Self::Import(_) => "import",
            Self::Atlas(_) => "atlas",
            Self::Output(e) => e.code(),
            Self::Glb(_) => "lit_scene",
        }
    }
}

/// Bakes the scene in `path` and writes the results.
pub fn bake(path: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report, BakeError> {
    let mut clock = StageClock::start();
    let stem = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let names = Names { lit: format!("{stem}.lit.glb") };
    let mut outputs =
        OutputSet::open(&settings.output.folder, &[&names.lit, REPORT_JSON, REPORT_HTML], settings.output.force)?;

    let Imported { scene, document, mut warnings } =
        clock.measure(Stage::Import, || import::load(path, &settings.import, progress))?;
    let hash = scene_hash(&document);
    warnings.iter().for_each(|w| progress.warn(w));

    let (atlas, faults) = clock.measure(Stage::Atlas, || atlas::build(&scene, &settings.atlas, progress))?;
    faults.iter().for_each(|w| progress.warn(w));
    warnings.extend(faults);
    let texels = clock.measure(Stage::Texels, || atlas::rasterise(&scene, &atlas, progress))?;

    let (lightmap, counts) = light::light(&scene, &atlas, &texels, settings.error, &mut clock, progress)?;
    let irradiance = clock
        .measure(Stage::Post, || post::finish(&atlas, &texels, &scene, &lightmap.combined, &settings.post, progress))?;

    let quantity = settings.output.quantity;
    let pages = post::convert(&irradiance, &atlas, &texels, quantity, &settings.post);
    progress.report(Stage::Output, 0.0);
    let mut links = Vec::new();
    clock.measure(Stage::Output, || -> Result<(), BakeError> {
        for (i, page) in pages.iter().enumerate() {
            let name = OutputSet::page_name(i);
            let attributes = PageAttributes { quantity, uv_set: 1, page: i, scene_hash: hash.clone() };
            let clamped = clamped_texels(page, settings.output.precision);
            if clamped > 0 {
                let warning = Warning::new(
                    "clamped",
                    name.as_str(),
                    format!(
                        "{clamped} texels are too bright for half floats and were clamped to 65504; bake with --float"
                    ),
                );
                progress.warn(&warning);
                warnings.push(warning);
            }
            outputs.write(&name, |sink| write_page(sink, page, settings.output.precision, &attributes))?;
            links.push(PageLink { uri: name, quantity });
            stop_if_cancelled(progress)?;
            progress.report(Stage::Output, (i + 1) as f64 / (pages.len() + 1) as f64);
        }
        let glb = lit_glb(&document, &scene, &atlas, &irradiance, &links)?;
        outputs.write(&names.lit, |sink| sink.write_all(&glb))?;
        Ok(())
    })?;
    stop_if_cancelled(progress)?;

    let mut files: Vec<String> = links.into_iter().map(|l| l.uri).collect();
    files.extend([names.lit, REPORT_JSON.into(), REPORT_HTML.into()]);
    let report = Report {
        schema: SCHEMA,
        version: env!("CARGO_PKG_VERSION"),
        scene: scene_facts(&scene, path, hash),
        settings: settings_facts(settings),
        stages: clock.stages().to_vec(),
        total: clock.total(),
        rays: counts.rays,
        solver: counts.solver,
        atlas: atlas_facts(&atlas, &texels, &pages),
        memory_peak_bytes: process::peak_memory(),
        warnings,
        outputs: files,
    };
    outputs.write(REPORT_JSON, |sink| report.write_json(sink))?;
    outputs.write(REPORT_HTML, |sink| write_html(sink, &report, &pages))?;
    stop_if_cancelled(progress)?;
    outputs.commit()?;
    progress.report(Stage::Output, 1.0);
    Ok(report)
}

const REPORT_JSON: &str = "report.json";
const REPORT_HTML: &str = "report.html";

struct Names {
    lit: String,
}

fn stop_if_cancelled(progress: &dyn Progress) -> Result<(), Cancelled> {
    if progress.is_cancelled() { Err(Cancelled) } else { Ok(()) }
}

fn scene_facts(scene: &Scene, path: &Path, hash: String) -> SceneFacts {
    SceneFacts {
        name: scene.name.clone(),
        file: path.display().to_string(),
        hash,
        meshes: scene.meshes.len(),
        instances: scene.instances.len(),
        triangles: scene.triangle_count(),
        lights: scene.lights.len(),
        textures: scene.textures.len(),
    }
}

fn settings_facts(settings: &Settings) -> BTreeMap<String, serde_json::Value> {
    let OutputSettings { quantity, precision, .. } = &settings.output;
    BTreeMap::from([
        ("error".into(), json!(settings.error)),
        ("quantity".into(), json!(quantity)),
        ("precision".into(), json!(precision)),
        ("uv".into(), json!(format!("{:?}", settings.atlas.uv).to_lowercase())),
        ("texels_per_metre".into(), json!(settings.atlas.texels_per_metre)),
        ("resolution".into(), json!(settings.atlas.resolution)),
    ])
}

fn atlas_facts(atlas: &Atlas, texels: &Texels, pages: &[PageImage]) -> AtlasFacts {
    AtlasFacts {
        unwrapper: atlas.unwrapper.into(),
        charts: atlas.charts.len(),
        texels: texels.len(),
        padding: atlas.padding,
        pages: pages.iter().enumerate().map(|(i, p)| PageFacts::of(OutputSet::page_name(i), p)).collect(),
    }
}
