//! glTF 2.0, `.gltf` and `.glb`: characters with skeletons, skins, blend shapes and clips are read,
//! hair is written.
//!
//! # Practice
//! All nodes of the file become joints of one skeleton. All triangle meshes of the file's scene
//! become one mesh: those with a skin follow its joints, the others their nodes. Vertices that
//! differ only in what hair does not need, such as texture coordinates, are joined, so that the
//! surface is connected. The nodes' own transforms are the rest pose.
//!
//! # Limitations
//! Materials, textures, cameras and lights are discarded; so are points and lines, with a note.
//! Hair is not read back.
//! Files whose meshes are compressed by an extension are refused.

mod accessor;
mod cache;
mod clips;
mod write;

use std::collections::HashMap;
use std::path::Path;

use ::gltf::json::Root;
use ::gltf::json::validation::Checked;
use ::gltf::mesh::{Mode, Semantic};
use ::gltf::{Document, Gltf, Node};
use forelock_core::body::TriMesh;
use forelock_core::body::character::{
    BlendShape, Bone, Character, CharacterParts, Group, Joint, Skeleton, Skin, Transform,
};
use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};

use accessor::Buffers;

pub use cache::LinesWriter;
pub use write::{write_binary, write_text};

/// The bone weights of a vertex, `(bone, weight)`.
type Weights = Vec<(usize, f32)>;

/// The nodes of a file as joints.
struct Nodes {
    joints: Vec<Joint>,
    /// The joint of each node.
    joint_of: Vec<usize>,
    /// The first blend shape of each node's mesh, and their number.
    shapes_of: Vec<(usize, usize)>,
}

/// Reads a character, and what was changed or left out, one sentence each. `folder` is that of the
/// file, for buffers in files of their own.
///
/// # Errors
/// What is wrong, and where in the file.
pub fn read(bytes: &[u8], folder: &Path) -> Result<(Character, Vec<String>), String> {
    // The parser subtracts the size of the header without a look.
    if let [b'g', b'l', b'T', b'F', _, _, _, _, a, b, c, d, ..] = *bytes
        && u32::from_le_bytes([a, b, c, d]) < 12
    {
        return Err("byte 8: its size is less than its header; copy or export it again".into());
    }
    let Gltf { document, blob } =
        Gltf::from_slice_without_validation(bytes).map_err(|error| explain(&error))?;
    let json = document.into_json();
    check(&json)?;
    let document = &Document::from_json(json).map_err(|error| explain(&error))?;
    let buffers = Buffers::load(document, blob, folder)?;
    let mut nodes = nodes(document)?;
    let mut notes = Vec::new();
    let mut meshes = Meshes::default();
    for node in scene_nodes(document) {
        meshes.add(&node, &mut nodes, &buffers)?;
    }
    if meshes.skipped > 0 {
        notes.push(format!("{} primitives of points or lines are left out", meshes.skipped));
    }
    if meshes.dropped > 0 {
        notes.push(format!("{} triangles with a repeated corner are left out", meshes.dropped));
    }
    if meshes.unbound > 0 {
        let count = meshes.unbound;
        notes.push(format!(
            "{count} vertices have no valid weight: they follow the first joint of their skin"
        ));
    }
    if meshes.triangles.is_empty() && meshes.skipped > 0 {
        return Err("it has points or lines only, no triangles; hair in glTF is written, not read".into());
    }
    let clips = clips::read(document, &nodes, &buffers, &mut notes)?;
    let bound = TriMesh::new(meshes.positions, meshes.triangles).map_err(|error| error.to_string())?;
    let (skin, report) = Skin::new(meshes.bones, meshes.weights);
    notes.extend(report.sentences());
    let skeleton = Skeleton::new(nodes.joints).map_err(|error| error.to_string())?;
    let parts = CharacterParts { skeleton, bound, skin, shapes: meshes.shapes, groups: meshes.groups, clips };
    let character = Character::new(parts).map_err(|error| error.to_string())?;
    Ok((character, notes))
}

/// Checks what the parser does not, or takes for granted.
fn check(json: &Root) -> Result<(), String> {
    let version = &json.asset.version;
    if !version.starts_with("2.") {
        return Err(format!("its version is {version}; export it as glTF 2.0"));
    }
    for (i, mesh) in json.meshes.iter().enumerate() {
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let accessors = primitive.attributes.values().map(|accessor| accessor.value());
            if let Some(accessor) = accessors.into_iter().find(|&own| own >= json.accessors.len()) {
                return Err(format!("mesh {i}, primitive {k}: there is no accessor {accessor}"));
            }
        }
    }
    for (i, animation) in json.animations.iter().enumerate() {
        let nodes = animation.channels.iter().map(|channel| channel.target.node.value());
        if let Some((channel, node)) = nodes.enumerate().find(|own| own.1 >= json.nodes.len()) {
            return Err(format!("animation {i}, channel {channel}: there is no node {node}"));
        }
        let mut paths = animation.channels.iter().map(|channel| &channel.target.path);
        if let Some(channel) = paths.position(|path| matches!(path, Checked::Invalid)) {
            let known = "translation, rotation, scale or weights";
            return Err(format!("animation {i}, channel {channel}: its path is not {known}"));
        }
    }
    Ok(())
}

