//! `lightkiln info`: what a scene holds, as the baker sees it, or what a folder holds of a solution.

use super::args::InfoArguments;
use super::console::{Console, print_line};
use super::failure::Failure;
use super::tiles;
use super::watch::Watch;
use lightkiln::import::{self, Imported};
use lightkiln::scene::{Environment, Light, LightShape, Rgb, Scene};
use lightkiln::warning::Warning;
use serde::Serialize;
use serde_json::json;
use std::fmt::Write;
use std::sync::atomic::AtomicBool;

/// Reads the scene and prints what it holds, as text or as one `info` line of JSON.
pub(crate) fn run(options: &InfoArguments, console: Console, cancelled: &'static AtomicBool) -> Result<(), Failure> {
    if options.scene.is_dir() {
        return tiles::show(&options.scene, console);
    }
    let watch = Watch::new(console, cancelled);
    let Imported { scene, warnings, .. } = import::load(&options.scene, &options.source.settings(), &watch)?;
    drop(watch);
    let facts = Facts::of(&scene, &warnings);
    if console.is_json() {
        let mut event = json!({ "event": "info" });
        let facts = serde_json::to_value(&facts).expect("numbers and strings are valid JSON");
        if let (Some(event), serde_json::Value::Object(facts)) = (event.as_object_mut(), facts) {
            event.extend(facts);
        }
        console.event(&event);
    } else {
        print_line(facts.text().trim_end());
    }
    Ok(())
}

/// What a scene holds.
#[derive(Serialize)]
struct Facts<'a> {
    name: &'a str,
    meshes: usize,
    instances: usize,
    triangles: usize,
    materials: usize,
    textures: Vec<TextureFacts<'a>>,
    lights: Vec<LightFacts<'a>>,
    environment: &'static str,
    /// World-space bounds of the geometry, metres.
    bounds: [[f32; 3]; 2],
    warnings: &'a [Warning],
}

#[derive(Serialize)]
struct TextureFacts<'a> {
    name: &'a str,
    width: u32,
    height: u32,
}

#[derive(Serialize)]
struct LightFacts<'a> {
    path: &'a str,
    #[serde(rename = "type")]
    kind: &'static str,
    /// `radiance`, `intensity` or `irradiance`.
    quantity: &'static str,
    unit: &'static str,
    value: [f32; 3],
}

impl<'a> Facts<'a> {
    fn of(scene: &'a Scene, warnings: &'a [Warning]) -> Self {
        let texture =
            |t: &'a lightkiln::scene::Texture| TextureFacts { name: &t.name, width: t.width, height: t.height };
        Self {
            name: &scene.name,
            meshes: scene.meshes.len(),
            instances: scene.instances.len(),
            triangles: scene.triangle_count(),
            materials: scene.materials.len(),
            textures: scene.textures.iter().map(texture).collect(),
            lights: scene.lights.iter().map(LightFacts::of).collect(),
            environment: match scene.environment {
                Environment::Black => "none",
                Environment::Constant(_) => "constant",
                Environment::Gradient { .. } => "gradient",
                Environment::Image(_) => "image",
            },
            bounds: bounds(scene),
            warnings,
        }
    }

    /// For people.
    fn text(&self) -> String {
        let [low, high] = self.bounds;
        let size: Vec<String> = low.iter().zip(high).map(|(l, h)| format!("{:.2}", h - l)).collect();
        let mut out = format!("{}: {} m\n", self.name, size.join(" × "));
        let mut line = |name: &str, text: String| {
            let _ = writeln!(out, "  {name:<12} {text}");
        };
        line("meshes", self.meshes.to_string());
        line("instances", self.instances.to_string());
        line("triangles", self.triangles.to_string());
        line("materials", self.materials.to_string());
        line("textures", self.textures.len().to_string());
        for t in &self.textures {
            line("", format!("{}, {}×{}", t.name, t.width, t.height));
        }
        line("environment", self.environment.into());
        line("lights", self.lights.len().to_string());
        for l in &self.lights {
            let [r, g, b] = l.value;
            line("", format!("{}: {}, {} {r:.4} {g:.4} {b:.4} {}", l.path, l.kind, l.quantity, l.unit));
        }
        for w in self.warnings {
            line("warning", w.to_string());
        }
        out
    }
}

impl<'a> LightFacts<'a> {
    fn of(light: &'a Light) -> Self {
        const RADIANCE: (&str, &str) = ("radiance", "W/(m^2*sr)");
        const INTENSITY: (&str, &str) = ("intensity", "W/sr");
        let (kind, (quantity, unit), value): (_, _, Rgb) = match light.shape {
            LightShape::Rect { radiance, .. } => ("rect", RADIANCE, radiance),
            LightShape::Disk { radiance, .. } => ("disk", RADIANCE, radiance),
            LightShape::Point { intensity, .. } => ("point", INTENSITY, intensity),
            LightShape::Spot { intensity, .. } => ("spot", INTENSITY, intensity),
            LightShape::Sun { irradiance, .. } => ("sun", ("irradiance", "W/m^2"), irradiance),
        };
        Self { path: &light.path, kind, quantity, unit, value: value.to_array() }
    }
}

/// Smallest box around all instances; empty scenes have a box of size zero.
fn bounds(scene: &Scene) -> [[f32; 3]; 2] {
    let corners = scene
        .instances
        .iter()
        .flat_map(|i| scene.meshes[i.mesh].positions.iter().map(|&p| i.transform.transform_point3(p)));
    let (low, high) = corners.fold((Rgb::INFINITY, Rgb::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    if low.is_finite() { [low.to_array(), high.to_array()] } else { [[0.0; 3]; 2] }
}
