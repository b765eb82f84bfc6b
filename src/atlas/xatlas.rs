//! Charts by xatlas, a C++ library: shapes → for every triangle a chart and its corners in the plane.
//!
//! xatlas runs on a thread of its own, because it looks for cancellation only between charts: a cancelled bake leaves
//! that thread behind, and it ends at its next report. The thread also outlives its result, because xatlas may wait for
//! ever when it ends its own threads: it wakes them without their lock, and one that is about to sleep misses that.

use super::build::AtlasError;
use super::shape::Shape;
use super::unwrap::{NO_CHART, Unwrapped};
use crate::progress::{Cancelled, Progress, Stage};
use crate::scene::{Mesh, Scene};
use glam::Vec2;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Once, mpsc};
use std::time::Duration;
use xatlas_rs_v2::{ChartOptions, IndexData, MeshData, MeshDecl, PackOptions, ProgressCategory, Xatlas};

/// Mean triangle area of what xatlas sees. It takes smaller areas than 1.2e-7 for nothing.
const TRIANGLE_AREA: f64 = 100.0;
/// Texels per unit in xatlas's own packing, which is thrown away: about four texels per triangle, to make it quick.
const TEXELS_PER_UNIT: f32 = 0.2;
/// How often progress is passed on and cancellation looked for.
const POLL: Duration = Duration::from_millis(50);

/// Unwraps every shape.
pub(super) fn unwrap(scene: &Scene, shapes: &[Shape], progress: &dyn Progress) -> Result<Vec<Unwrapped>, AtlasError> {
    let inputs: Vec<Input> = shapes.iter().map(|s| Input::new(&scene.meshes[s.mesh], s)).collect();
    if inputs.is_empty() {
        return Ok(Vec::new());
    }
    let signals = Arc::new(Signals::default());
    let (sender, receiver) = mpsc::channel();
    let theirs = Arc::clone(&signals);
    std::thread::Builder::new()
        .name("xatlas".into())
        .spawn(move || {
            silence();
            let declarations: Vec<_> = inputs.iter().map(Input::declared).collect();
            let mut atlas = Xatlas::new();
            // Nobody listens any more after a cancellation.
            let _ = sender.send(run(&mut atlas, &inputs, &declarations, &theirs));
        })
        .map_err(|e| AtlasError::Unwrapper { tool: "xatlas", reason: e.to_string() })?;
    loop {
        if progress.is_cancelled() {
            signals.cancelled.store(true, Ordering::Relaxed);
            return Err(Cancelled.into());
        }
        progress.report(Stage::Atlas, f64::from(signals.percent.load(Ordering::Relaxed)) / 100.0);
        match receiver.recv_timeout(POLL) {
            Ok(result) => return result.map_err(|reason| AtlasError::Unwrapper { tool: "xatlas", reason }),
            Err(mpsc::RecvTimeoutError::Timeout) => {}
            Err(mpsc::RecvTimeoutError::Disconnected) => {
                return Err(AtlasError::Unwrapper { tool: "xatlas", reason: "it stopped unexpectedly".into() });
            }
        }
    }
}

/// What passes between the bake and xatlas's thread.
#[derive(Default)]
struct Signals {
    cancelled: AtomicBool,
    percent: AtomicU32,
}

impl Signals {
    /// Notes how far xatlas is; false if it should stop.
    fn note(&self, category: &ProgressCategory, percent: i32) -> bool {
        // Charts take nearly all the time.
        let (start, share) = match category {
            ProgressCategory::AddMesh => (0.0, 0.05),
            ProgressCategory::ComputeCharts => (5.0, 0.8),
            ProgressCategory::PackCharts => (85.0, 0.05),
            ProgressCategory::BuildOutputMeshes => (90.0, 0.0),
        };
        self.percent.fetch_max((start + share * f64::from(percent)) as u32, Ordering::Relaxed);
        !self.cancelled.load(Ordering::Relaxed)
    }
}

/// One mesh as xatlas takes it.
struct Input {
    positions: Vec<f32>,
    normals: Vec<f32>,
    indices: Vec<u32>,
    /// The mesh's triangle behind each face.
    faces: Vec<u32>,
    /// Triangles of the mesh.
    triangles: usize,
}