/// The message of an error of the parser, without line breaks.
fn explain(error: &::gltf::Error) -> String {
    let text = match error {
        ::gltf::Error::Validation(found) => {
            let first = found.first().map(|(path, error)| format!("{}: {error}", path.as_str()));
            let more = found.len().saturating_sub(1);
            let more = if more > 0 { format!(" (and {more} more faults)") } else { String::new() };
            format!("{}{more}", first.unwrap_or_default())
        }
        ::gltf::Error::Binary(own) => format!("{own}; copy or export it again if it is cut short"),
        other => other.to_string(),
    };
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The nodes as joints, parents before children.
fn nodes(document: &Document) -> Result<Nodes, String> {
    let count = document.nodes().len();
    let mut parents = vec![None; count];
    for node in document.nodes() {
        for child in node.children() {
            if let Some(other) = parents[child.index()].replace(node.index()) {
                let (child, node) = (child.index(), node.index());
                return Err(format!("node {child} is a child of nodes {other} and {node}"));
            }
        }
    }
    let all: Vec<Node<'_>> = document.nodes().collect();
    let mut stack: Vec<usize> = (0..count).rev().filter(|&node| parents[node].is_none()).collect();
    let mut joint_of = vec![usize::MAX; count];
    let mut joints: Vec<Joint> = Vec::with_capacity(count);
    while let Some(index) = stack.pop() {
        let node = &all[index];
        joint_of[index] = joints.len();
        joints.push(Joint {
            name: node.name().map_or_else(|| format!("node {index}"), str::to_owned),
            parent: parents[index].map(|parent: usize| joint_of[parent]),
            rest: transform(node),
        });
        let children: Vec<usize> = node.children().map(|child| child.index()).collect();
        stack.extend(children.into_iter().rev());
    }
    if let Some(node) = joint_of.iter().position(|&joint| joint == usize::MAX) {
        return Err(format!("node {node} is its own ancestor"));
    }
    Ok(Nodes { joints, joint_of, shapes_of: vec![(0, 0); count] })
}

fn transform(node: &Node<'_>) -> Transform {
    match node.transform() {
        ::gltf::scene::Transform::Matrix { matrix } => {
            let columns = matrix.map(|column| column.map(f64::from));
            Transform::of(&DAffine3::from_mat4(DMat4::from_cols_array_2d(&columns)))
        }
        ::gltf::scene::Transform::Decomposed { translation, rotation, scale } => {
            let rotation = DQuat::from_array(rotation.map(f64::from));
            let length = rotation.length();
            Transform {
                translation: DVec3::from_array(translation.map(f64::from)),
                rotation: if length > 1e-6 { rotation / length } else { DQuat::IDENTITY },
                scale: DVec3::from_array(scale.map(f64::from)),
            }
        }
    }
}

/// The nodes of the file's scene: the default one, or the first, or all. Each comes once, however
/// often the scene names it.
fn scene_nodes(document: &Document) -> Vec<Node<'_>> {
    let Some(scene) = document.default_scene().or_else(|| document.scenes().next()) else {
        return document.nodes().collect();
    };
    let mut found = Vec::new();
    let mut stack: Vec<Node<'_>> = scene.nodes().collect();
    stack.reverse();
    let mut is_found = vec![false; document.nodes().len()];
    // The nodes are a tree: see `nodes`.
    while let Some(node) = stack.pop() {
        if std::mem::replace(&mut is_found[node.index()], true) {
            continue;
        }
        let children: Vec<Node<'_>> = node.children().collect();
        stack.extend(children.into_iter().rev());
        found.push(node);
    }
    found
}

/// All meshes as one.
#[derive(Default)]
struct Meshes {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    weights: Vec<Weights>,
    bones: Vec<Bone>,
    shapes: Vec<BlendShape>,
    groups: Vec<Group>,
    skipped: usize,
    dropped: usize,
    /// Vertices without valid weights.
    unbound: usize,
}

/// The attributes of a primitive.
struct Attributes {
    positions: Vec<Vec3>,
    /// Weights of bones, by their numbers in the skin.
    weights: Option<Vec<Weights>>,
    /// Displacements of each vertex, one list a blend shape.
    deltas: Vec<Vec<Vec3>>,
    indices: Vec<u32>,
}

