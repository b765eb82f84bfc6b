//! Which glTF scene is baked, and its root nodes.

use super::ImportError;
use crate::warning::Warning;
use std::collections::BTreeSet;

/// Root nodes of the scene that is baked.
pub(super) fn choose(
    gltf: &gltf::Document,
    asked: Option<&str>,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<usize>, ImportError> {
    let scenes: Vec<_> = gltf.scenes().collect();
    let label = |scene: &gltf::Scene| scene.name().map_or_else(|| scene.index().to_string(), str::to_owned);
    let all = || scenes.iter().map(|s| format!("`{}`", label(s))).collect::<Vec<_>>().join(", ");
    let chosen = match asked {
        Some(asked) => {
            let named = scenes.iter().find(|s| s.name() == Some(asked));
            let numbered = || asked.parse::<usize>().ok().and_then(|i| scenes.get(i));
            Some(named.or_else(numbered).ok_or_else(|| ImportError::NoSuchScene {
                asked: asked.to_owned(),
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
    if scenes.len() > 1 && asked.is_none() {
        let message = format!("the file has the scenes {}; only this one is baked, choose with --scene", all());
        warnings.push(Warning::new("several_scenes", label(chosen), message));
    }
    Ok(chosen.nodes().map(|node| node.index()).collect())
}
