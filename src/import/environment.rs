//! The environment of LIGHTKILN_scene: constant or gradient. An image is recognised but not lit yet.

use super::{EXTENSION, json};
use crate::document::Document;
use crate::scene::{Environment, Rgb};
use crate::warning::Warning;
use serde_json::Value;

/// What surrounds the scene; black where the file says nothing.
pub(super) fn load(document: &Document, warnings: &mut Vec<Warning>) -> Environment {
    let Some(source) = document.root_extension(EXTENSION).and_then(|e| e.get("environment")) else {
        return Environment::Black;
    };
    let environment = if let Some(gradient) = source.get("gradient") {
        Environment::Gradient {
            zenith: radiance(gradient, "zenith", warnings),
            horizon: radiance(gradient, "horizon", warnings),
            ground: radiance(gradient, "ground", warnings),
        }
    } else if let Some(image) = json::string(source, "image") {
        let message = format!("`{image}`: environment images are not lit; the sky is black, use a gradient");
        warnings.push(Warning::new("environment_image", "environment", message));
        Environment::Black
    } else if source.get("radiance").is_some() {
        Environment::Constant(radiance(source, "radiance", warnings))
    } else {
        let message = "it has neither `radiance` nor `gradient`; the sky is black, give one of them";
        warnings.push(Warning::new("environment", "environment", message));
        Environment::Black
    };
    let dark = match environment {
        Environment::Black => true,
        Environment::Constant(l) => l == Rgb::ZERO,
        Environment::Gradient { zenith, horizon, ground } => zenith.max(horizon).max(ground) == Rgb::ZERO,
    };
    if dark { Environment::Black } else { environment }
}

fn radiance(object: &Value, key: &str, warnings: &mut Vec<Warning>) -> Rgb {
    let value = json::triple(object, key).unwrap_or([f32::NAN; 3]);
    let sound = value.map(|c| if c.is_finite() { c.max(0.0) } else { 0.0 });
    if sound != value {
        let message = format!("`{key}` is missing, negative or not finite and taken as 0; give three radiances");
        warnings.push(Warning::new("environment", "environment", message));
    }
    Rgb::from_array(sound)
}