impl Input {
    fn new(mesh: &Mesh, shape: &Shape) -> Self {
        let mean = shape.area(mesh) / shape.triangles.len().max(1) as f64;
        let scale = if mean > 0.0 { (TRIANGLE_AREA / mean).sqrt() as f32 } else { 1.0 };
        Self {
            positions: shape.positions.iter().flat_map(|p| (*p * scale).to_array()).collect(),
            normals: shape.normals.iter().flat_map(|n| n.to_array()).collect(),
            indices: shape.triangles.iter().flat_map(|&t| mesh.triangles[t as usize]).collect(),
            faces: shape.triangles.clone(),
            triangles: mesh.triangles.len(),
        }
    }

    /// What xatlas is told of it; nothing if it has no faces.
    fn declared(&self) -> Option<MeshDecl<'_>> {
        (!self.faces.is_empty()).then(|| MeshDecl {
            vertex_position_data: MeshData::Contiguous(&self.positions),
            vertex_normal_data: Some(MeshData::Contiguous(&self.normals)),
            index_data: Some(IndexData::U32(&self.indices)),
            face_count: self.faces.len() as u32,
            ..MeshDecl::default()
        })
    }
}

/// Runs xatlas over all inputs at once: an atlas owns threads, and starting them per mesh would cost more than small
/// meshes do.
fn run<'a>(
    atlas: &mut Xatlas<'a>,
    inputs: &[Input],
    declarations: &'a [Option<MeshDecl<'a>>],
    signals: &Arc<Signals>,
) -> Result<Vec<Unwrapped>, String> {
    let theirs = Arc::clone(signals);
    atlas.set_progress_callback(move |category, percent| theirs.note(&category, percent));
    let count = declarations.iter().flatten().count() as u32;
    for declaration in declarations.iter().flatten() {
        atlas.add_mesh_with_mesh_count_hint(declaration, count).map_err(|e| format!("{e:?}"))?;
    }
    atlas.compute_charts(&ChartOptions::default());
    let packing = PackOptions {
        texels_per_unit: TEXELS_PER_UNIT,
        bilinear: false,
        rotate_charts: false,
        ..PackOptions::default()
    };
    if count > 0 && !signals.cancelled.load(Ordering::Relaxed) {
        atlas.pack_charts(&packing);
    }
    // Also when it was cancelled: there are no meshes to read then.
    if atlas.mesh_count() != count {
        return Err("it was cancelled or gave no meshes".into());
    }
    let meshes = if count > 0 { atlas.meshes() } else { Vec::new() };
    let mut meshes = meshes.iter();
    Ok(inputs
        .iter()
        .zip(declarations)
        .map(|(input, declared)| match declared {
            Some(_) => meshes.next().map_or_else(|| Unwrapped::none(input.triangles), |m| read(input, m)),
            None => Unwrapped::none(input.triangles),
        })
        .collect())
}

/// Charts and corners of one mesh.
fn read(input: &Input, mesh: &xatlas_rs_v2::Mesh) -> Unwrapped {
    let mut unwrapped = Unwrapped::none(input.triangles);
    for (corners, &triangle) in mesh.index_array.chunks_exact(3).zip(&input.faces) {
        let vertices = [corners[0], corners[1], corners[2]].map(|v| &mesh.vertex_array[v as usize]);
        // Negative for what xatlas left out.
        let chart = u32::try_from(vertices[0].chart_index).unwrap_or(NO_CHART);
        unwrapped.set(triangle, chart, vertices.map(|v| Vec2::from(v.uv)));
    }
    unwrapped
}

/// Keeps xatlas from printing warnings to standard output, which belongs to the bake.
fn silence() {
    static SILENCED: Once = Once::new();
    SILENCED.call_once(|| {
        // SAFETY: sets two plain globals of the library; `Once` sees to it that nobody else writes them, and no atlas
        // exists before the first call.
        unsafe { xatlas_rs_v2::root::xatlas::SetPrint(None, false) }
    });
}
