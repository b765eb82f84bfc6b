//! The order of relighting: solution and changes → results on the disk, without a scene and without a ray.

use super::groups::{SOLUTION, file_labels};
use super::results::{REPORT_HTML, REPORT_JSON};
use super::{BakeError, bake};
use crate::atlas::PageImage;
use crate::config::Settings;
use crate::import;
use crate::output::exr::{PageAttributes, write_page};
use crate::output::glb::{PageLink, relit_glb};
use crate::output::html::write_html;
use crate::output::identity::scene_hash;
use crate::output::report::{
    AtlasFacts, GroupFacts, PageFacts, RelightFacts, Report, SCHEMA, SceneFacts, SolverFacts, StageClock,
};
use crate::output::{OutputSet, State, open_result, process, read_result};
use crate::post;
use crate::progress::{Progress, Quiet, Stage};
use crate::relight::{Assignment, Changes, Header, PageLayout, Relit, SolutionReader, relight as recombine};
use crate::scene::Rgb;
use crate::units::Quantity;
use crate::warning::Warning;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What is to be relit, and how.
#[derive(Clone, Debug, Default)]
pub struct RelightSettings {
    /// Folder of the bake.
    pub folder: PathBuf,
    /// What changes, relative to the bake.
    pub changes: Vec<Assignment>,
    /// Folder of the results; the bake's own if none is given.
    pub out: Option<PathBuf>,
    /// True: results that exist are replaced.
    pub force: bool,
    /// True: where reflectances changed so much that the error of the bake is exceeded, the scene is baked again.
    pub refine: bool,
    /// The scene file, if it is no longer where it was.
    pub scene: Option<PathBuf>,
}

impl RelightSettings {
    /// Folder of the results.
    pub fn out(&self) -> &Path {
        self.out.as_deref().unwrap_or(&self.folder)
    }
}

/// Recombines what a bake kept and writes the results.
pub fn relight(settings: &RelightSettings, progress: &dyn Progress) -> Result<Report, BakeError> {
    let clock = StageClock::start();
    let solution = clock.measure(Stage::Import, || read(settings))?;
    let header = solution.header.clone();
    let changes = Changes::resolve(&settings.changes, &header.known)?;
    let baked: Settings = parsed(settings, &header.settings)?;
    let state: State = parsed(settings, &header.report["state"])?;
    let mut outputs = open(settings, &header)?;

    let names: Vec<String> = header.known.groups.iter().map(|g| g.name.clone()).collect();
    let labels = file_labels(&names);
    let mut groups: Vec<GroupFacts> = (0..names.len())
        .map(|g| GroupFacts { name: names[g].clone(), lights: header.known.lights_of(g), pages: Vec::new() })
        .collect();
    let write = |outputs: &mut OutputSet, file: &str, page: &PageImage, k: usize, group: Option<&str>| {
        let attributes = PageAttributes {
            quantity: header.quantity,
            uv_set: 1,
            page: k,
            scene_hash: header.scene_hash.clone(),
            state,
            group: group.map(str::to_owned),
        };
        outputs.write(file, |sink| write_page(sink, page, baked.output.precision, &attributes))
    };
    let relit: Relit = clock
        .measure(Stage::Post, || {
            recombine::<_, BakeError>(solution, &changes, progress, |g, k, layout, image| {
                let page = in_quantity(&header, layout, &changes, image);
                let file = OutputSet::group_page_name(k, &labels[g]);
                write(&mut outputs, &file, &page, k, Some(&names[g]))?;
                groups[g].pages.push(PageFacts::of(file, &page));
                Ok(())
            })
        })
        .map_err(|error| error.at(&settings.folder.join(SOLUTION)))?;

    if settings.refine && relit.expected_error > f64::from(baked.error) {
        drop(outputs);
        return refine(settings, &header, baked, &changes, progress);
    }
    let mut pages = Vec::new();
    let mut warnings = Vec::new();
    clock.measure(Stage::Output, || {
        for (k, (image, layout)) in relit.pages.iter().zip(&relit.layouts).enumerate() {
            let page = in_quantity(&header, layout, &changes, image.clone());
            write(&mut outputs, &OutputSet::page_name(k), &page, k, None)?;
            pages.push(page);
        }
        lit_scene(settings, &header, &relit.pages, &mut outputs, &mut warnings)
    })?;
    if relit.expected_error > f64::from(baked.error) {
        warnings.push(beyond(relit.expected_error, baked.error));
    }
    warnings.iter().for_each(|w| progress.warn(w));
    let mut report = Report {
        schema: SCHEMA,
        version: env!("CARGO_PKG_VERSION"),
        scene: parsed::<SceneFacts>(settings, &header.report["scene"])?,
        state,
        settings: parsed::<BTreeMap<String, Value>>(settings, &header.report["settings"])?,
        stages: clock.stages(),
        total: clock.total(),
        rays: BTreeMap::new(),
        solver: SolverFacts::default(),
        atlas: parsed::<AtlasFacts>(settings, &header.report["atlas"])?,
        groups,
        relight: Some(RelightFacts {
            changes: settings.changes.iter().map(Assignment::to_string).collect(),
            expected_error: relit.expected_error,
        }),
        audit: None,
        refinements: Vec::new(),
        memory_peak_bytes: process::peak_memory(),
        warnings,
        outputs: outputs.names(),
    };
    report.atlas.pages = pages.iter().enumerate().map(|(k, p)| PageFacts::of(OutputSet::page_name(k), p)).collect();
    report.outputs.extend([REPORT_JSON.into(), REPORT_HTML.into()]);
    outputs.write(REPORT_JSON, |sink| report.write_json(sink))?;
    outputs.write(REPORT_HTML, |sink| write_html(sink, &report, &pages))?;
    outputs.commit()?;
    progress.report(Stage::Output, 1.0);
    Ok(report)
}

