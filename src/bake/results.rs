//! From pages of irradiance to the files of a bake: EXR pages, lit scene, report.

use super::BakeError;
use crate::atlas::{Atlas, PageImage, Texels};
use crate::config::Settings;
use crate::import::Imported;
use crate::output::exr::{PageAttributes, clamped_texels, write_page};
use crate::output::glb::{PageLink, lit_glb};
use crate::output::html::write_html;
use crate::output::report::{AtlasFacts, PageFacts, Report, SceneFacts};
use crate::output::{OutputError, OutputSet, Precision};
use crate::post;
use crate::progress::{Cancelled, Progress, Stage};
use crate::warning::Warning;
use std::ffi::OsStr;
use std::path::Path;

pub(super) const REPORT_JSON: &str = "report.json";
pub(super) const REPORT_HTML: &str = "report.html";

/// The files of one bake.
pub(super) struct Results {
    outputs: OutputSet,
    lit_scene: String,
}

impl Results {
    /// Prepares the folder for a bake of `scene`: what would stop the results from being written, stops the bake now.
    pub(super) fn open(scene: &Path, settings: &Settings) -> Result<Self, OutputError> {
        let lit_scene = Self::lit_scene_name(scene);
        let names = [lit_scene.as_str(), REPORT_JSON, REPORT_HTML];
        let outputs = OutputSet::open(&settings.output.folder, &names, settings.output.force)?;
        Ok(Self { outputs, lit_scene })
    }

    /// File name of the lit copy of `scene`.
    pub(super) fn lit_scene_name(scene: &Path) -> String {
        format!("{}.lit.glb", scene.file_stem().unwrap_or(OsStr::new("scene")).to_string_lossy())
    }

    /// Writes an EXR page under a temporary name: of all light, or of one group.
    pub(super) fn write_page(
        &mut self,
        file: &str,
        image: &PageImage,
        page: usize,
        group: Option<&str>,
        scene_hash: &str,
        settings: &Settings,
    ) -> Result<(), OutputError> {
        let group = group.map(str::to_owned);
        let quantity = settings.output.quantity;
        let attributes = PageAttributes { quantity, uv_set: 1, page, scene_hash: scene_hash.into(), group };
        self.outputs.write(file, |sink| write_page(sink, image, settings.output.precision, &attributes))
    }

    /// Writes a file that the results are whole without.
    pub(super) fn write_if_possible(&mut self, file: &str, content: &[u8]) -> Result<(), OutputError> {
        self.outputs.write_if_possible(file, |sink| sink.write_all(content))
    }

    /// Writes the EXR pages and the lit scene, still under temporary names. Returns the pages as they were written.
    pub(super) fn write_pages(
        &mut self,
        imported: &mut Imported,
        scene_hash: &str,
        (atlas, texels): (&Atlas, &Texels),
        irradiance: &[PageImage],
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<Vec<PageImage>, BakeError> {
        let quantity = settings.output.quantity;
        let pages = post::convert(irradiance, atlas, texels, quantity, &settings.post);
        let mut links = Vec::with_capacity(pages.len());
        for (i, page) in pages.iter().enumerate() {
            step(progress, i as f64 / (pages.len() + 1) as f64)?;
            let name = OutputSet::page_name(i);
            if let Some(warning) = too_bright(&name, page, settings.output.precision) {
                progress.warn(&warning);
                imported.warnings.push(warning);
            }
            self.write_page(&name, page, i, None, scene_hash, settings)?;
            links.push(PageLink { uri: name, quantity });
        }
        step(progress, pages.len() as f64 / (pages.len() + 1) as f64)?;
        let glb = lit_glb(&imported.document, &imported.scene, atlas, irradiance, &links)?;
        self.outputs.write(&self.lit_scene, |sink| sink.write_all(&glb))?;
        Ok(pages.into_owned())
    }

    /// Writes the report and gives all files their names, which `report` lists afterwards.
    pub(super) fn finish(
        mut self,
        report: &mut Report,
        pages: &[PageImage],
        progress: &dyn Progress,
    ) -> Result<(), BakeError> {
        report.outputs = self.outputs.names();
        report.outputs.extend([REPORT_JSON.into(), REPORT_HTML.into()]);
        self.outputs.write(REPORT_JSON, |sink| report.write_json(sink))?;
        self.outputs.write(REPORT_HTML, |sink| write_html(sink, report, pages))?;
        if progress.is_cancelled() {
            return Err(Cancelled.into());
        }
        self.outputs.commit()?;
        progress.report(Stage::Output, 1.0);
        Ok(())
    }
}

fn step(progress: &dyn Progress, done: f64) -> Result<(), Cancelled> {
    progress.report(Stage::Output, done);
    if progress.is_cancelled() { Err(Cancelled) } else { Ok(()) }
}

fn too_bright(name: &str, page: &PageImage, precision: Precision) -> Option<Warning> {
    let count = clamped_texels(page, precision);
    let message = format!("{count} texels exceed the half floats' 65504 and are clamped: bake with --float");
    (count > 0).then(|| Warning::new("clamped", name, message))
}

/// What the report says about the scene.
pub(super) fn scene_facts(imported: &Imported, path: &Path, hash: String) -> SceneFacts {
    let scene = &imported.scene;
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

/// What the report says about the atlas.
pub(super) fn atlas_facts(atlas: &Atlas, texels: &Texels, pages: &[PageImage]) -> AtlasFacts {
    AtlasFacts {
        unwrapper: atlas.unwrapper.into(),
        charts: atlas.charts.len(),
        texels: texels.len(),
        padding: atlas.padding,
        pages: pages.iter().enumerate().map(|(i, p)| PageFacts::of(OutputSet::page_name(i), p)).collect(),
    }
}
