//! The node graph: the nodes of one glTF scene → a flat list with world transforms, unique paths and inherited
//! LIGHTKILN_scene settings, parents before children.

use super::source::Source;
use super::{EXTENSION, json};
use crate::document::Document;
use crate::scene::LightmapRequest;
use crate::warning::Warning;
use glam::{DAffine3, DMat4, DQuat, DVec3};
use gltf::scene::Transform;
use std::collections::HashMap;

/// A node with everything that its ancestors contribute.
pub(super) struct PlacedNode {
    /// Index of the node.
    pub(super) node: usize,
    /// Names from the root, unique in the file.
    pub(super) path: String,
    /// Node space to world space; finite.
    pub(super) world: DAffine3,
    /// What LIGHTKILN_scene says about the node or its nearest ancestor.
    pub(super) settings: NodeSettings,
}

/// Settings that a node hands down to its children.
#[derive(Clone, Default)]
pub(super) struct NodeSettings {
    pub(super) group: Option<String>,
    /// None: it does as by default.
    pub(super) casts_shadows: Option<bool>,
    pub(super) lightmap: LightmapRequest,
}

/// Nodes under `roots`. Nodes with non-finite transforms are left out with all below them, with a warning.
pub(super) fn walk(source: &Source, roots: &[usize], warnings: &mut Vec<Warning>) -> Vec<PlacedNode> {
    let nodes: Vec<_> = source.gltf.nodes().collect();
    let mut paths = UniquePaths::default();
    let mut visit = vec![Visit::Unseen; nodes.len()];
    let mut placed: Vec<PlacedNode> = Vec::new();

    // Depth first with a stack of our own: chains of nodes may be longer than the thread's stack is deep.
    let mut stack: Vec<Step> = roots.iter().rev().map(|&node| Step::Enter { node, parent: None }).collect();
    while let Some(step) = stack.pop() {
        let (node, parent) = match step {
            Step::Enter { node, parent } => (node, parent),
            Step::Leave { node } => {
                visit[node] = Visit::Done;
                continue;
            }
        };
        let name = match nodes[node].name() {
            Some(name) if !name.is_empty() => name.to_owned(),
            _ => format!("node{node}"),
        };
        let parent = parent.map(|p: usize| &placed[p]);
        match visit[node] {
            Visit::Unseen => {}
            Visit::Open => {
                let message =
                    "the node is its own ancestor; the way back to it is skipped: remove it from the children";
                warnings.push(Warning::new("cyclic_node", name, message));
                continue;
            }
            Visit::Done => {
                let message = "the node has two parents, which glTF forbids; its second place is skipped: duplicate it";
                warnings.push(Warning::new("shared_node", name, message));
                continue;
            }
        }
        if is_hidden(&source.document, node) {
            let message = "it is invisible (KHR_node_visibility) and skipped with its children: show it to bake it";
            warnings.push(Warning::new("invisible", name, message));
            visit[node] = Visit::Done;
            continue;
        }
        let path = paths.claim(parent.map(|p| p.path.as_str()), &name);
        let world = parent.map_or(DAffine3::IDENTITY, |p| p.world) * local_transform(&nodes[node]);
        if !(world.is_finite() && world.as_affine3a().is_finite()) {
            let message = "its transform is not finite; it and its children are skipped: reset the transform";
            warnings.push(Warning::new("transform", path, message));
            visit[node] = Visit::Done;
            continue;
        }
        let inherited = parent.map(|p| p.settings.clone()).unwrap_or_default();
        let settings = read_settings(&source.document, node, &path, inherited, warnings);

        visit[node] = Visit::Open;
        placed.push(PlacedNode { node, path, world, settings });
        stack.push(Step::Leave { node });
        let parent = Some(placed.len() - 1);
        let children: Vec<_> = nodes[node].children().map(|child| child.index()).collect();
        stack.extend(children.into_iter().rev().map(|node| Step::Enter { node, parent }));
    }
    placed
}