impl Meshes {
    /// Adds the mesh of `node`, if it has one.
    fn add(&mut self, node: &Node<'_>, nodes: &mut Nodes, buffers: &Buffers) -> Result<(), String> {
        let Some(mesh) = node.mesh() else { return Ok(()) };
        let name = format!("mesh {}", mesh.index());
        let first_bone = self.bones.len();
        if let Some(skin) = node.skin() {
            let joints: Vec<usize> = skin.joints().map(|joint| nodes.joint_of[joint.index()]).collect();
            let matrices = match skin.inverse_bind_matrices() {
                Some(accessor) => buffers.floats(&accessor, 16)?,
                None => DMat4::IDENTITY.as_mat4().to_cols_array().repeat(joints.len()),
            };
            if matrices.len() < 16 * joints.len() || matrices.iter().any(|x| !x.is_finite()) {
                let (skin, found) = (skin.index(), matrices.len() / 16);
                let joints = joints.len();
                return Err(format!("skin {skin} has {joints} joints and {found} finite bind matrices"));
            }
            let matrices = matrices.as_chunks::<16>().0;
            self.bones.extend(joints.into_iter().zip(matrices).map(|(joint, matrix)| {
                let matrix = DMat4::from_cols_array(&matrix.map(f64::from));
                Bone { joint, inverse_bind: DAffine3::from_mat4(matrix) }
            }));
        } else {
            let joint = nodes.joint_of[node.index()];
            self.bones.push(Bone { joint, inverse_bind: DAffine3::IDENTITY });
        }
        let bones = self.bones.len() - first_bone;
        if bones == 0 || self.bones.len() > usize::from(u16::MAX) {
            return Err(format!("{name}: a skin needs 1 to {} joints, this has {bones}", u16::MAX));
        }
        let first_triangle = self.triangles.len();
        let first_shape = self.shapes.len();
        let mut joined = HashMap::new();
        for primitive in mesh.primitives() {
            let name = format!("{name}, primitive {}", primitive.index());
            let mode = primitive.mode();
            if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
                self.skipped += 1;
                continue;
            }
            let own = Attributes::read(&primitive, node.skin().is_some(), bones, buffers)
                .map_err(|error| format!("{name}: {error}"))?;
            while self.shapes.len() - first_shape < own.deltas.len() {
                self.shapes.push(BlendShape::default());
            }
            let vertices = self.join(&own, first_bone, first_shape, &mut joined);
            self.triangulate(mode, &own.indices, &vertices);
        }
        let shapes = self.shapes.len() - first_shape;
        nodes.shapes_of[node.index()] = (first_shape, shapes);
        let weights = node.weights().or(mesh.weights()).unwrap_or_default();
        let names = shape_names(mesh.extras());
        for (i, shape) in self.shapes[first_shape..].iter_mut().enumerate() {
            shape.rest_weight = weights.get(i).copied().unwrap_or(0.0).into();
            shape.name = names.get(i).cloned().unwrap_or_else(|| format!("shape {i}"));
        }
        let group = mesh.name().or(node.name()).map_or(name, str::to_owned);
        self.groups.push(Group { name: group, triangles: first_triangle..self.triangles.len() });
        Ok(())
    }

    /// Adds the vertices of `own`, those that are alike once, and returns their numbers.
    fn join(
        &mut self,
        own: &Attributes,
        first_bone: usize,
        first_shape: usize,
        joined: &mut HashMap<Vec<u32>, u32>,
    ) -> Vec<u32> {
        let number = |(vertex, &position): (usize, &Vec3)| {
            // Adding 0 makes −0 the same as 0.
            let mut key: Vec<u32> = position.to_array().map(|x| (x + 0.0).to_bits()).into();
            let weights = own.weights.as_ref().map(|own| &own[vertex]);
            for &(bone, weight) in weights.into_iter().flatten() {
                key.extend([bone as u32, weight.to_bits()]);
            }
            for deltas in own.deltas.iter().filter(|deltas| !deltas.is_empty()) {
                key.extend(deltas[vertex].to_array().map(|x| (x + 0.0).to_bits()));
            }
            let next = self.positions.len() as u32;
            let number = *joined.entry(key).or_insert(next);
            if number == next {
                self.positions.push(position);
                let mut weights = weights.cloned().unwrap_or_else(|| vec![(0, 1.0)]);
                if weights.iter().all(|(_, weight)| !(weight.is_finite() && *weight > 0.0)) {
                    self.unbound += 1;
                    weights = vec![(0, 1.0)];
                }
                self.weights.push(weights.into_iter().map(|(bone, w)| (first_bone + bone, w)).collect());
                for (shape, deltas) in self.shapes[first_shape..].iter_mut().zip(&own.deltas) {
                    if let Some(&delta) = deltas.get(vertex).filter(|delta| **delta != Vec3::ZERO) {
                        shape.deltas.push((number, delta));
                    }
                }
            }
            number
        };
        own.positions.iter().enumerate().map(number).collect()
    }

    /// Adds the triangles of `indices`, which count `vertices`.
    fn triangulate(&mut self, mode: Mode, indices: &[u32], vertices: &[u32]) {
        let corners: Vec<u32> = indices.iter().map(|&index| vertices[index as usize]).collect();
        let mut add = |triangle: [u32; 3]| {
            let [a, b, c] = triangle;
            if a == b || b == c || c == a {
                self.dropped += 1;
            } else {
                self.triangles.push(triangle);
            }
        };
        match mode {
            Mode::TriangleStrip => {
                for (i, own) in corners.windows(3).enumerate() {
                    let [a, b, c] = [own[0], own[1], own[2]];
                    // Degenerate triangles in a strip only connect it.
                    if a != b && b != c && c != a {
                        add(if i % 2 == 0 { [a, b, c] } else { [b, a, c] });
                    }
                }
            }
            Mode::TriangleFan => {
                corners.windows(2).skip(1).for_each(|own| add([corners[0], own[0], own[1]]));
            }
            _ => corners.as_chunks().0.iter().for_each(|&own| add(own)),
        }
    }
}

