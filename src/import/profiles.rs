//! Photometric profiles of lamps: a reference to an LM-63 file → the profile, read once however many lamps use it.

use super::{files, ies, json};
use crate::document::Document;
use crate::scene::Profile;
use crate::warning::Warning;
use serde_json::Value;
use std::collections::HashMap;
use std::sync::Arc;

/// The profiles that were read so far, by what refers to them; none where the file is at fault.
#[derive(Default)]
pub(super) struct Profiles {
    read: HashMap<String, Option<Arc<Profile>>>,
}

impl Profiles {
    /// The profile that `object` refers to, or none with a warning that says what becomes of the lamp `path` and, once
    /// per file, what is wrong.
    pub(super) fn get(
        &mut self,
        document: &Document,
        object: &Value,
        path: &str,
        without: &str,
        warnings: &mut Vec<Warning>,
    ) -> Option<Arc<Profile>> {
        let name = files::name(object);
        let key = if object.is_string() { object.to_string() } else { reference(object) };
        if !self.read.contains_key(&key) {
            let profile = files::bytes(document, object).and_then(|bytes| ies::parse(&bytes));
            if let Err(fault) = &profile {
                let message = format!(
                    "IES profile: {fault}; give an LM-63 file of type B or C, or export it again from the \
                     manufacturer's data"
                );
                warnings.push(Warning::new("ies_profile", name.as_str(), message));
            }
            self.read.insert(key.clone(), profile.ok().map(Arc::new));
        }
        let profile = self.read[&key].clone();
        if profile.is_none() {
            let message = format!("lamp: its IES profile `{name}` cannot be used; {without}, mend the file");
            warnings.push(Warning::new("light_without_profile", path, message));
        }
        profile
    }
}

/// What of an object decides which bytes are meant.
fn reference(object: &Value) -> String {
    match json::string(object, "uri") {
        Some(uri) => Value::from(uri).to_string(),
        None => format!("view {:?}", json::index(object, "bufferView")),
    }
}
