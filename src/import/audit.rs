//! What a file asks for that a lightmap does not show: one warning per extension, naming what it is on and what is done
//! instead. Nothing that changes light is dropped in silence.

use super::extensions::{self, Fate};
use crate::document::Document;
use crate::warning::Warning;
use serde_json::Value;
use std::collections::BTreeMap;

/// Warns about every extension in use that is not lit, and about lamp ranges and animations.
pub(super) fn check(document: &Document, warnings: &mut Vec<Warning>) {
    let mut found = BTreeMap::new();
    if let Value::Object(root) = &document.json {
        for (array, entries) in root {
            collect(entries, array, &mut found);
        }
        root.get("extensions").into_iter().for_each(|e| note(e, "the file", &mut found));
    }
    for (name, (count, place)) in found {
        let instead = match extensions::fate(name) {
            Fate::Kept => continue,
            Fate::LeftOut(instead) => instead,
            Fate::Unknown => "it is not known and left out; if it changes light, export without it",
        };
        let others = if count > 1 { format!(" and in {} other places", count - 1) } else { String::new() };
        warnings.push(Warning::new("extension", place, format!("it has the extension {name}{others}: {instead}")));
    }
    check_ranges(document, warnings);
    if let Some(first) = document.array("animations").first() {
        let name = first.get("name").and_then(Value::as_str).unwrap_or("animation");
        let message = "animation: everything is baked where it stands without it; export the pose that is wanted";
        warnings.push(Warning::new("animation", name, message));
    }
}

/// Extension → how often, and where first.
type Found<'a> = BTreeMap<&'a str, (usize, String)>;

/// Extensions of the entries of a top-level array and of what they hold.
fn collect<'a>(entries: &'a Value, array: &str, found: &mut Found<'a>) {
    let Some(entries) = entries.as_array() else { return };
    for (i, entry) in entries.iter().enumerate() {
        let name = entry.get("name").and_then(Value::as_str).filter(|name| !name.is_empty());
        let place = name.map_or_else(|| format!("{array}[{i}]"), str::to_owned);
        descend(entry, &place, found);
    }
}

fn descend<'a>(value: &'a Value, place: &str, found: &mut Found<'a>) {
    match value {
        Value::Object(fields) => {
            for (key, value) in fields {
                match key.as_str() {
                    "extensions" => note(value, place, found),
                    "extras" => {}
                    _ => descend(value, place, found),
                }
            }
        }
        Value::Array(items) => items.iter().for_each(|item| descend(item, place, found)),
        _ => {}
    }
}

fn note<'a>(extensions: &'a Value, place: &str, found: &mut Found<'a>) {
    for (name, value) in extensions.as_object().into_iter().flatten() {
        found.entry(name).or_insert_with(|| (0, place.to_owned())).0 += 1;
        // Textures of extensions have extensions of their own.
        descend(value, place, found);
    }
}

/// `range` of a punctual light cuts it off where light still arrives.
fn check_ranges(document: &Document, warnings: &mut Vec<Warning>) {
    let lights = document.root_extension("KHR_lights_punctual").and_then(|e| e.get("lights"));
    let mut ranged = lights.and_then(Value::as_array).into_iter().flatten().filter(|l| l.get("range").is_some());
    if let Some(first) = ranged.next() {
        let name = first.get("name").and_then(Value::as_str).unwrap_or("light");
        let message = format!(
            "lamp: its range, and that of {} others, is a hint for games and left out: light falls off with the square \
             of the distance; remove the range to be rid of this warning",
            ranged.count()
        );
        warnings.push(Warning::new("light_range", name, message));
    }
}