impl Attributes {
    fn read(
        primitive: &::gltf::Primitive<'_>,
        is_skinned: bool,
        bones: usize,
        buffers: &Buffers,
    ) -> Result<Self, String> {
        let vectors = |accessor: &::gltf::Accessor<'_>| -> Result<Vec<Vec3>, String> {
            let numbers = buffers.floats(accessor, 3)?;
            Ok(numbers.as_chunks().0.iter().copied().map(Vec3::from_array).collect())
        };
        let positions =
            primitive.get(&Semantic::Positions).ok_or("it has no positions, or they are compressed")?;
        let positions = vectors(&positions)?;
        let count = positions.len();
        let weights = if is_skinned { Some(Self::weights(primitive, count, bones, buffers)?) } else { None };
        let mut deltas = Vec::new();
        for (shape, target) in primitive.morph_targets().enumerate() {
            let own = match target.positions() {
                Some(accessor) => vectors(&accessor)?,
                None => Vec::new(),
            };
            if own.is_empty() && count > 0 {
                deltas.push(own);
                continue;
            }
            if own.len() != count || own.iter().any(|delta| !delta.is_finite()) {
                let found = own.len();
                return Err(format!("blend shape {shape} has {found} finite entries for {count} vertices"));
            }
            deltas.push(own);
        }
        let indices = match primitive.indices() {
            Some(accessor) => buffers.integers(&accessor, 1)?,
            None => (0..count as u32).collect(),
        };
        if let Some(index) = indices.iter().find(|&&index| index as usize >= count) {
            return Err(format!("it refers to vertex {index} of {count}"));
        }
        Ok(Self { positions, weights, deltas, indices })
    }

    fn weights(
        primitive: &::gltf::Primitive<'_>,
        count: usize,
        bones: usize,
        buffers: &Buffers,
    ) -> Result<Vec<Weights>, String> {
        let mut own: Vec<Weights> = vec![Vec::new(); count];
        for set in 0.. {
            let (joints, weights) =
                (primitive.get(&Semantic::Joints(set)), primitive.get(&Semantic::Weights(set)));
            let (Some(joints), Some(weights)) = (joints, weights) else { break };
            let (joints, weights) = (buffers.integers(&joints, 4)?, buffers.floats(&weights, 4)?);
            if joints.len() != 4 * count || weights.len() != 4 * count {
                let found = [joints.len() / 4, weights.len() / 4];
                return Err(format!("it has {count} vertices, {} joints and {} weights", found[0], found[1]));
            }
            for (i, (&joint, &weight)) in joints.iter().zip(&weights).enumerate() {
                if weight != 0.0 {
                    if joint as usize >= bones {
                        return Err(format!("vertex {} follows joint {joint} of {bones}", i / 4));
                    }
                    own[i / 4].push((joint as usize, weight));
                }
            }
        }
        Ok(own)
    }
}

/// The names of blend shapes in a mesh's extras, as several programs write them.
fn shape_names(extras: &::gltf::json::Extras) -> Vec<String> {
    #[derive(serde::Deserialize)]
    #[serde(rename_all = "camelCase")]
    struct Names {
        target_names: Vec<String>,
    }
    let names = extras.as_ref().and_then(|extras| serde_json::from_str::<Names>(extras.get()).ok());
    names.map(|names| names.target_names).unwrap_or_default()
}