fn read(settings: &RelightSettings) -> Result<SolutionReader<impl std::io::Read + use<>>, BakeError> {
    let path = settings.folder.join(SOLUTION);
    let file = open_result(&path)?.ok_or_else(|| BakeError::NoSolution(path.clone()))?;
    SolutionReader::open(file).map_err(|error| BakeError::from(error).at(&path))
}

/// Opens the set of results.
fn open(settings: &RelightSettings, header: &Header) -> Result<OutputSet, BakeError> {
    let names = [header.lit_scene.as_str(), REPORT_JSON, REPORT_HTML];
    let mut outputs = OutputSet::open(settings.out(), &names, settings.force)?;
    if settings.out() == settings.folder {
        outputs.keep(SOLUTION);
    }
    Ok(outputs)
}

/// Part of the header as what it was written from.
fn parsed<T: DeserializeOwned>(settings: &RelightSettings, value: &Value) -> Result<T, BakeError> {
    let corrupted = |_| crate::relight::SolutionError::Corrupted("HEAD".into());
    let parsed = serde_json::from_value(value.clone()).map_err(corrupted);
    parsed.map_err(|error| BakeError::from(error).at(&settings.folder.join(SOLUTION)))
}

/// A page of irradiance as the bake's quantity.
fn in_quantity(header: &Header, layout: &PageLayout, changes: &Changes, mut page: PageImage) -> PageImage {
    match header.quantity {
        Quantity::Irradiance => {}
        Quantity::Radiance => page.rgb.iter_mut().for_each(|c| *c *= header.quantity.factor()),
        Quantity::Radiosity => {
            let (mut reflectance, _) = layout.black();
            let changed =
                layout.reflectance.iter().zip(&layout.material).map(|(&r, &m)| r * changes.reflectance[m as usize]);
            for (&place, value) in layout.places.iter().zip(changed) {
                reflectance.rgb[place as usize] = value;
            }
            post::fill_around(&mut reflectance, header.rings);
            page.rgb.iter_mut().zip(&reflectance.rgb).for_each(|(c, r)| *c *= *r);
        }
    }
    page
}

/// Copies the lit scene of the bake with other pages.
fn lit_scene(
    settings: &RelightSettings,
    header: &Header,
    pages: &[PageImage],
    outputs: &mut OutputSet,
    warnings: &mut Vec<Warning>,
) -> Result<(), BakeError> {
    let missing = |reason: &str| {
        let message = format!("the lit scene {reason}: it is left out, bake the scene again to have it");
        Warning::new("lit_scene", header.lit_scene.as_str(), message)
    };
    let Some(baked) = read_result(&settings.folder.join(&header.lit_scene))? else {
        warnings.push(missing("is not beside the solution"));
        return Ok(());
    };
    let link = |k: usize| PageLink { uri: OutputSet::page_name(k), quantity: header.quantity };
    let links: Vec<PageLink> = (0..pages.len()).map(link).collect();
    match relit_glb(&baked, pages, &links)? {
        Some(glb) => outputs.write(&header.lit_scene, |sink| sink.write_all(&glb))?,
        None => warnings.push(missing("beside the solution does not show its pages")),
    }
    Ok(())
}

/// Says that reflectances were changed farther than the solution can tell.
fn beyond(expected: f64, target: f32) -> Warning {
    let message = format!(
        "the changes of reflectance bring an expected error of {:.1} %, more than the {:.1} % that the bake aimed for: \
         pass --refine to bake again",
        100.0 * expected,
        100.0 * f64::from(target)
    );
    Warning::new("relight_range", "reflectance", message)
}

/// Bakes the scene with the new reflectances, then relights that.
fn refine(
    settings: &RelightSettings,
    header: &Header,
    mut baked: Settings,
    changes: &Changes,
    progress: &dyn Progress,
) -> Result<Report, BakeError> {
    let scene = match &settings.scene {
        Some(scene) => scene.clone(),
        None => PathBuf::from(header.report["scene"]["file"].as_str().unwrap_or_default()),
    };
    let imported = import::load(&scene, &baked.import, &Quiet(progress))?;
    if scene_hash(&imported.document) != header.scene_hash {
        return Err(BakeError::OtherScene(scene));
    }
    drop(imported);
    for (material, &factor) in header.known.materials.iter().zip(&changes.reflectance) {
        if factor != Rgb::ONE {
            let known = baked.reflectance.entry(material.name.clone()).or_insert([1.0; 3]);
            *known = (Rgb::from_array(*known) * factor).to_array();
        }
    }
    baked.output.folder = settings.out().to_path_buf();
    baked.output.force = settings.force;
    (baked.resume, baked.progressive, baked.checkpoint) = (false, false, None);
    let report = bake(&scene, &baked, progress)?;
    // What is left now is exact.
    let left = settings.changes.iter().filter(|c| !c.key.ends_with(".reflectance")).cloned().collect::<Vec<_>>();
    if left.is_empty() {
        return Ok(report);
    }
    let again =
        RelightSettings { folder: baked.output.folder, changes: left, force: true, ..RelightSettings::default() };
    relight(&again, progress)
}
