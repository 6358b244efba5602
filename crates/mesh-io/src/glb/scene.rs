//! Which meshes a scene shows, and where.

use super::document::{Document, entry};
use super::malformed;
use super::transform::Transform;
use crate::ReadError;

/// A mesh at a place.
pub(super) struct Instance {
    pub(super) mesh: usize,
    pub(super) world_from_local: Transform,
}

/// The meshes of the default scene, or of all nodes without a parent if the file
/// names none, in the order of the hierarchy. A file without nodes shows all meshes.
pub(super) fn instances(document: &Document) -> Result<Vec<Instance>, ReadError> {
    if document.nodes.0.is_empty() {
        let identity = |mesh| Instance {
            mesh,
            world_from_local: Transform::IDENTITY,
        };
        return Ok((0..document.meshes.0.len()).map(identity).collect());
    }
    let mut is_visited = vec![false; document.nodes.0.len()];
    let mut instances = Vec::new();
    // A stack in reverse, so that the first node comes off first.
    let mut stack: Vec<(usize, Transform)> = roots(document)?
        .into_iter()
        .rev()
        .map(|node| (node, Transform::IDENTITY))
        .collect();
    while let Some((index, parent)) = stack.pop() {
        let node = entry(&document.nodes, index, "node")?;
        if std::mem::replace(&mut is_visited[index], true) {
            return Err(malformed(format!(
                "node {index} has two parents or is its own ancestor"
            )));
        }
        let world_from_local = parent.then_local(&Transform::of(node));
        if let Some(mesh) = node.mesh {
            instances.push(Instance {
                mesh,
                world_from_local,
            });
        }
        stack.extend(
            node.children
                .0
                .iter()
                .rev()
                .map(|&child| (child, world_from_local)),
        );
    }
    Ok(instances)
}

fn roots(document: &Document) -> Result<Vec<usize>, ReadError> {
    if let Some(scene) = document.scene {
        return Ok(entry(&document.scenes, scene, "scene")?.nodes.0.clone());
    }
    let count = document.nodes.0.len();
    let mut has_parent = vec![false; count];
    for &child in document.nodes.0.iter().flat_map(|node| &node.children.0) {
        if let Some(slot) = has_parent.get_mut(child) {
            *slot = true;
        }
    }
    let roots: Vec<usize> = (0..count).filter(|&node| !has_parent[node]).collect();
    if roots.is_empty() {
        return Err(malformed(
            "every node has a parent, so the hierarchy has a cycle",
        ));
    }
    Ok(roots)
}