fn is_hidden(document: &Document, node: usize) -> bool {
    let visibility = document.extension("nodes", node, "KHR_node_visibility");
    visibility.and_then(|v| json::boolean(v, "visible")) == Some(false)
}

/// Where the walk stands with a node.
#[derive(Clone, Copy)]
enum Visit {
    Unseen,
    /// Its descendants are being walked.
    Open,
    Done,
}

/// What the walk does next; `parent` is an index into the placed nodes.
enum Step {
    Enter { node: usize, parent: Option<usize> },
    Leave { node: usize },
}

fn local_transform(node: &gltf::Node) -> DAffine3 {
    match node.transform() {
        Transform::Matrix { matrix } => {
            DAffine3::from_mat4(DMat4::from_cols_array_2d(&matrix.map(|column| column.map(f64::from))))
        }
        Transform::Decomposed { translation, rotation, scale } => {
            let rotation = DQuat::from_array(rotation.map(f64::from));
            // A quaternion of zeros is an exporter's way of saying nothing.
            let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
            DAffine3::from_scale_rotation_translation(
                DVec3::from_array(scale.map(f64::from)),
                rotation,
                DVec3::from_array(translation.map(f64::from)),
            )
        }
    }
}

fn read_settings(
    document: &Document,
    node: usize,
    path: &str,
    inherited: NodeSettings,
    warnings: &mut Vec<Warning>,
) -> NodeSettings {
    let mut settings = inherited;
    let Some(extension) = document.extension("nodes", node, EXTENSION) else { return settings };
    if let Some(group) = json::string(extension, "group") {
        settings.group = Some(group.to_owned());
    }
    if let Some(casts) = json::boolean(extension, "castsShadows") {
        settings.casts_shadows = Some(casts);
    }
    if let Some(lightmap) = extension.get("lightmap") {
        let density = json::number(lightmap, "texelsPerMetre").filter(|d| *d > 0.0);
        let resolution = json::number(lightmap, "resolution").filter(|r| *r >= 1.0);
        settings.lightmap = match (lightmap.as_bool(), density, resolution) {
            (Some(false), ..) => LightmapRequest::None,
            (Some(true), ..) => LightmapRequest::Default,
            (_, Some(density), _) => LightmapRequest::TexelsPerMetre(density),
            (_, _, Some(resolution)) => LightmapRequest::Resolution(resolution as u32),
            _ => {
                let message = format!(
                    "its lightmap setting `{lightmap}` is ignored: give {{\"texelsPerMetre\": x}}, \
                     {{\"resolution\": n}} or false"
                );
                warnings.push(Warning::new("lightmap_setting", path, message));
                settings.lightmap
            }
        };
    }
    settings
}

/// Hands out node paths and tells duplicates apart.
#[derive(Default)]
struct UniquePaths {
    /// Times that each path was asked for or handed out.
    taken: HashMap<String, usize>,
}

impl UniquePaths {
    /// `parent/name`, with `#2` and so on if that is taken.
    fn claim(&mut self, parent: Option<&str>, name: &str) -> String {
        let wanted = parent.map_or_else(|| name.to_owned(), |parent| format!("{parent}/{name}"));
        let mut path = wanted.clone();
        while self.taken.contains_key(&path) {
            // Counting from the last duplicate keeps thousands of equal names linear.
            let count = self.taken.entry(wanted.clone()).or_insert(1);
            *count += 1;
            path = format!("{wanted}#{count}");
        }
        self.taken.insert(path.clone(), 1);
        path
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn duplicate_paths_are_numbered_from_two() {
        let mut paths = UniquePaths::default();
        assert_eq!(paths.claim(None, "A"), "A");
        assert_eq!(paths.claim(None, "A"), "A#2");
        assert_eq!(paths.claim(None, "A#2"), "A#2#2");
        assert_eq!(paths.claim(None, "A"), "A#3");
        assert_eq!(paths.claim(Some("A"), "B"), "A/B");
        assert_eq!(paths.claim(Some("A#2"), "B"), "A#2/B");
    }
}
